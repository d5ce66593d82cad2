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
_GRID_M = 0.025
"""Step between placements that are tried [m]; from the right ones hands reach all within a few centimetres."""
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
            (i, self._stack.declare(f"{s}_hand", TaskKind.POSE, frame=f"{s}_hand"))
            for i, s in enumerate(SIDES)
            if robot.has(f"{s}_hand")
        ]
        self._stack.compile()
        self._stack.anchor = "waist"
        self._finder = PoseFinder(self._robot, self._stack, [t.name for _, t in self._hands], damping=0.005)
        straight = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        self._starts = (straight, robot.standing[7:], 0.5 * (robot.lower + robot.upper))

    def miss(self, pelvis: Array, hands: Sequence[Array], enough: float = np.inf) -> float:
        """Return the largest error with which the robot gets to these poses in turn [m or rad].

        Args:
            pelvis: Pose of the waist, world from waist, shape (4, 4).
            hands: For each place the pose of the left and of the right hand, shape (2, 4, 4).
            enough: An error that ends the search for a way, for no smaller one is of interest [m or rad].
        """
        self._stack.anchor_pose[:] = pelvis
        return min(self._follow(start, hands, enough) for start in self._starts)

    def _follow(self, joints: Array, hands: Sequence[Array], enough: float) -> float:
        q, worst = self._robot.standing.copy(), 0.0
        q[7:] = joints
        for poses in hands:
            for side, task in self._hands:
                task.target[:] = poses[side]
            worst = max(worst, self._finder.improve(q, _STEPS, 0.5 * REACHED))
            if worst > enough:
                break
        return worst

    def nearest_placement(
        self, pelvis: Array, hands: Sequence[Array], reach_m: float = 0.5, rise_m: float = 0.0
    ) -> tuple[Array, float]:
        """Return the smallest shift of the pelvis from which the hands reach all, shape (3,) [m], and what it misses.

        Where there is none, the one that misses least.

        Args:
            pelvis, hands: As for `miss`.
            reach_m: How far it may go forward or back [m].
            rise_m: How far it may be raised [m].
        """
        n, up = round(reach_m / _GRID_M), np.arange(round(rise_m / _GRID_M) + 1) * _GRID_M
        shifts = np.array(list(itertools.product(np.arange(-n, n + 1) * _GRID_M, (0.0,), up)))
        best, least = np.zeros(3), np.inf
        for shift in shifts[np.argsort(np.linalg.norm(shifts, axis=1), kind="stable")]:
            moved = pelvis.copy()
            moved[:3, 3] += pelvis[:3, :3] @ shift
            miss = self.miss(moved, hands, least)
            if miss < least:
                best, least = shift, miss
            if miss <= REACHED:
                break
        return best, least


__all__ = ["REACHED", "Workspace"]
