"""Whether both hands reach their grips from where the robot stands, and where it has to stand to do so (T11)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from imitor.ik.pose import PoseFinder
from imitor.robot.model import RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.types import SIDES, Array

_STEPS = 80
REACHED = 0.004
"""A pose is in the workspace when the hands get so near [m or rad]."""


class Workspace:
    """The workspace of both hands together with the pelvis held, by inverse kinematics within joint limits.

    Args:
        robot: The robot; a twin is moved.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot.twin()
        self._stack = TaskStack(robot.n)
        self._hands = [
            self._stack.declare(f"{s}_hand", TaskKind.POSE, frame=f"{s}_hand")
            for s in SIDES
            if robot.has(f"{s}_hand")
        ]
        self._stack.compile()
        self._stack.anchor = "waist"
        self._finder = PoseFinder(self._robot, self._stack, [t.name for t in self._hands], damping=0.005)
        straight = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        self._starts = (straight, robot.standing[7:], 0.5 * (robot.lower + robot.upper))

    def miss(self, pelvis: Array, hands: Sequence[Sequence[Array]]) -> float:
        """Return the largest error with which the robot gets to these poses in turn [m or rad].

        Args:
            pelvis: Pose of the waist, world from waist, shape (4, 4).
            hands: For each place a pose of each hand, shape (4, 4).
        """
        self._stack.anchor_pose[:] = pelvis
        return min(self._follow(start, hands) for start in self._starts)

    def _follow(self, joints: Array, hands: Sequence[Sequence[Array]]) -> float:
        q, worst = self._robot.standing.copy(), 0.0
        q[7:] = joints
        for poses in hands:
            for task, pose in zip(self._hands, poses, strict=False):
                task.target[:] = pose
            worst = max(worst, self._finder.improve(q, _STEPS, REACHED))
        return worst

    def nearest_placement(
        self, pelvis: Array, hands: Sequence[Sequence[Array]], reach_m: float = 0.5, rise_m: float = 0.0
    ) -> tuple[Array, float]:
        """Return the smallest shift of the pelvis from which the hands reach all, shape (3,) [m], and what it misses.

        Where there is none, the one that misses least.

        Args:
            pelvis, hands: As for `miss`.
            reach_m: How far it may go forward or back and aside [m].
            rise_m: How far it may be raised, on a pedestal [m].
        """
        steps = np.arange(-reach_m, reach_m + 1e-9, 0.05)
        up = np.arange(0.0, rise_m + 1e-9, 0.05)
        shifts = np.array(list(itertools.product(steps, (0.0,), up)))
        best, least = np.zeros(3), np.inf
        for shift in shifts[np.argsort(np.linalg.norm(shifts, axis=1), kind="stable")]:
            moved = pelvis.copy()
            moved[:3, 3] += pelvis[:3, :3] @ shift
            miss = self.miss(moved, hands)
            if miss < least:
                best, least = shift, miss
            if miss <= REACHED:
                break
        return best, least


__all__ = ["REACHED", "Workspace"]
