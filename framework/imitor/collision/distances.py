r"""Distances of the pairs that may be near: bounds carried from frame to frame, then python-fcl.

Two convex shapes whose distance was :math:`d` are at least :math:`d - s_a - s_b` apart after no point of them
moved by more than :math:`s`. A shape turned by :math:`\theta` about the centre of its bounding sphere of radius
:math:`r`, which moved by :math:`c`, has :math:`s \le c + r\,\|R - R'\|_F / \sqrt 2`. Only pairs whose bound falls
below what is asked for are measured again, so that a calm robot costs a few array operations. Motion counts in the
base's frame, where a walking robot's trunk stands still; what is returned does not depend on the history.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from imitor.collision.shapes import Shapes
from imitor.types import Array, IntArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


class Distances:
    """Signed distances of a robot's pairs at the configuration of its last update.

    Args:
        robot: The robot.
        shapes: Its shapes.

    Attributes:
        shapes: The shapes.
        measured: How many pairs the last `below` measured.
    """

    def __init__(self, robot: RobotModel, shapes: Shapes) -> None:
        import fcl

        self._fcl, self.shapes, self.measured = fcl, shapes, 0
        self._rotations = [robot.data.oMi[int(j)].rotation for j in shapes.joint]
        self._translations = [robot.data.oMi[int(j)].translation for j in shapes.joint]
        self._base = robot.data.oMi[1]
        self._first, self._second = shapes.pairs[:, 0], shapes.pairs[:, 1]
        self._reach = shapes.radius[self._first] + shapes.radius[self._second]
        self._request = fcl.DistanceRequest(True, True)
        self._world_R, self._world_p = np.zeros((2, 0)), np.zeros((2, 0))
        self.reset()

    def reset(self) -> None:
        """Forget earlier distances."""
        self._bound: Array = np.full(len(self.shapes.pairs), -np.inf)
        self._last: tuple[Array, Array] | None = None

    def below(self, distance: float) -> tuple[IntArray, Array, Array, Array]:
        """Return pairs nearer than a distance [m].

        Returns:
            Their indices (K,), signed distances (K,) [m], unit normals from the second to the first shape (K, 3) in
            world, and points between the two (K, 3) [m] in world.
        """
        s = self.shapes
        R, p = np.array(self._rotations), np.array(self._translations)
        centre = (R @ s.centre[:, :, None])[:, :, 0] + p
        turn, origin = self._base.rotation, self._base.translation
        C, B = (centre - origin) @ turn, turn.T @ R
        if self._last is not None:
            moved = np.sqrt(((C - self._last[0]) ** 2).sum(axis=1))
            moved += s.radius * np.sqrt(((B - self._last[1]) ** 2).sum(axis=(1, 2)) / 2.0)
            self._bound -= moved[self._first] + moved[self._second]
        self._last = (C, B)
        gap = C[self._first] - C[self._second]
        apart = np.sqrt(np.einsum("ij,ij->i", gap, gap)) - self._reach
        candidates = np.flatnonzero(np.maximum(apart, self._bound) < distance)
        self.measured = len(candidates)
        found, values, normals, points = [], [], [], []
        if candidates.size:
            self._move(np.unique(s.pairs[candidates]), R, p)
        for k in candidates.tolist():
            d, n, x = self._measure(k)
            self._bound[k] = d
            if d < distance:
                found.append(k)
                values.append(d)
                normals.append(n)
                points.append(x)
        shape = (len(found), 3)
        return (
            np.array(found, dtype=int),
            np.array(values),
            np.array(normals).reshape(shape),
            np.array(points).reshape(shape),
        )

    def _move(self, shapes: IntArray, R: Array, p: Array) -> None:
        s = self.shapes
        world_R = R[shapes] @ s.rotation[shapes]
        world_p = (R[shapes] @ s.translation[shapes][:, :, None])[:, :, 0] + p[shapes]
        for i, rotation, translation in zip(shapes.tolist(), world_R, world_p, strict=True):
            s.objects[i].setTransform(self._fcl.Transform(rotation, translation))

    def _measure(self, pair: int) -> tuple[float, Array, Array]:
        i, j = self.shapes.pairs[pair]
        result: Any = self._fcl.DistanceResult()
        a, b = self.shapes.objects[i], self.shapes.objects[j]
        d = float(self._fcl.distance(a, b, self._request, result))
        near, far = (np.asarray(x) for x in result.nearest_points)
        normal = near - far
        length = float(np.linalg.norm(normal))
        if length > 1e-9:
            normal = normal / (length if d >= 0.0 else -length)
        else:  # just touching: apart along the line of the centres
            normal = np.asarray(a.getTranslation()) - np.asarray(b.getTranslation())
            normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
        return d, normal, 0.5 * (near + far)
