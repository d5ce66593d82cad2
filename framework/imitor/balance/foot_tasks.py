"""Writing where a foot shall be into whatever tasks the mapper has declared for it."""

from __future__ import annotations

import numpy as np

from imitor.robot.model import RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.types import SIDES, Array

FLAT_FREE_YAW = (True, True, True, True, True, False)
FLAT = (True,) * 6


class FootTasks:
    """One foot's tasks in world: the pose ``*_foot`` of its sole, or its place with ``*_sole``; in the air ``*_ankle``.

    Args:
        robot: The robot, left at its standing posture.
        side: 0 is left.

    Attributes:
        role, ankle_role, hip_role: Roles of the robot's frames of sole, ankle and hip.
        sole_to_ankle: The ankle in the sole's frame, shape (3,) [m].
        corners: Corners of the sole in its frame, shape (K, 3) [m].
    """

    def __init__(self, robot: RobotModel, side: int) -> None:
        name = SIDES[side]
        self._robot = robot
        self.role, self.ankle_role, self.hip_role = f"{name}_foot", f"{name}_ankle", f"{name}_hip"
        self._sole = f"{name}_sole"
        robot.update(robot.standing)
        self.sole_to_ankle: Array = robot.rotation(self.role).T @ (
            robot.position(self.ankle_role) - robot.position(self.role)
        )
        self.corners: Array = robot.sole[side]

    def wished_ankle(self, stack: TaskStack) -> Array:
        """Return where the mapper would have the ankle, in world, shape (3,) [m]."""
        if self.ankle_role in stack and stack[self.ankle_role].active[0]:
            return stack[self.ankle_role].target.copy()
        task = stack[self.role]
        if task.kind is TaskKind.POSE:
            return np.asarray(task.target[:3, :3] @ self.sole_to_ankle + task.target[:3, 3])
        robot = self._robot
        return np.asarray(task.target + robot.position(self.ankle_role) - robot.position(task.frame))

    def wished_yaw(self, stack: TaskStack) -> float:
        """Return the heading the mapper would give the foot [rad]."""
        task = stack[self.role]
        if task.kind is not TaskKind.POSE and self._sole in stack:
            task = stack[self._sole]
        if task.target.ndim != 2:
            return 0.0
        return float(np.arctan2(task.target[1, 0], task.target[0, 0]))

    def stand(self, stack: TaskStack, pose: Array, *, free_yaw: bool) -> None:
        """Ask for a pose of the sole, world from sole, shape (4, 4): all of it, or all but its heading."""
        task = stack[self.role]
        if task.kind is TaskKind.POSE:
            self._switch(stack, foot=True, air=False, sole=False)
            task.target[:] = pose
            task.mask[:] = FLAT_FREE_YAW if free_yaw else FLAT
            return
        self._switch(stack, foot=True, air=False, sole=True)
        lead = 0.0 if task.frame == self.role else pose[:3, :3] @ self.sole_to_ankle
        task.target[:] = pose[:3, 3] + lead
        if self._sole in stack:
            sole = stack[self._sole]
            sole.target[:] = pose[:3, :3]
            sole.mask[:] = (True, True, not free_yaw)

    def swing(self, stack: TaskStack, ankle: Array) -> None:
        """Ask for the place of the ankle alone, in world, shape (3,) [m]; how the sole is turned stays the mapper's."""
        if self.ankle_role in stack:
            self._switch(stack, foot=False, air=True, sole=True)
            stack[self.ankle_role].target[:] = ankle
            stack[self.ankle_role].mask[:] = True
            return
        task = stack[self.role]
        if task.kind is TaskKind.POSE:
            self._switch(stack, foot=True, air=False, sole=True)
            task.target[:3, 3] = ankle - self._robot.rotation(self.role) @ self.sole_to_ankle
            task.mask[:] = (True, True, True, False, False, False)
            return
        self._switch(stack, foot=True, air=False, sole=True)
        robot = self._robot
        task.target[:] = ankle + robot.position(task.frame) - robot.position(self.ankle_role)

    def release(self, stack: TaskStack) -> None:
        """Ask for nothing: the foot is the anchor."""
        self._switch(stack, foot=False, air=False, sole=False)

    def over_floor(self, clearance: float) -> float:
        """Return how high the ankle must be for the sole, turned as it is, to clear the floor by so much [m]."""
        up = self._robot.rotation(self.role)[2]
        return float(up @ self.sole_to_ankle) - float((self.corners @ up).min()) + clearance

    def _switch(self, stack: TaskStack, *, foot: bool, air: bool, sole: bool) -> None:
        for name, on in ((self.role, foot), (self.ankle_role, air), (self._sole, sole)):
            if name in stack:
                stack[name].active[0] = on
