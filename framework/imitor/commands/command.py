"""What a robot is told at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from imitor.types import Array, BoolArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

N_BASE: Final = 7
"""Numbers before the joints in a configuration: base position and quaternion."""
_N_TWIST: Final = 6


@dataclass(slots=True)
class Command:
    """One command, written over from instant to instant; a sink copies what it keeps.

    Attributes:
        index: Counts the commands from 0.
        time_s: Time of the frame [s].
        q: Configuration: base position [m], base quaternion x y z w, joint positions [rad or m], shape (nq,).
        v: Velocity since the command before, shape (nv,): of the base in the base frame, linear [m/s], then angular
            [rad/s]; of the joints [rad/s or m/s].
        contact: The feet that the robot stands on (left, right), shape (2,).
        status: Index into `imitor.types.STATUS`.
    """

    index: int
    time_s: float
    q: Array
    v: Array
    contact: BoolArray
    status: int = 0

    @classmethod
    def of(cls, robot: RobotModel) -> Command:
        """Return a command for the standing robot at rest."""
        return cls(-1, 0.0, robot.standing.copy(), np.zeros(robot.nv), np.ones(2, dtype=bool))

    @property
    def joints(self) -> Array:
        """View of the joint positions, shape (n,) [rad]."""
        return self.q[N_BASE:]

    @property
    def joint_speeds(self) -> Array:
        """View of the joint velocities, shape (n,) [rad/s]."""
        return self.v[_N_TWIST:]


__all__ = ["N_BASE", "Command"]
