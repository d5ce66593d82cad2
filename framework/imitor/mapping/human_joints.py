"""The human's joint values in the robot's own joint structure, for eq. 8 of [pennapoubel2014] (P9)."""

from __future__ import annotations

from collections.abc import Sequence

from imitor.ik.pose import PoseFinder
from imitor.robot.model import RobotModel
from imitor.tasks import Task, TaskStack
from imitor.types import Array

_FIRST = 100
_WEIGHTS = {"waist": 0.3, "chest": 0.3, "left_sole": 0.3, "right_sole": 0.3}


class HumanJoints:
    """Joints that turn the robot's segments as the human's: no balance, no floor, no reach.

    Found on a twin of the robot with a free base, by one step a frame from the last one.

    Args:
        robot: The robot.
        tasks: Directions and orientations of a compiled stack, whose targets are read.
    """

    def __init__(self, robot: RobotModel, tasks: Sequence[Task]) -> None:
        self._tasks = tasks
        self._stack = TaskStack(robot.n)
        for task in tasks:
            self._stack.declare(task.name, task.kind, frame=task.frame, relative_to=task.relative_to)
        self._stack.compile()
        self._own = [self._stack[task.name] for task in tasks]
        names = [task.name for task in tasks]
        self._finder = PoseFinder(
            robot.twin(), self._stack, names, {n: w for n, w in _WEIGHTS.items() if n in names}
        )
        self._standing = robot.standing
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self._q = self._standing.copy()
        self._steps = _FIRST

    def step(self) -> Array:
        """Return the joint positions for the present targets, shape (n,) [rad]; a view, valid until the next."""
        for own, task in zip(self._own, self._tasks, strict=True):
            own.target[:] = task.target
        self._finder.improve(self._q, self._steps, tolerance=1e-3)
        self._steps = 1
        return self._q[7:]
