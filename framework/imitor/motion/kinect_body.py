"""The body of a depth-camera recording: its lengths, stature, rest pose; and how the sensor was tilted.

Positions are role positions in a world with z up, shape (T, R, 3), NaN where a role is not known in a frame.
"""

from __future__ import annotations

import warnings
from typing import Final

import numpy as np

from imitor.human import masses
from imitor.motion.normalise import (
    ANKLE_FRACTION,
    FLAT_M,
    TOE_FRACTION,
    handedness,
    middle,
    role,
    unit_vector,
)
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
WIDTHS: Final = {"shoulder": 0.21, "hip": 0.1}
"""Distances of left and right joint centres as fractions of stature."""

MOST_TILT_RAD: Final = 0.5
LEAST_TILT_RAD: Final = 0.035
"""A tilt beyond the first is no sensor's, one below the second drowns in the posture [rad]."""
_STRAIGHT: Final = 0.9
_UPRIGHT: Final = 0.75
_MIN_FRAMES: Final = 10
_BENT_M: Final = 0.05
_HALF_FOOT: Final = 0.03
"""Middle of the base of support ahead of the ankles, for sets without toes, as a fraction of stature."""


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
    return rest


def find_tilt(position: Array, height_m: float) -> float | None:
    """Find how far the sensor looks down, from balance: who stands has the CoM over the middle of the feet.

    Only frames count in which both legs are straight and the body is about upright.

    Args:
        position: Positions in the sensor's world, x towards the sensor.
        height_m: Stature [m].

    Returns:
        The tilt [rad], positive when it looks down; None when nobody stands.
    """
    legs = [
        (
            unit_vector(role(position, f"{s}_hip") - role(position, f"{s}_knee")),
            unit_vector(role(position, f"{s}_knee") - role(position, f"{s}_ankle")),
        )
        for s in SIDES
    ]
    with np.errstate(invalid="ignore"):
        stands = np.all(
            [
                ((thigh * shank).sum(-1) > _STRAIGHT) & (thigh[:, 2] > _UPRIGHT) & (shank[:, 2] > _UPRIGHT)
                for thigh, shank in legs
            ],
            axis=0,
        )
    if stands.sum() < _MIN_FRAMES:
        return None
    known: BoolArray = np.asarray(np.isfinite(position[stands]).all(axis=-1))
    weights = masses.weights(masses.winter(), np.asarray(known.any(axis=0)))
    if weights is None:
        return None
    used = weights != 0.0
    com = np.einsum("r,tri->ti", weights[used], position[stands][:, used])
    base = middle(position[stands], "ankle")
    toes = middle(position[stands], "toe")
    base = np.where(np.isnan(toes), base + np.array([_HALF_FOOT * height_m, 0.0, 0.0]), 0.5 * (base + toes))
    up = com - base
    up = up[np.isfinite(up).all(axis=1)]
    if len(up) < _MIN_FRAMES:
        return None
    return float(np.median(np.arctan2(up[:, 0], up[:, 2])))


def side_evidence(position: Array) -> tuple[float, float]:
    """Tell whether left is left, from the feet (bent knees without them), and whether the body faces +x.

    Returns:
        Mean cosines, +1 for a body as it should be; 0 where nothing can be told.
    """
    points = [f"{s}_{j}" for s in SIDES for j in ("hip", "shoulder", "knee", "ankle")]
    known = np.all([np.isfinite(role(position, p)).all(axis=-1) for p in points], axis=0)
    body = position[known]
    if not len(body):
        return 0.0, 0.0
    toes = np.all([np.isfinite(role(body, f"{s}_toe")).all(axis=-1) for s in SIDES], axis=0)
    bend = middle(body, "knee") - 0.5 * (middle(body, "hip") + middle(body, "ankle"))
    bent = np.linalg.norm(bend[:, :2], axis=-1) > _BENT_M
    tells = toes if toes.any() else bent
    anatomy = handedness(body[tells]) if tells.any() else 0.0
    lateral = unit_vector((role(body, "left_hip") - role(body, "right_hip")) * (1.0, 1.0, 0.0))
    return anatomy, float(lateral[:, 1].mean())


def find_floor(position: Array, height_m: float) -> tuple[float, float, float]:
    """Find the floor under the lower foot: in most frames it stands.

    A sole is where the lowest of ankle and toe puts it, each lowered by its usual height. The median of all frames is
    taken, since the sensor sees a planted foot rise and sink by several centimetres.

    Args:
        position: The motion, without gaps.
        height_m: Stature [m].

    Returns:
        Heights of the floor in the recording and of ankle and toe over it when a foot stands flat [m]; NaN if unknown.
    """
    usual = height_m * np.array([ANKLE_FRACTION, TOE_FRACTION])
    z = np.stack(
        [[role(position, f"{s}_{p}")[:, 2] for p in ("ankle", "toe")] for s in SIDES]
    )  # (side, point, T)
    sole = np.fmin.reduce(z - usual[:, None], axis=1)
    floor = median(sole.min(axis=0))
    flat = np.abs(sole - floor) < FLAT_M
    ankle, toe = (median(z[:, i][flat]) - floor for i in range(2))
    return floor, ankle, toe


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
