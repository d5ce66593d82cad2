r"""The guard: no command leaves the framework that is not finite, within limits, and within speed and acceleration.

A step that is too large is scaled as a whole, never joint by joint, since that would move feet and CoM: the step
sent is :math:`b + s\,(d - b)` with the wanted step :math:`d`, the braking step :math:`b` (the smallest step that the
acceleration limits allow; 0 without them) and the largest :math:`s \in [0, 1]` that keeps every joint within its
bounds. A joint's bounds are its speed limit, its last step plus or minus the acceleration limit, and the largest step
from which it can still stop before its position limit. The anchor is re-placed afterwards, and what left the guard is
the next frame's start.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from imitor.robot.model import BASE_NQ, RobotModel
from imitor.tasks import TaskStack
from imitor.types import STATUS, Array, Configuration

HELD = STATUS.index("held")
_SLACK = 1e-12


@dataclass
class GuardReport:
    """How often the guard had to act [frames]."""

    scaled: int = 0
    not_finite: int = 0


class Guard:
    """Keeps the commands of one run within the robot's limits.

    Args:
        robot: The robot; its `update` is called when a command is changed.
        dt_s: Time between commands at the output rate [s].
    """

    def __init__(self, robot: RobotModel, dt_s: float) -> None:
        self._robot = robot
        self._speed_step = robot.speed * dt_s
        self._acceleration_step = robot.acceleration * dt_s * dt_s
        self._has_acceleration = bool(np.isfinite(robot.acceleration).any())
        self.reset()

    def reset(self) -> None:
        """Forget the last command."""
        self._last: Array | None = None
        self._last_step: Array = np.zeros(self._robot.n)
        self.report = GuardReport()

    def follow(self, sent: Array) -> tuple[Array, Array]:
        """Take the last command from elsewhere, shape (nq,), and return the range of the next one's joints, (n,) each.

        A stage that must know what will leave the guard has one of its own, and tells it what was sent.
        """
        if self._last is not None:
            self._last_step = sent[BASE_NQ:] - self._last[BASE_NQ:]
        self._last = sent.copy()
        joints = self._last[BASE_NQ:]
        low, high = self._bounds(joints)
        return joints + low, joints + high

    def apply(self, stack: TaskStack, state: Configuration) -> None:
        """Make ``state.q`` a safe command in place, and leave the robot updated at it."""
        robot, q, last = self._robot, state.q, self._last
        if not isfinite(q.dot(q)):
            self.report.not_finite += 1
            state.status = HELD
            q[:] = robot.standing if last is None else last
            robot.update(q)
        joints = q[BASE_NQ:]
        if last is None:
            if (joints < robot.lower).any() or (joints > robot.upper).any():
                np.clip(joints, robot.lower, robot.upper, out=joints)
                robot.update(q)
                if stack.anchor:
                    robot.place(q, stack.anchor, stack.anchor_pose)
            self._last = q.copy()
            return
        previous = last[BASE_NQ:]
        wanted = joints - previous
        low, high = self._bounds(previous)
        outside = (wanted > high + _SLACK) | (wanted < low - _SLACK)
        if outside.any():
            self._scale(stack, q, last, wanted, low, high)
        np.maximum(joints, robot.lower, out=joints)
        np.minimum(joints, robot.upper, out=joints)
        np.subtract(joints, previous, out=self._last_step)
        last[:] = q

    def _bounds(self, joints: Array) -> tuple[Array, Array]:
        robot, speed = self._robot, self._speed_step
        up, down = robot.upper - joints, joints - robot.lower
        if not self._has_acceleration:
            return -np.minimum(speed, down), np.minimum(speed, up)
        A = self._acceleration_step
        low = np.maximum(-np.minimum(speed, _stoppable(down, A)), self._last_step - A)
        high = np.minimum(np.minimum(speed, _stoppable(up, A)), self._last_step + A)
        return np.minimum(low, high), high

    def _scale(self, stack: TaskStack, q: Array, last: Array, wanted: Array, low: Array, high: Array) -> None:
        robot = self._robot
        self.report.scaled += 1
        brake = np.clip(0.0, low, high)
        rest = wanted - brake
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(rest > 0, (high - brake) / rest, np.where(rest < 0, (low - brake) / rest, 1.0))
        s = float(np.clip(share.min(), 0.0, 1.0))
        robot_q = robot.interpolate(last, q, s)
        q[:BASE_NQ] = robot_q[:BASE_NQ]
        q[BASE_NQ:] = last[BASE_NQ:] + np.clip(brake + s * rest, low, high)
        robot.update(q)
        if stack.anchor:
            robot.place(q, stack.anchor, stack.anchor_pose)


def _stoppable(distance: Array, A: Array) -> Array:
    """Return the largest step from which steps shrinking by A end within a distance.

    From h = k A + r (0 <= r < A) the steps to the end add up to h + k r + A k (k - 1) / 2: linear in h between
    multiples of A, and A k (k + 1) / 2 at h = k A. This is its inverse.
    """
    D = np.maximum(distance, 0.0)
    finite = np.isfinite(A)
    A = np.where(finite, A, 1.0)
    k = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * D / A) - 1.0))
    return np.where(finite, k * A + (D - 0.5 * A * k * (k + 1.0)) / (k + 1.0), D)
