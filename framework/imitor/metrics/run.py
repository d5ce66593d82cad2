"""A finished run as the figures see it: motion, reference, robot, and what several figures need."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.errors import SourceError
from imitor.metrics.kinematics import Kinematics, fresh_model
from imitor.metrics.polygon import Point, convex_hull
from imitor.record import MOTION_FILE, REFERENCE_FILE, Motion, Reference
from imitor.types import SEGMENTS, Array, BoolArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

TOUCH_M: Final = 0.003
"""A sole corner this low touches the floor (z = 0), and one deeper than this below it is sunk [m]."""


class Run:
    """Motion, reference and robot of a finished run.

    Args:
        motion: What the robot was told.
        reference: What it was meant to do, the same frames.
        robot: Whose card, files and limits count; its kinematics are not used.
        collision_every: Look for self-collision in every so many-th frame; 0 leaves it out, ``None`` chooses
            at most 50 frames a second.

    Raises:
        SourceError: Motion and reference do not fit together or hold numbers that are none.

    Attributes:
        q: Joint positions, shape (T, n) [rad].
        lower, upper, speed, acceleration: Limits of the joints in the motion's order, shape (n,).
    """

    def __init__(
        self, motion: Motion, reference: Reference, robot: RobotModel, collision_every: int | None = None
    ) -> None:
        _check(motion, reference)
        self.motion, self.reference, self.robot = motion, reference, robot
        self.collision_every = collision_every
        self.q: Array = np.asarray(motion.joint_position_rad, dtype=float)
        self.model: Any = fresh_model(robot.card, robot.files)
        self.kinematics = Kinematics(robot.card, self.model)
        self.path = self.kinematics.follow(motion)
        order = [robot.joint_index(name, "motion.joint_names") for name in motion.joint_names]
        self.lower, self.upper = robot.lower[order], robot.upper[order]
        self.speed, self.acceleration = robot.speed[order], robot.acceleration[order]

    def __len__(self) -> int:
        return len(self.motion)

    @cached_property
    def period_s(self) -> float:
        """Time between two frames at the output rate: the median difference of the time stamps [s]."""
        return float(np.median(np.diff(self.motion.time_s))) if len(self) > 1 else float("nan")

    # ------------------------------------------------------------------ the human

    def human_has(self, role: str) -> BoolArray:
        """Return in which frames a human point is known, shape (T,); ``mid_*`` needs both sides."""
        if role.startswith("mid_"):
            return self.human_has(f"left_{role[4:]}") & self.human_has(f"right_{role[4:]}")
        names = list(self.reference.role_names)
        if role not in names:
            return np.zeros(len(self), dtype=bool)
        known = np.asarray(self.reference.role_valid[:, names.index(role)], dtype=bool)
        return np.asarray(known & np.isfinite(self.reference.role(role)).all(axis=1))

    def human_vector(self, start: str, end: str) -> Array:
        """Return the vector between two human points, shape (T, 3) [m]; NaN where one is not known."""
        known = self.human_has(start) & self.human_has(end)
        out = np.full((len(self), 3), np.nan)
        if known.any():
            out[known] = (self.reference.role(end) - self.reference.role(start))[known]
        return out

    @cached_property
    def human_direction(self) -> dict[str, Array]:
        """Segment -> unit vector of the human's segment in world, shape (T, 3); NaN where not known."""
        return {name: unit(self.human_vector(*ends)) for name, ends in SEGMENTS.items()}

    # ------------------------------------------------------------------ the robot

    def robot_lacks(self, *roles: str) -> list[str]:
        """Return which of these roles the robot has no point for."""
        return [r for r in roles if r not in self.path.point]

    def robot_vector(self, start: str, end: str) -> Array:
        """Return the vector between two of the robot's role points, shape (T, 3) [m]."""
        return np.asarray(self.path.point[end] - self.path.point[start])

    @cached_property
    def touching(self) -> BoolArray:
        """Which sole corners touch the floor or lie below it, shape (T, 2, K)."""
        return np.asarray(self.path.sole[..., 2] <= TOUCH_M)

    @cached_property
    def foot_touching(self) -> BoolArray:
        """Which feet touch the floor with a corner, shape (T, 2)."""
        return np.asarray(self.touching.any(axis=2))

    @cached_property
    def support_polygon(self) -> list[list[Point]]:
        """Convex hull of the touching corners in every frame; no corner in flight."""
        corners = self.path.sole[..., :2].reshape(len(self), -1, 2).tolist()
        touching = self.touching.reshape(len(self), -1).tolist()
        return [
            convex_hull([(x, y) for (x, y), on in zip(points, flags, strict=True) if on])
            for points, flags in zip(corners, touching, strict=True)
        ]


def unit(vector: Array) -> Array:
    """Return unit vectors, shape (T, 3); NaN for a vector without length."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    length[length < 1e-9] = np.nan
    return np.asarray(vector / length)


def _check(motion: Motion, reference: Reference) -> None:
    if len(motion) != len(reference.time_s):
        raise SourceError(
            REFERENCE_FILE,
            f"{len(reference.time_s)} frames, but {MOTION_FILE} has {len(motion)}; both are of one run",
        )
    if not len(motion):
        raise SourceError(MOTION_FILE, "there is no frame in it; nothing can be measured")
    numbers = np.hstack([motion.root_position_m, motion.root_quaternion_wxyz, motion.joint_position_rad])
    bad = np.flatnonzero(~np.isfinite(numbers).all(axis=1) | ~np.isfinite(motion.time_s))
    if bad.size:
        raise SourceError(
            MOTION_FILE, f"frame {bad[0]} holds a number that is not finite ({bad.size} such frames)"
        )
    back = np.flatnonzero(np.diff(motion.time_s) <= 0)
    if back.size:
        raise SourceError(MOTION_FILE, f"time does not increase from frame {back[0]} to frame {back[0] + 1}")
