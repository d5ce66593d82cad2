"""The person in a stream of Xsens MVN: the body that the first second shows, and its frames.

Every orientation is the identity in the null pose, a T-pose that faces +x. Lengths come from the null pose where it was
told (type 13), else from the distances of the segments' origins, which are constant; points on heel, toe tip and vertex
are then estimated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from imitor.errors import ImitorError
from imitor.human.rotations import about_z
from imitor.live.body_options import BodyConfig
from imitor.live.segment_body import Fixed, SegmentBody
from imitor.live.xsens_wire import XsensPose
from imitor.motion.mvnx_body import KNUCKLES_SHARE, ON_SEGMENT, ORIGIN, stature
from imitor.motion.mvnx_file import SEGMENTS
from imitor.motion.normalise import (
    FLOOR_TOLERANCE_M,
    TOE_FRACTION,
    handedness,
    lateral_axes,
    middle,
    role,
)
from imitor.motion.skeletons import RolePoint
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, SIDES, Array, BoolArray, Skeleton

_CHAIN: Final = ("Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head")
PARENT: Final[Mapping[str, str]] = {
    **dict(zip(_CHAIN[1:], _CHAIN[:-1], strict=True)),
    **{f"{s}Shoulder": "T8" for s in ("Right", "Left")},
    **{f"{s}UpperLeg": "Pelvis" for s in ("Right", "Left")},
    **{
        f"{s}{below}": f"{s}{above}"
        for s in ("Right", "Left")
        for above, below in (
            ("Shoulder", "UpperArm"), ("UpperArm", "ForeArm"), ("ForeArm", "Hand"),
            ("UpperLeg", "LowerLeg"), ("LowerLeg", "Foot"), ("Foot", "Toe"),
        )
    },
}  # fmt: skip
SEGMENT_INDEX: Final = {name: i for i, name in enumerate(SEGMENTS)}
PARENT_INDEX: Final = [SEGMENT_INDEX[PARENT.get(s, s)] for s in SEGMENTS]
ROLE_OF: Final = {segment: name for name, segment in ORIGIN.items()}
HEEL_BEHIND: Final = 0.5
"""Heel behind the ankle, by the ankle's height [-], where no null pose tells it."""
TIP_AHEAD: Final = 0.4
"""Toe tip ahead of the ball of the foot, by the distance from ankle to ball [-], where no null pose tells it."""
_LEAST_WHOLE: Final = 2


def learn_body(poses: Sequence[XsensPose], options: BodyConfig) -> tuple[SegmentBody, Skeleton]:
    """Return the body that the first instants show.

    Raises:
        ImitorError: No instant shows the whole body, or left and right are swapped.
    """
    told = next((p.null_pose for p in reversed(poses) if p.null_pose is not None), None)
    position = np.stack([p.position for p in poses])
    rotation = np.stack([p.rotation for p in poses])
    notes = ["skeleton: Xsens MVN, network streaming"]
    if told is not None:
        origin, points = told.origin, told.points
        notes.append("lengths: of the null pose that the sender told")
    else:
        origin, points = _origins(position, rotation), {}
        notes.append(
            "lengths: from the segments' origins; heels, toe tips and vertex are estimated (no null pose was told)"
        )
    rest, facing = _rest(origin, points)
    if handedness(rest) < 0.3:
        raise ImitorError(
            "left and right are swapped in the null pose: the feet point backwards; calibrate MVN again"
        )
    height_m = options.height_m or stature(rest)
    notes.append(f"stature {height_m:.2f} m" + (" as given" if options.height_m else ""))
    ankle_m, toe_m = (float(np.mean([role(rest, f"{s}_{j}")[2] for s in SIDES])) for j in ("ankle", "toe"))
    body = _body(rest, facing)
    body.floor_m = _floor(body.roles(position, rotation)[0], ankle_m, toe_m, options, notes)
    known: BoolArray = np.asarray(np.isfinite(rest).all(axis=-1))
    skeleton = Skeleton(
        name="xsens",
        roles=frozenset(name for name in ROLES if known[ROLE_INDEX[name]]),
        rest_position=rest,
        height_m=height_m,
        ankle_height_m=ankle_m,
        toe_height_m=toe_m,
        mass_kg=options.mass_kg,
        sex=options.sex,
        notes=tuple(notes),
    )
    return body, skeleton


def _origins(position: Array, rotation: Array) -> Array:
    """Return the origins in the null pose, shape (23, 3): every offset is the median of those that are seen."""
    seen: BoolArray = np.asarray(np.isfinite(position).all(axis=2) & np.isfinite(rotation).all(axis=(2, 3)))
    whole = seen.all(axis=1)
    if whole.sum() < _LEAST_WHOLE:
        missing = [SEGMENTS[i] for i in np.flatnonzero(~seen.all(axis=0))]
        raise ImitorError(
            f"no two instants show the whole body: {', '.join(missing)} missing; does the sender stream all "
            "segments? See Options, Network Streamer in MVN"
        )
    position, rotation = position[whole], rotation[whole]
    origin = np.zeros((len(SEGMENTS), 3))
    for name, above in PARENT.items():  # parents before children
        i, j = SEGMENT_INDEX[name], SEGMENT_INDEX[above]
        offset = np.swapaxes(rotation[:, j], -1, -2) @ (position[:, i] - position[:, j])[..., None]
        origin[i] = origin[j] + np.median(offset[..., 0], axis=0)
    return origin


def _rest(origin: Array, points: Mapping[tuple[str, str], Array]) -> tuple[Array, Array]:
    """Return the rest pose, shape (R, 3) [m], on a floor at 0, and the turn that makes it face +x, shape (3, 3)."""
    rest = np.full((N_ROLES, 3), np.nan)
    for name, segment in ORIGIN.items():
        rest[ROLE_INDEX[name]] = origin[SEGMENT_INDEX[segment]]
    rest[ROLE_INDEX["pelvis"]] = middle(rest, "hip")
    for name, (segment, point) in ON_SEGMENT.items():
        if (segment, point) in points:
            rest[ROLE_INDEX[name]] = origin[SEGMENT_INDEX[segment]] + points[segment, point]
    for side, y in zip(SIDES, (1.0, -1.0), strict=True):
        fore = float(np.linalg.norm(role(rest, f"{side}_wrist") - role(rest, f"{side}_elbow")))
        reach = np.array([0.0, y * KNUCKLES_SHARE * fore, 0.0])
        rest[ROLE_INDEX[f"{side}_hand"]] = role(rest, f"{side}_wrist") + reach
    hips, shoulders = lateral_axes(rest)
    lateral = hips + shoulders
    facing = about_z(np.array([np.arctan2(lateral[0], lateral[1])]))[0]
    rest = rest @ facing.T
    soles = np.array([role(rest, f"{s}_{r}")[2] for s in SIDES for r in ("heel", "toe_tip", "toe")])
    lowest = float(np.nanmin(soles))
    toe = float(np.mean([role(rest, f"{s}_toe")[2] for s in SIDES]))
    if (
        toe - lowest < 1e-3
    ):  # without points the ball of the foot is the lowest one, and it lies over the sole
        rest[:, 2] -= lowest
        lowest = -TOE_FRACTION * stature(rest)
    hip = middle(rest, "hip")
    rest = rest - (hip[0], hip[1], lowest)
    _estimate(rest)
    return rest, facing


def _estimate(rest: Array) -> None:
    """Fill heels, toe tips and vertex in where they are unknown, on the floor and under the stature."""
    top = ROLE_INDEX["head_top"]
    if not np.isfinite(rest[top]).all():
        rest[top] = *role(rest, "head")[:2], stature(rest)
    for side in SIDES:
        ankle, toe = role(rest, f"{side}_ankle"), role(rest, f"{side}_toe")
        heel, tip = ROLE_INDEX[f"{side}_heel"], ROLE_INDEX[f"{side}_toe_tip"]
        if not np.isfinite(rest[heel]).all():
            rest[heel] = ankle[0] - HEEL_BEHIND * ankle[2], ankle[1], 0.0
        if not np.isfinite(rest[tip]).all():
            rest[tip] = toe[0] + TIP_AHEAD * (toe[0] - ankle[0]), toe[1], 0.0


def _body(rest: Array, facing: Array) -> SegmentBody:
    points = {
        name: RolePoint(i, i, 0.0, i) for name, segment in ORIGIN.items() for i in (SEGMENT_INDEX[segment],)
    }
    left, right = SEGMENT_INDEX["LeftUpperLeg"], SEGMENT_INDEX["RightUpperLeg"]
    points["pelvis"] = RolePoint(left, right, 0.5, SEGMENT_INDEX["Pelvis"])
    carrier = {name: ROLE_OF[segment] for name, (segment, _) in ON_SEGMENT.items()}
    carrier |= {f"{s}_hand": f"{s}_wrist" for s in SIDES}
    fixed = {name: Fixed(of, role(rest, name) - role(rest, of)) for name, of in carrier.items()}
    return SegmentBody(points, np.tile(facing, (len(SEGMENTS), 1, 1)), fixed)


def _floor(position: Array, ankle_m: float, toe_m: float, options: BodyConfig, notes: list[str]) -> float:
    """Return the floor's height in the sender's world [m]: under the lower foot, its own zero when that is near."""
    parts = (("ankle", ankle_m), ("toe", toe_m), ("heel", 0.0), ("toe_tip", 0.0))
    sole = np.stack([[role(position, f"{s}_{p}")[:, 2] - over for p, over in parts] for s in SIDES])
    low = sole.min(axis=(0, 1))
    low = low[np.isfinite(low)]
    if isinstance(options.floor, int | float):
        notes.append(f"floor: at {options.floor:g} m of the sender, as given")
        return float(options.floor)
    found = float(np.median(low[low <= np.median(low)])) if len(low) else 0.0
    if options.floor == "sender" or abs(found) <= FLOOR_TOLERANCE_M:
        notes.append(f"floor: the sender's zero (the feet stand {found:+.3f} m from it)")
        return 0.0
    notes.append(f"floor: {found:+.3f} m at the sender, from the standing feet")
    return found


__all__ = ["PARENT_INDEX", "ROLE_OF", "SEGMENT_INDEX", "learn_body"]
