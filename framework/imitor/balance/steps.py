"""Where the human's feet are to each other, in the robot's size: what a landing place is proportional to."""

from __future__ import annotations

from math import hypot

import numpy as np

from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SIDES, Array, HumanFrame


class HumanSteps:
    """The human's ankles, each where it stands or last stood; legs and hips measured as the mean of the frames so far.

    A robot that is late with a step places its foot as the human's feet stood, though one may have left again.
    """

    def __init__(self, robot: RobotModel) -> None:
        lengths = robot.segment_lengths()
        self._robot_leg = 0.5 * sum(lengths[f"{s}_{part}"] for s in SIDES for part in ("thigh", "shank"))
        self._robot_hips = lengths["hips"]
        self._index = np.array([ROLE_INDEX[f"{s}_{r}"] for s in SIDES for r in ("hip", "knee", "ankle")])
        self.reset()

    def reset(self) -> None:
        """Forget the person: legs together in the robot's size."""
        self._at = np.array([[0.0, 0.5 * self._robot_hips], [0.0, -0.5 * self._robot_hips]])
        self._lateral = np.array([0.0, 1.0])
        self._seen, self._stood = [False, False], [False, False]
        self._sum = np.zeros(2)
        self._count = 0

    def take(self, frame: HumanFrame) -> None:
        """Read a frame; points that are not seen keep what they were."""
        known = frame.valid[self._index]
        points = frame.position[self._index]
        if known.all():
            bones = np.diff(points.reshape(2, 3, 3), axis=1)
            across = points[0] - points[3]
            leg = 0.5 * float(np.linalg.norm(bones, axis=2).sum())
            if leg > 1e-3:
                self._sum += (leg, float(np.linalg.norm(across)))
                self._count += 1
            flat = hypot(float(across[0]), float(across[1]))
            if flat > 1e-3:
                self._lateral = across[:2] / flat
        stands = (True, True) if frame.support is None else (frame.support.left, frame.support.right)
        for i, ankle in enumerate((2, 5)):
            if known[ankle] and (stands[i] or not self._stood[i]):
                self._at[i] = points[ankle, :2]
                self._seen[i] = True
                self._stood[i] |= stands[i]

    def between(self, i: int) -> Array:
        """Return the way from the other ankle to this one in the robot's size, horizontally, shape (2,) [m].

        Lengths are scaled by the legs; sideways, the robot's hips take the place of the human's.
        """
        if self._count == 0:
            leg, hips = self._robot_leg, self._robot_hips
        else:
            leg, hips = (self._sum / self._count).tolist()
        ratio = self._robot_leg / leg
        sign = 1.0 if i == 0 else -1.0
        if not all(self._seen):
            return np.asarray(sign * self._robot_hips * self._lateral)
        way = self._at[i] - self._at[1 - i]
        return np.asarray(ratio * way + sign * (self._robot_hips - ratio * hips) * self._lateral)
