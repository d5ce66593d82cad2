"""Joint orders of the Unitree G1 with 29 joints."""

from __future__ import annotations

from typing import Final

_LEG: Final = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM: Final = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch",
                "wrist_yaw")  # fmt: skip
_WAIST: Final = ("waist_yaw", "waist_roll", "waist_pitch")


def _sided(joints: tuple[str, ...], side: str) -> tuple[str, ...]:
    return tuple(f"{side}_{joint}_joint" for joint in joints)


DEPTH_FIRST: Final[tuple[str, ...]] = (
    *_sided(_LEG, "left"),
    *_sided(_LEG, "right"),
    *(f"{joint}_joint" for joint in _WAIST),
    *_sided(_ARM, "left"),
    *_sided(_ARM, "right"),
)
"""Limb after limb: the motors of the robot, and the joints of its MJCF and URDF."""

_TO_BREADTH_FIRST: Final = (
    0, 3, 6, 9, 13, 17, 1, 4, 7, 10, 14, 18, 2, 5, 8, 11, 15, 19, 21, 23, 25, 27, 12, 16, 20, 22, 24, 26, 28,
)  # fmt: skip
"""Where each joint of `DEPTH_FIRST` is in `BREADTH_FIRST`."""

BREADTH_FIRST: Final[tuple[str, ...]] = tuple(
    name for _, name in sorted(zip(_TO_BREADTH_FIRST, DEPTH_FIRST, strict=True))
)
"""Level after level of the kinematic tree, as Isaac Lab orders the joints."""

WAIST_AND_ARMS: Final = range(12, 29)
"""Motors that the maker's interface for the upper body moves."""

__all__ = ["BREADTH_FIRST", "DEPTH_FIRST", "WAIST_AND_ARMS"]
