"""What standing feet allow a correction to move."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imitor.tasks import TaskStack
from imitor.types import SIDES, Array, BoolArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


class Feet:
    """The joints that are free, and the rows that hold a sliding foot on the ground.

    Args:
        robot: The robot.
        release: Whether standing feet may move at all: a later stage sets them on the ground.
        slide: Whether a standing foot that is not the anchor may slide.
    """

    def __init__(self, robot: RobotModel, *, release: bool, slide: bool) -> None:
        self._robot, self._release, self._slide = robot, release, slide
        self._anchors = [f"{side}_foot" for side in SIDES]
        self._carried = [robot.ancestors(foot) for foot in self._anchors]
        self._at = [robot.position(foot) for foot in self._anchors]
        self._turn = [robot.rotation(foot) for foot in self._anchors]

    def sliding(self, stack: TaskStack) -> int | None:
        """Return which foot slides: 0 is the left one; ``None`` when none does."""
        if not self._slide or not stack.contact.all() or stack.anchor not in self._anchors:
            return None
        return 1 - self._anchors.index(stack.anchor)

    def free(self, stack: TaskStack) -> BoolArray:
        """Return the joints whose motion moves neither the anchor nor a foot that holds its place, (n,)."""
        robot, slides = self._robot, self.sliding(stack)
        held = np.zeros(robot.nv)
        for i, stands in enumerate(stack.contact.tolist()):
            if stands and not self._release and i != slides:
                held += self._carried[i]
        if stack.anchor:
            held += robot.ancestors(stack.anchor)
        return np.asarray(held[6:] == 0.0)

    def height_and_tilt(self, foot: int) -> Array:
        """Return a foot's height [m] and the x and y of its normal, (3,), at the robot's last update."""
        normal = self._turn[foot][:, 2]
        return np.array([self._at[foot][2], normal[0], normal[1]])

    def rows(self, foot: int) -> Array:
        """Return how height and normal change with the joints, (3, n)."""
        linear, angular = self._robot.jacobian[:3, 6:], self._robot.jacobian[3:, 6:]
        x, y, _ = self._at[foot]
        nx, ny, nz = self._turn[foot][:, 2]
        rows = np.vstack([
            linear[2] + angular[0] * y - angular[1] * x,
            angular[1] * nz - angular[2] * ny,
            angular[2] * nx - angular[0] * nz,
        ])  # fmt: skip
        return np.asarray(rows * self._carried[foot][6:])
