"""The body of an MVNX file: which segment is which role, how its axes lie, its rest pose.

The rest pose is the subject's T-pose in the file, turned to face +x. Orientations are relative to it, so the arm axes
of version 3 (z along the hanging arm) and of version 4 (those of the T-pose) come out alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.human.rotations import about_z
from imitor.motion.mvnx_file import Mvnx
from imitor.motion.normalise import ANKLE_FRACTION, TOE_FRACTION, lateral_axes, middle, role
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array

CENTRE: Final = {"pelvis": "Pelvis", "chest": "T8", "neck": "Neck", "head": "Head"}
SIDED: Final = {
    "shoulder": "UpperArm", "elbow": "ForeArm", "wrist": "Hand",
    "hip": "UpperLeg", "knee": "LowerLeg", "ankle": "Foot", "toe": "Toe",
}  # fmt: skip
ORIGIN: Final[Mapping[str, str]] = CENTRE | {
    f"{s}_{r}": s.capitalize() + name for r, name in SIDED.items() for s in SIDES
}
"""Role -> segment that starts at it; the segment's orientation is the role's."""
ON_SEGMENT: Final[Mapping[str, tuple[str, str]]] = {
    "head_top": ("Head", "pTopOfHead"),
    **{f"{s}_heel": (s.capitalize() + "Foot", f"p{s.capitalize()}HeelFoot") for s in SIDES},
    **{f"{s}_toe_tip": (s.capitalize() + "Toe", f"p{s.capitalize()}Toe") for s in SIDES},
}
"""Role -> point that is fixed in a segment, given in the file."""
LEG_ROLES: Final = tuple(f"{s}_{r}" for s in SIDES for r in ("knee", "ankle", "toe", "heel", "toe_tip"))
HEAD_HEIGHT_FRACTION: Final = 0.91
"""Height of the skull's base as a fraction of stature [-]."""
KNUCKLES_SHARE: Final = 0.050 / 0.146
"""Wrist to knuckles as a share of the forearm; they lie on the hand's long axis."""


def matrices(quaternion: Array) -> Array:
    """Return the rotations of unit quaternions w x y z, shape (..., 3, 3)."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@dataclass(frozen=True)
class Axes:
    """How the file's segments are turned in its rest pose.

    Attributes:
        facing: Turn about the vertical that makes the rest pose face +x, shape (3, 3).
        rest: World from segment in the rest pose as the file has it, shape (S, 3, 3).
        null: The same in the null pose, in whose axes the file gives its points, shape (S, 3, 3).
    """

    facing: Array
    rest: Array
    null: Array


def find_axes(mvnx: Mvnx, kind: str) -> Axes:
    rest = mvnx.rest[kind]
    hips, shoulders = lateral_axes(place(mvnx, rest.position[None])[0])
    lateral = hips + shoulders
    facing = about_z(np.array([np.arctan2(lateral[0], lateral[1])]))[0]
    null = next((mvnx.rest[t].quaternion for t in ("identity", "npose") if t in mvnx.rest), None)
    if null is None:  # of an export with nothing but a T-pose: there the arms are turned as in the null pose
        null = np.where(np.abs(rest.quaternion[:, :1]) > 0.9, np.array([1.0, 0.0, 0.0, 0.0]), rest.quaternion)
    return Axes(facing, matrices(rest.quaternion), matrices(null))


def place(mvnx: Mvnx, origin: Array) -> Array:
    """Return role positions of the segment origins, shape (T, R, 3) [m]."""
    out = np.full((len(origin), N_ROLES, 3), np.nan)
    for name, segment in ORIGIN.items():
        out[:, ROLE_INDEX[name]] = origin[:, mvnx.segments.index(segment)]
    out[:, ROLE_INDEX["pelvis"]] = middle(out, "hip")
    return out


def _add_points(mvnx: Mvnx, axes: Axes, position: Array, rotation: Array) -> None:
    """Add the roles that are fixed points of segments, and the knuckles, to role positions, shape (T, R, 3)."""
    for name, key in ON_SEGMENT.items():
        if key in mvnx.points:
            i = mvnx.segments.index(key[0])
            # The points are written in the axes of the null pose, the rotations may be in others.
            arm = axes.null[i].T @ mvnx.points[key]
            origin = position[:, ROLE_INDEX[_starts(key[0])]]
            position[:, ROLE_INDEX[name]] = origin + rotation[:, i] @ arm
    for side, y in zip(SIDES, (1.0, -1.0), strict=True):
        i = mvnx.segments.index(f"{side.capitalize()}Hand")
        fore = np.linalg.norm(role(position, f"{side}_wrist") - role(position, f"{side}_elbow"), axis=-1)
        reach = KNUCKLES_SHARE * float(np.median(fore))
        arm = axes.null[i].T @ np.array([0.0, y * reach, 0.0])
        position[:, ROLE_INDEX[f"{side}_hand"]] = role(position, f"{side}_wrist") + rotation[:, i] @ arm


def _starts(segment: str) -> str:
    return next(name for name, s in ORIGIN.items() if s == segment)


def rest_pose(mvnx: Mvnx, kind: str, axes: Axes) -> tuple[Array, float, float]:
    """Return the rest pose, shape (R, 3) [m], standing at z = 0, and the heights of ankle and toe over the sole [m]."""
    pose = mvnx.rest[kind]
    posed = place(mvnx, pose.position[None])
    _add_points(mvnx, axes, posed, axes.rest[None])
    rest = posed[0] @ axes.facing.T
    soles = [role(rest, f"{s}_{r}")[2] for s in SIDES for r in ("heel", "toe_tip", "toe")]
    lowest = float(np.nanmin(soles))
    ankle = float(np.mean([role(rest, f"{s}_ankle")[2] for s in SIDES])) - lowest
    toe = float(np.mean([role(rest, f"{s}_toe")[2] for s in SIDES])) - lowest
    if toe < 1e-3:  # without points the ball of the foot is the lowest one, and it lies over the sole
        below = TOE_FRACTION * stature(rest)
        lowest, ankle, toe = lowest - below, ankle + below, toe + below
    hips = middle(rest, "hip")
    return np.asarray(rest - (hips[0], hips[1], lowest)), ankle, toe


def motion_of(mvnx: Mvnx, axes: Axes) -> tuple[Array, Array]:
    """Return role positions, shape (T, R, 3) [m], and orientations relative to the rest pose, (T, R, 3, 3)."""
    rotation = matrices(mvnx.quaternion)
    position = place(mvnx, mvnx.position)
    _add_points(mvnx, axes, position, rotation)
    orientation = np.full((len(rotation), N_ROLES, 3, 3), np.nan)
    for name, segment in ORIGIN.items():
        i = mvnx.segments.index(segment)
        orientation[:, ROLE_INDEX[name]] = rotation[:, i] @ axes.rest[i].T @ axes.facing.T
    return position, orientation


def stature(rest: Array) -> float:
    """Return the height of the vertex in a pose whose soles are at z = 0; without one, from the skull's base [m]."""
    top = float(role(rest, "head_top")[2])
    ankle = float(np.mean([role(rest, f"{s}_ankle")[2] for s in SIDES]))
    if np.isfinite(top):
        return top
    return (float(role(rest, "head")[2]) - ankle) / (HEAD_HEIGHT_FRACTION - ANKLE_FRACTION)
