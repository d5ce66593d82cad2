"""Optical markers on the skin and rigid 6-dof targets of the parametric human, fixed to its segments.

The 41 marker names are those of the CMU-style set; places are offsets from a role in the rest pose (T-pose,
facing +x), as fractions of the stature, for the left side; the right side mirrors them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.human.body import Body
from imitor.types import ROLE_INDEX, SIDES, Array

_Place = tuple[str, tuple[float, float, float]]

_MIDDLE: Final[Mapping[str, _Place]] = {
    "C7": ("neck", (-0.035, 0.000, 0.012)),
    "T10": ("chest", (-0.060, 0.000, -0.010)),
    "CLAV": ("chest", (0.040, 0.000, 0.115)),
    "STRN": ("chest", (0.065, 0.000, 0.010)),
    "RBAC": ("chest", (-0.055, -0.050, 0.060)),
}
_SIDED: Final[Mapping[str, _Place]] = {
    "FHD": ("head", (0.052, 0.040, 0.050)),
    "BHD": ("head", (-0.058, 0.036, 0.055)),
    "SHO": ("chest", (0.000, 0.105, 0.145)),
    "UPA": ("shoulder", (-0.010, 0.095, 0.028)),
    "ELB": ("elbow", (0.000, 0.000, 0.020)),
    "FRM": ("elbow", (-0.010, 0.080, 0.022)),
    "WRA": ("wrist", (0.018, 0.000, 0.006)),
    "WRB": ("wrist", (-0.018, 0.000, 0.006)),
    "FIN": ("hand", (0.000, 0.000, 0.010)),
    "FWT": ("pelvis", (0.032, 0.073, 0.044)),
    "BWT": ("pelvis", (-0.060, 0.030, 0.044)),
    "THI": ("hip", (0.015, 0.045, -0.130)),
    "KNE": ("knee", (0.000, 0.029, 0.000)),
    "SHN": ("knee", (0.015, 0.025, -0.110)),
    "ANK": ("ankle", (0.000, 0.021, 0.000)),
    "HEE": ("ankle", (-0.045, 0.000, -0.020)),
    "TOE": ("ankle", (0.085, 0.004, -0.018)),
    "MT5": ("ankle", (0.060, 0.026, -0.027)),
}
_ORDER: Final = (
    "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAC "
    "LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN "
    "LFWT RFWT LBWT RBWT LTHI LKNE LSHN LANK LHEE LTOE LMT5 RTHI RKNE RSHN RANK RHEE RTOE RMT5"
)
MARKERS_41: Final[tuple[str, ...]] = tuple(_ORDER.split())
"""Names of the 41 markers, in the order of ``HumanFrame.marker``."""

_MIDDLE_SEGMENTS: Final = {
    "head": "LFHD RFHD LBHD RBHD",
    "thorax": "C7 T10 CLAV STRN RBAC LSHO RSHO",
    "pelvis": "LFWT RFWT LBWT RBWT",
}
_SIDED_SEGMENTS: Final = {
    "upper_arm": "SHO UPA ELB", "forearm": "ELB FRM WRA WRB", "hand": "WRA WRB FIN", "thigh": "THI KNE",
    "shank": "KNE SHN ANK", "foot": "ANK HEE TOE MT5",
}  # fmt: skip
MARKER_SEGMENTS: Final[Mapping[str, tuple[str, ...]]] = {
    **{name: tuple(labels.split()) for name, labels in _MIDDLE_SEGMENTS.items()},
    **{
        f"{side}_{name}": tuple(side[0].upper() + label for label in labels.split())
        for side in SIDES
        for name, labels in _SIDED_SEGMENTS.items()
    },
}
"""Segment of the body to the markers that move with it; those at a joint belong to both sides of it."""

_TARGETS_MIDDLE: Final[Mapping[str, _Place]] = {
    "head": ("head", (0.000, 0.000, 0.100)),
    "torso": ("chest", (-0.070, 0.000, 0.040)),
    "hip": ("pelvis", (-0.070, 0.000, 0.030)),
}
_TARGETS_SIDED: Final[Mapping[str, _Place]] = {
    "shoulder": ("chest", (0.000, 0.090, 0.135)),
    "upper_arm": ("shoulder", (0.000, 0.090, 0.035)),
    "forearm": ("elbow", (0.000, 0.090, 0.030)),
    "hand": ("wrist", (0.000, 0.030, 0.018)),
    "thigh": ("hip", (0.055, 0.000, -0.120)),
    "shin": ("knee", (0.035, 0.000, -0.120)),
    "foot": ("ankle", (0.050, 0.000, -0.005)),
}
TARGETS: Final[tuple[str, ...]] = (
    *_TARGETS_MIDDLE,
    *(f"{side}_{part}" for side in SIDES for part in _TARGETS_SIDED),
)
"""Names of the 17 rigid targets, in the order of ``HumanFrame.target``."""


@dataclass(frozen=True)
class Attached:
    """Points fixed to segments: role indices (M,) and offsets in the segments (M, 3) [m]."""

    role: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    offset: Array

    def positions(self, position: Array, orientation: Array) -> Array:
        """Return the points in world (T, M, 3) [m], from positions and orientations of all roles."""
        turned = (orientation[:, self.role] @ self.offset[None, :, :, None])[..., 0]
        return np.asarray(position[:, self.role] + turned)


def _attach(names: tuple[tuple[str, _Place], ...], body: Body) -> Attached:
    scale = body.height_m
    return Attached(
        np.array([ROLE_INDEX[role] for _, (role, _) in names]),
        np.array([np.asarray(offset) * scale for _, (_, offset) in names]),
    )


def _mirrored(place: _Place, side: str) -> _Place:
    role, (x, y, z) = place
    sided = role if role in ROLE_INDEX else f"{side}_{role}"
    return sided, (x, y if side == "left" else -y, z)


def markers(body: Body) -> Attached:
    """Return where the 41 markers sit on this body."""

    def place(name: str) -> _Place:
        if name in _MIDDLE:
            return _MIDDLE[name]
        return _mirrored(_SIDED[name[1:]], "left" if name[0] == "L" else "right")

    return _attach(tuple((name, place(name)) for name in MARKERS_41), body)


def targets(body: Body) -> tuple[Attached, Array]:
    """Return where the rigid targets sit on this body and their rotations in the segments (K, 3, 3).

    A target's z axis points out of the skin, so its rotation against the segment is something to calibrate.
    """

    def place(name: str) -> _Place:
        if name in _TARGETS_MIDDLE:
            return _TARGETS_MIDDLE[name]
        side, _, part = name.partition("_")
        return _mirrored(_TARGETS_SIDED[part], side)

    places = tuple((name, place(name)) for name in TARGETS)
    attached = _attach(places, body)
    return attached, np.stack([_facing(np.asarray(offset)) for _, (_, offset) in places])


def _facing(outwards: Array) -> Array:
    """Return a rotation whose z axis points along the largest component of ``outwards``."""
    axis = int(np.argmax(np.abs(outwards)))
    z = np.zeros(3)
    z[axis] = np.sign(outwards[axis])
    x = np.roll(np.abs(z), 1)
    return np.column_stack([x, np.cross(z, x), z])


def target_poses(attached: Attached, mount: Array, position: Array, orientation: Array) -> Array:
    """Return the poses of the targets in world (T, K, 4, 4)."""
    pose = np.zeros((len(position), len(mount), 4, 4))
    pose[:, :, :3, :3] = orientation[:, attached.role] @ mount
    pose[:, :, :3, 3] = attached.positions(position, orientation)
    pose[:, :, 3, 3] = 1.0
    return pose
