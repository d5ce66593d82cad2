"""What flows through a pipeline: the human's skeleton and frames, and the robot's configuration.

World frame everywhere: right-handed, z up, x forward, y left; metres, radians, seconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int_]
AnyArray = TypeVar("AnyArray", bound=NDArray[Any])

_SIDED: Final = ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "heel", "toe", "toe_tip")

ROLES: Final[tuple[str, ...]] = (
    "pelvis",
    "chest",
    "neck",
    "head",
    "head_top",
    *(f"left_{r}" for r in _SIDED),
    *(f"right_{r}" for r in _SIDED),
)
"""Canonical points of a human, in the order of every ``(R, ...)`` array.

A joint role is the joint's centre: ``pelvis`` is the middle of the hips, ``head`` the joint at the skull's
base (or the only head point), ``hand`` the knuckles, ``toe`` the ball of the foot, ``toe_tip`` the tip of the
toes, ``heel`` the back of the sole, ``head_top`` the vertex.
"""

ROLE_INDEX: Final[Mapping[str, int]] = {role: i for i, role in enumerate(ROLES)}
N_ROLES: Final = len(ROLES)

SIDES: Final = ("left", "right")
"""Order of every two-sided array (contact, support)."""

SEGMENTS: Final[Mapping[str, tuple[str, str]]] = {
    "torso": ("mid_hip", "mid_shoulder"),
    "left_upper_arm": ("left_shoulder", "left_elbow"),
    "right_upper_arm": ("right_shoulder", "right_elbow"),
    "left_forearm": ("left_elbow", "left_wrist"),
    "right_forearm": ("right_elbow", "right_wrist"),
    "left_thigh": ("left_hip", "left_knee"),
    "right_thigh": ("right_hip", "right_knee"),
    "left_shank": ("left_knee", "left_ankle"),
    "right_shank": ("right_knee", "right_ankle"),
}
"""The nine main segments: name -> (proximal point, distal point). ``mid_hip`` and ``mid_shoulder`` are the
middles of the hip and of the shoulder joint centres."""


def read_only(array: AnyArray) -> AnyArray:
    """Return the array after switching its write flag off (no copy)."""
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class Skeleton:
    """The constant facts about the human of a recording.

    Attributes:
        name: Which skeleton this is, e.g. ``cmu_motionbuilder``.
        roles: The roles that the source provides.
        rest_position: Role positions in the skeleton's rest pose, shape (R, 3) [m]; facing +x, z up, NaN where
            a role is unknown. The rest pose is where every joint orientation is the identity.
        height_m: Stature estimated from the skeleton [m].
        ankle_height_m: Height of the ankle joint centres over the floor when standing flat [m].
        toe_height_m: Height of the toe joints over the floor when standing flat [m].
        mass_kg: Body mass [kg].
        sex: ``male`` or ``female``; chooses the mass model.
        marker_names: Names of the markers, in the order of ``HumanFrame.marker``.
        target_names: Names of the rigid 6-dof targets, in the order of ``HumanFrame.target``.
        notes: What was found or assumed (unit, up axis, dropped frames), for the report.
    """

    name: str
    roles: frozenset[str]
    rest_position: Array
    height_m: float
    ankle_height_m: float = 0.08
    toe_height_m: float = 0.02
    mass_kg: float = 70.0
    sex: str = "male"
    marker_names: Sequence[str] = ()
    target_names: Sequence[str] = ()
    notes: Sequence[str] = field(default_factory=tuple)

    def has(self, *roles: str) -> bool:
        """Tell whether every role given is provided."""
        return self.roles.issuperset(roles)


@dataclass(slots=True)
class Support:
    """Which feet of the human are in contact with the floor."""

    left: bool
    right: bool

    @property
    def double(self) -> bool:
        """Both feet stand."""
        return self.left and self.right

    @property
    def none(self) -> bool:
        """No foot stands."""
        return not (self.left or self.right)


@dataclass(slots=True)
class HumanFrame:
    """One instant of the human. Arrays are read-only once passed on; a filter binds new ones.

    Attributes:
        time_s: Time from the start of the recording [s].
        position: Role positions in world, shape (R, 3) [m]; NaN where not valid.
        valid: Which roles are known in this frame, shape (R,).
        orientation: Rotation of the segment that starts at each role, world from segment, shape (R, 3, 3), the
            identity in the rest pose facing +x; NaN where not known. ``None`` when the source has none.
        marker: Marker positions in world, shape (M, 3) [m], and ``marker_valid`` (M,).
        target: Poses of rigid 6-dof targets, world from target, shape (K, 4, 4), and ``target_valid`` (K,).
        com: Centre of mass in world, shape (3,) [m], once a filter or the source has it.
        support: The feet in contact, once a filter or the source knows.
    """

    time_s: float
    position: Array
    valid: BoolArray
    orientation: Array | None = None
    marker: Array | None = None
    marker_valid: BoolArray | None = None
    target: Array | None = None
    target_valid: BoolArray | None = None
    com: Array | None = None
    support: Support | None = None


STATUS: Final = ("ok", "held", "stopped")
"""States of a command, in the order of the integers in ``Configuration.status``."""


@dataclass(slots=True)
class Configuration:
    """The robot's configuration in a frame, as it leaves a stage.

    Attributes:
        q: Pinocchio configuration of the floating-base model, shape (nq,): base position [m], base quaternion
            x y z w, joint positions [rad or m].
        contact: The feet that the robot stands on (left, right), shape (2,).
        status: Index into ``STATUS``.
        sent: The last command that left the guard, shape (nq,); ``None`` before the first. Stages read it.
    """

    q: Array
    contact: BoolArray
    status: int = 0
    sent: Array | None = None
