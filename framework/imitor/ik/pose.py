"""A pose for a few tasks, found beside the run: where a robot can put its foot, what its joints would be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from imitor.ik.clamping import clamped_step
from imitor.ik.rows import TaskRows
from imitor.robot.model import RobotModel
from imitor.tasks import TaskStack
from imitor.types import Array

_FLOOR2 = 1e-4
_MAX_STEP_RAD = 0.3


class PoseFinder:
    """Damped steps within joint limits on a robot of its own; an anchor is held exactly.

    Args:
        robot: The robot; a twin, so that the run's is not moved.
        stack: The compiled tasks.
        tasks: Names of the tasks to meet, all alike.
        weights: Weights by task name; 1 where not given.
        damping: Damping [-].
    """

    def __init__(
        self,
        robot: RobotModel,
        stack: TaskStack,
        tasks: Sequence[str],
        weights: Mapping[str, float] | None = None,
        damping: float = 0.02,
    ) -> None:
        self._robot, self._stack = robot, stack
        self._rows = TaskRows(robot, stack, [list(tasks)], dict(weights or {}))
        self._damping2 = damping**2
        S = robot.coupling
        self._coupling = np.eye(robot.n) if S is None else S
        self._independent = np.arange(robot.n) if S is None else S.argmax(axis=0)
        free = np.full(self._coupling.shape[1], np.inf)
        self._any_speed = (-free, free)

    def improve(self, q: Array, most: int, tolerance: float = 0.0) -> float:
        """Improve a configuration in place, shape (nq,), by at most so many steps.

        Returns:
            The largest error left [m or rad].
        """
        robot, stack = self._robot, self._stack
        robot.update(q)
        if stack.anchor:
            robot.place(q, stack.anchor, stack.anchor_pose)
        layout = self._rows.layout()
        for _ in range(most):
            self._rows.assemble(layout)
            if np.abs(layout.e).max(initial=0.0) <= tolerance:
                break
            joints, first = q[7:], layout.first
            J = np.hstack([layout.J[:, :first], layout.J[:, first:] @ self._coupling])
            pick = self._independent
            limits = ((robot.lower - joints)[pick], (robot.upper - joints)[pick])
            calm = [float(layout.e @ layout.e) + self._damping2]
            g = np.zeros(J.shape[1])
            step, _ = clamped_step(
                J, layout.e, g, [0], calm, _FLOOR2, limits, self._any_speed, first, _MAX_STEP_RAD
            )
            moved = np.concatenate([step[:first], self._coupling @ step[first:]])
            if first:
                q[:] = robot.integrate(q, moved)
            else:
                joints += moved
            np.clip(joints, robot.lower, robot.upper, out=joints)
            robot.update(q)
            if stack.anchor:
                robot.place(q, stack.anchor, stack.anchor_pose)
        self._rows.assemble(layout, jacobian=False)
        return float(np.abs(layout.e).max(initial=0.0))
