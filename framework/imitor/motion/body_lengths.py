"""The body that positions over time show: its lengths, stature and rest pose; and positions without gaps.

Positions are role positions in a world with z up, shape (T, R, 3), NaN where a role is not known in a frame.
"""

from __future__ import annotations

import warnings
from typing import Final

import numpy as np

from imitor.motion.normalise import middle, role
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, BoolArray

ABOVE: Final = {"trunk": 0.288, "head": 0.112}
"""Mid-hip to mid-shoulder and mid-shoulder to the head's centre, as fractions of stature."""
HEAD_TOP_SHARE: Final = 0.182
"""Mid-shoulder to vertex as a fraction of stature."""
LENGTHS: Final = {
    "shank": ("knee", "ankle", 0.246), "thigh": ("hip", "knee", 0.245), "upper_arm": ("shoulder", "elbow", 0.186),
    "forearm": ("elbow", "wrist", 0.146), "palm": ("wrist", "hand", 0.054), "foot": ("ankle", "toe", 0.076),
}  # fmt: skip
"""Segments of the limbs: ends, and the usual length as a fraction of stature [winter2009]."""
TIP_M: Final = 0.01
"""Height of the tip of the toes over the floor [m]."""
WIDTHS: Final = {"shoulder": 0.21, "hip": 0.1}
"""Distances of left and right joint centres as fractions of stature."""


def median(values: Array) -> float:
    """Return the median of what is known, NaN when nothing is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def _distance(position: Array, a: str, b: str) -> float:
    return median(np.linalg.norm(role(position, a) - role(position, b), axis=-1))


def both_sides(position: Array, a: str, b: str) -> float:
    """Return the median length from one joint to another, the mean of the sides that are known [m]."""
    found = [_distance(position, f"{s}_{a}", f"{s}_{b}") for s in SIDES]
    known = [f for f in found if np.isfinite(f)]
    return float(np.mean(known)) if known else float("nan")


def above_hips(position: Array) -> dict[str, float]:
    """Return the median lengths of trunk and of mid-shoulder to head [m]; NaN if unknown."""
    shoulders = middle(position, "shoulder")
    return {
        "trunk": median(np.linalg.norm(shoulders - middle(position, "hip"), axis=-1)),
        "head": median(np.linalg.norm(role(position, "head") - shoulders, axis=-1)),
    }


def stature(position: Array) -> float:
    """Estimate the stature from the segments between ankle and head that are known; NaN without a trunk."""
    found = above_hips(position)
    if not np.isfinite(found["trunk"]):
        return float("nan")
    shoulders = middle(position, "shoulder")
    top = median(np.linalg.norm(role(position, "head_top") - shoulders, axis=-1))
    pairs = [(found["trunk"], ABOVE["trunk"])]
    pairs += [(top, HEAD_TOP_SHARE) if np.isfinite(top) else (found["head"], ABOVE["head"])]
    pairs += [(both_sides(position, *LENGTHS[name][:2]), LENGTHS[name][2]) for name in ("thigh", "shank")]
    known = [(length, share) for length, share in pairs if np.isfinite(length)]
    return sum(length for length, _ in known) / sum(share for _, share in known)


def rest_pose(position: Array, height_m: float, ankle_m: float, toe_m: float, roles: frozenset[str]) -> Array:
    """Build an upright T-pose that faces +x from the median lengths, shape (R, 3) [m].

    Args:
        position: The motion.
        height_m: Stature, for what is never seen.
        ankle_m: Height of the ankles over the floor.
        toe_m: Height of the toes.
        roles: The roles to give.
    """
    length = {}
    for name, (a, b, share) in LENGTHS.items():
        found = both_sides(position, a, b)
        length[name] = found if np.isfinite(found) else share * height_m
    for joint, share in WIDTHS.items():
        found = _distance(position, f"left_{joint}", f"right_{joint}")
        length[joint] = found if np.isfinite(found) else share * height_m
    found_above = above_hips(position)
    for name, share in ABOVE.items():
        length[name] = found_above[name] if np.isfinite(found_above[name]) else share * height_m
    hip_z = ankle_m + length["shank"] + length["thigh"]
    shoulder_z = hip_z + length["trunk"]
    head_z = shoulder_z + length["head"]
    rest = np.full((N_ROLES, 3), np.nan)

    def put(name: str, x: float, y: float, z: float) -> None:
        if name in roles:
            rest[ROLE_INDEX[name]] = x, y, z

    put("pelvis", 0.0, 0.0, hip_z)
    for name, low, high in (("chest", hip_z, shoulder_z), ("neck", hip_z, head_z)):
        rise = median(np.linalg.norm(role(position, name) - middle(position, "hip"), axis=-1))
        put(name, 0.0, 0.0, min(low + rise, high) if np.isfinite(rise) else shoulder_z)
    put("head", 0.0, 0.0, head_z)
    put("head_top", 0.0, 0.0, max(height_m, head_z))
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        out = 0.5 * length["shoulder"]
        put(f"{side}_shoulder", 0.0, sign * out, shoulder_z)
        for name, part in (("elbow", "upper_arm"), ("wrist", "forearm"), ("hand", "palm")):
            out += length[part]
            put(f"{side}_{name}", 0.0, sign * out, shoulder_z)
        y = sign * 0.5 * length["hip"]
        put(f"{side}_hip", 0.0, y, hip_z)
        put(f"{side}_knee", 0.0, y, ankle_m + length["shank"])
        put(f"{side}_ankle", 0.0, y, ankle_m)
        ahead = np.sqrt(max(length["foot"] ** 2 - (ankle_m - toe_m) ** 2, (0.5 * length["foot"]) ** 2))
        put(f"{side}_toe", float(ahead), y, toe_m)
        put(f"{side}_heel", -_behind(position, ankle_m), y, 0.0)
        tip = both_sides(position, "toe", "toe_tip")
        put(f"{side}_toe_tip", float(ahead) + (tip if np.isfinite(tip) else 0.0), y, min(toe_m, TIP_M))
    return rest


def _behind(position: Array, ankle_m: float) -> float:
    """Return how far the heels lie behind the ankles [m], from their distance and the ankles' height."""
    length = both_sides(position, "ankle", "heel")
    return float(np.sqrt(max(length**2 - ankle_m**2, 0.0))) if np.isfinite(length) else 0.5 * ankle_m


def filled(position: Array, valid: BoolArray) -> Array:
    """Return the positions with gaps interpolated over time; a role that is never known stays NaN."""
    out = position.copy()
    time = np.arange(len(position))
    for r in np.flatnonzero(valid.any(axis=0) & ~valid.all(axis=0)):
        seen = valid[:, r]
        for axis in range(3):
            out[:, r, axis] = np.interp(time, time[seen], position[seen, r, axis])
    return out


def smoothed(position: Array, width: int) -> Array:
    """Return a running median over ``width`` frames (odd), for finding the floor under a noisy foot."""
    half = width // 2
    padded = np.concatenate([position[:1].repeat(half, 0), position, position[-1:].repeat(half, 0)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, width, axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a role that is never known
        return np.asarray(np.median(windows, axis=-1))
