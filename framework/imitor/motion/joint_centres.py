"""Joint centres from markers on the skin, by published regressions, for a whole clip at once.

`frame_centres` does the same for one frame.

| centre | from |
| --- | --- |
| hip | the anterior iliac spines: of their distance 14 % inwards, 22 % back, 30 % down [bell1989] |
| knee, ankle, elbow | the middle of both sides; with the outer marker alone half the joint's width inwards |
| shoulder | the acromion, lowered along the trunk by 17 % of the acromions' distance [rab2002] |
| wrist | the middle of both sides |
| neck | the middle of C7 and the jugular notch |
| head | on the line from the neck to the head band |

Everything is expressed in the body's own axes, so that the clip may have any axis up. Points are arrays (T, 3), NaN
where a marker is lost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.motion.body_lengths import median
from imitor.motion.normalise import direction
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array

Points = Mapping[str, Array]

INWARDS, BACK, DOWN = 0.14, 0.22, 0.30
"""Hip centre from the anterior iliac spine of its side, by the distance of both spines [-] [bell1989]."""
SHOULDER_DROP: Final = 0.17
"""Shoulder centre under the acromion, by the distance of both acromions [-] [rab2002]."""
HALF_WIDTH_M: Final = {"knee": 0.050, "ankle": 0.035, "elbow": 0.035}
"""From the middle of an outer marker to the joint's centre [m]: half a usual width and half a marker."""
HEAD_SHARE: Final = 0.54
"""Skull's base on the way from the neck joint to the middle of a head band [-]."""
HEAD_OVER_NECK: Final = 0.062
"""Skull's base over the neck joint as a fraction of stature [-], for sets without a head."""
CHEST_SHARE: Final = 0.6
"""Chest on the way from mid-hip to mid-shoulder [-], for sets without sternum and T10."""
HAND_SHARE: Final = 0.34
"""Knuckles beyond the wrist, by the length of the forearm [-], for sets without a hand."""
NECK_DEPTH: Final = 0.035
"""From C7 or the jugular notch to the middle of both as a fraction of stature [-], for sets with one of them."""
DEFAULT_SHOULDERS_M: Final = 0.36
"""Distance of the acromions [m], where only one is seen."""
PASSES: Final = 3
"""How often the elbow's axis is found again from a better centre."""
BENT: Final = 0.25
"""Sine of the elbow's bend from which on it tells the elbow's axis [-]."""


@dataclass(frozen=True)
class CentreFit:
    """What is constant of a person: found once over a clip, then good for every frame.

    Attributes:
        height_m: Stature, for what the set has no marker for [m].
        pelvis_m: Distance of the anterior iliac spines [m].
        shoulders_m: Distance of the acromions [m].
        head: Whether a head band was ever seen.
    """

    height_m: float
    pelvis_m: float
    shoulders_m: float
    head: bool


def fit_centres(points: Points, height_m: float) -> CentreFit:
    """Find what is constant of a person.

    Args:
        points: Landmark to positions, shape (T, 3) [m].
        height_m: Stature [m].
    """
    left, right = (points.get(f"{s}_shoulder") for s in SIDES)
    shoulders = DEFAULT_SHOULDERS_M
    if left is not None and right is not None:
        found = median(np.linalg.norm(left - right, axis=-1))
        shoulders = found if np.isfinite(found) else shoulders
    return CentreFit(
        height_m=height_m,
        pelvis_m=median(np.linalg.norm(points["left_asis"] - points["right_asis"], axis=-1)),
        shoulders_m=shoulders,
        head="head" in points and bool(np.isfinite(points["head"]).any()),
    )


def joint_centres(points: Points, height_m: float) -> Array:
    """Return role positions, shape (T, R, 3) [m]; NaN where a marker that is needed is lost or not in the set.

    Args:
        points: Landmark to positions, shape (T, 3) [m].
        height_m: Stature, for what the set has no marker for [m].
    """
    fit = fit_centres(points, height_m)
    frames = len(next(iter(points.values())))
    out = np.full((frames, N_ROLES, 3), np.nan)

    def put(name: str, place: Array | None) -> None:
        if place is not None:
            out[:, ROLE_INDEX[name]] = place

    lateral, forward, up = _pelvis(points)
    hips = {}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        spine = points[f"{side}_asis"]
        hips[side] = spine + fit.pelvis_m * (-sign * INWARDS * lateral - BACK * forward - DOWN * up)
        put(f"{side}_hip", hips[side])
    pelvis = 0.5 * (hips["left"] + hips["right"])
    put("pelvis", pelvis)
    neck = _neck(points, pelvis, forward, height_m)
    trunk = direction(neck - pelvis)
    across = _shoulder_line(points)
    shoulders = {}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        shoulders[side] = _shoulder(points, side, trunk, fit)
        put(f"{side}_shoulder", shoulders[side])
        _leg(out, points, side, sign, lateral, hips[side])
        if shoulders[side] is not None:
            _arm(out, points, side, sign, shoulders[side], across)
    put("neck", neck)
    put("head", _head(points, neck, trunk, fit))
    put("chest", _chest(points, pelvis, neck, shoulders))
    return out


def _pelvis(points: Points) -> tuple[Array, Array, Array]:
    """Return the pelvis' axes to the left, forward and up, shape (T, 3)."""
    left, right = points["left_asis"], points["right_asis"]
    back = points["sacrum"] if "sacrum" in points else 0.5 * (points["left_psis"] + points["right_psis"])
    lateral = direction(left - right)
    ahead = 0.5 * (left + right) - back
    forward = direction(ahead - lateral * (ahead * lateral).sum(-1, keepdims=True))
    return lateral, forward, _cross(forward, lateral)


def _shoulder_line(points: Points) -> Array | None:
    """Return the direction from the right to the left acromion, shape (T, 3)."""
    if "left_shoulder" not in points or "right_shoulder" not in points:
        return None
    return direction(points["left_shoulder"] - points["right_shoulder"])


def _neck(points: Points, pelvis: Array, forward: Array, height_m: float) -> Array:
    c7, notch = points.get("c7"), points.get("clavicle")
    if c7 is not None and notch is not None:
        return np.asarray(0.5 * (c7 + notch))
    one = c7 if c7 is not None else notch
    if one is None:
        return np.asarray(0.5 * (points["left_shoulder"] + points["right_shoulder"]))
    across = _shoulder_line(points)
    ahead = forward if across is None else direction(_cross(across, direction(one - pelvis)))
    return np.asarray(one + (1.0 if one is c7 else -1.0) * NECK_DEPTH * height_m * ahead)


def _shoulder(points: Points, side: str, trunk: Array, fit: CentreFit) -> Array | None:
    acromion = points.get(f"{side}_shoulder")
    return None if acromion is None else np.asarray(acromion - SHOULDER_DROP * fit.shoulders_m * trunk)


def _head(points: Points, neck: Array, trunk: Array, fit: CentreFit) -> Array:
    if not fit.head:
        return np.asarray(neck + HEAD_OVER_NECK * fit.height_m * trunk)
    return np.asarray(neck + HEAD_SHARE * (points["head"] - neck))


def _chest(points: Points, pelvis: Array, neck: Array, shoulders: Mapping[str, Array | None]) -> Array:
    front, back = points.get("sternum"), points.get("t10")
    if front is not None and back is not None:
        return np.asarray(0.5 * (front + back))
    left, right = shoulders["left"], shoulders["right"]
    top = neck if left is None or right is None else 0.5 * (left + right)
    return np.asarray(pelvis + CHEST_SHARE * (top - pelvis))


def _leg(out: Array, points: Points, side: str, sign: float, lateral: Array, hip: Array) -> None:
    """Write the roles of a leg; ``sign`` is +1 for the left.

    The knee bends about an axis between the pelvis' and the foot's: with the leg turned out, so is half of the turn.
    """
    heel, toe = (points.get(f"{side}_{name}") for name in ("heel", "toe"))
    outer = points[f"{side}_knee_lateral"]
    knee = _between(points, side, "knee")
    if knee is None:
        axis = lateral
        if heel is not None and toe is not None:
            foot = direction(_cross(outer - points[f"{side}_ankle_lateral"], toe - heel))
            axis = np.where(np.isfinite(foot), lateral + foot, lateral)
        knee = inwards_of(outer, hip, sign * axis, HALF_WIDTH_M["knee"])
    ankle = _between(points, side, "ankle")
    if ankle is None:
        ankle = inwards_of(
            points[f"{side}_ankle_lateral"], knee, direction(outer - knee), HALF_WIDTH_M["ankle"]
        )
    out[:, ROLE_INDEX[f"{side}_knee"]] = knee
    out[:, ROLE_INDEX[f"{side}_ankle"]] = ankle
    for name, place in (("heel", heel), ("toe", toe)):
        if place is not None:
            out[:, ROLE_INDEX[f"{side}_{name}"]] = place


def _arm(
    out: Array, points: Points, side: str, sign: float, shoulder: Array | None, across: Array | None
) -> None:
    """Write the roles of an arm; ``sign`` is +1 for the left."""
    outer = points.get(f"{side}_elbow_lateral")
    if outer is None or shoulder is None:
        return
    wrist = _between(points, side, "wrist", ("radial", "ulnar"))
    wrist = points.get(f"{side}_wrist") if wrist is None else wrist
    elbow = _between(points, side, "elbow")
    if elbow is None:
        elbow = outer
        for _ in range(
            PASSES
        ):  # the marker lies beside the plane of the arm: the axis gets better with the centre
            axis = elbow_axis(shoulder, elbow, wrist, across)
            if axis is None:
                break
            elbow = inwards_of(outer, shoulder, sign * axis, HALF_WIDTH_M["elbow"])
    out[:, ROLE_INDEX[f"{side}_elbow"]] = elbow
    if wrist is None:
        return
    out[:, ROLE_INDEX[f"{side}_wrist"]] = wrist
    hand = points.get(f"{side}_hand")
    out[:, ROLE_INDEX[f"{side}_hand"]] = wrist + HAND_SHARE * (wrist - elbow) if hand is None else hand


def _between(
    points: Points, side: str, joint: str, sides: tuple[str, str] = ("lateral", "medial")
) -> Array | None:
    a, b = (points.get(f"{side}_{joint}_{s}") for s in sides)
    return None if a is None or b is None else np.asarray(0.5 * (a + b))


def inwards_of(outer: Array, above: Array, outwards: Array, half_width_m: float) -> Array:
    """Return a joint's centre from its outer marker, the next centre above, and the direction outwards.

    The centre lies at right angles to the limb: the angle at it between the marker and the centre above is right.

    Args:
        outer, above: Positions, shape (T, 3) [m].
        outwards: Direction from the centre to the marker, about, shape (T, 3).
        half_width_m: From the marker to the centre [m].
    """
    limb = above - outer
    length = np.linalg.norm(limb, axis=-1, keepdims=True)
    along = limb / length
    inwards = -direction(outwards - along * (outwards * along).sum(-1, keepdims=True))
    cosine = np.clip(half_width_m / length, 0.0, 0.5)
    return np.asarray(outer + half_width_m * (cosine * along + np.sqrt(1.0 - cosine**2) * inwards))


def elbow_axis(shoulder: Array, elbow: Array, wrist: Array | None, across: Array | None) -> Array | None:
    """Return the axis about which the elbow bends, to the body's left when the forearm points ahead, shape (T, 3).

    A bent arm tells it: (wrist - elbow) × (elbow - shoulder). While the arm is straight the axis is carried over from
    the bent frames before and after, or where there are none it is the line of the shoulders.

    Args:
        shoulder, elbow, wrist: Positions, shape (T, 3).
        across: Direction from the right to the left shoulder, shape (T, 3).
    """
    if wrist is None:
        return across
    upper, lower = direction(elbow - shoulder), direction(wrist - elbow)
    normal = _cross(lower, upper)
    bend = np.linalg.norm(normal, axis=-1)
    bent = np.flatnonzero(bend > BENT)
    if not len(bent):
        return across
    axis = np.asarray(direction(normal))
    straight = np.flatnonzero(~(bend > BENT) & np.isfinite(bend))
    for k in range(3):
        axis[straight, k] = np.interp(straight, bent, axis[bent, k])
    axis -= upper * (axis * upper).sum(-1, keepdims=True)
    return np.asarray(direction(axis))


def _cross(a: Array, b: Array) -> Array:
    return np.cross(a, b).astype(np.float64)
