r"""Distances of the pairs that may be near: bounds carried from frame to frame, then python-fcl.

Two convex shapes whose distance was :math:`d` are at least :math:`d - s_a - s_b` apart after no point of them
moved by more than :math:`s`. A shape turned by :math:`\theta` about the centre of its bounding sphere of radius
:math:`r`, which moved by :math:`c`, has :math:`s \le c + r\,\|R - R'\|_F / \sqrt 2`. Only pairs whose bound falls
below what is asked for are measured again, so that a calm robot costs a few array operations. Motion counts in the
base's frame, where a walking robot's trunk stands still; what is returned does not depend on the history.

Shapes apart are measured by GJK. Overlapping ones are measured along a direction :math:`n`: the gap
:math:`\min_a n^T a - \max_b n^T b` over the points of the two is, for every n, no more than the signed distance. Tried
are the direction in which they were apart last, so that a link goes back on the side where it came from, and that of
python-fcl's portal refinement; the better one is then turned towards larger gaps. What GJK says is checked by the gap
along its own direction, which is the distance if it is right.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.collision.shapes import Shapes
from imitor.types import Array, IntArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


_DOUBT_M: Final = 0.003
"""A distance is not believed if the gap along its direction is smaller by more than this [m]."""
_HALF_ROOT: Final = math.sqrt(0.5)
_NOTHING: Final = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
_TURNS: Final = (0.5, 0.25, 0.12, 0.06, 0.03)
"""By how much a direction is turned towards larger gaps, one after the other [rad]."""


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
        self._shift: Array = np.zeros((len(shapes.links), 3))
        self._first, self._second = shapes.pairs[:, 0], shapes.pairs[:, 1]
        self._reach = shapes.radius[self._first] + shapes.radius[self._second]
        self._request = fcl.DistanceRequest(True, False)
        self._overlap = fcl.CollisionRequest(num_max_contacts=1, enable_contact=True)
        self._world_R, self._world_p = np.zeros((2, 0)), np.zeros((2, 0))
        self.reset()

    def reset(self) -> None:
        """Forget earlier distances."""
        self._bound: Array = np.full(len(self.shapes.pairs), -np.inf)
        self._last: tuple[Array, Array] | None = None
        self._fresh: dict[int, tuple[float, Array, Array]] = {}
        self._apart: dict[int, Array] = {}

    def move_objects(self, shift: Array) -> None:
        """Tell how far each object of the environment was moved from where it is written, shape (K, 3) [m]."""
        n = self.shapes.n_objects
        if n and len(shift) == n:
            self._shift[-n:] = shift

    def below(self, distance: float | Array) -> tuple[IntArray, Array, Array, Array]:
        """Return pairs nearer than a distance [m], the same for all or one a pair, (P,).

        Returns:
            Their indices (K,), signed distances (K,) [m], unit normals from the second to the first shape (K, 3) in
            world, and points between the two (K, 3) [m] in world.
        """
        s = self.shapes
        R, p = np.array(self._rotations), np.array(self._translations) + self._shift
        centre = (R @ s.centre[:, :, None])[:, :, 0] + p
        turn, origin = self._base.rotation, self._base.translation
        C, B = (centre - origin) @ turn, (turn.T @ R).reshape(-1, 9)
        if self._last is not None:
            moved = _norms(C - self._last[0]) + s.radius * _norms(B - self._last[1]) * _HALF_ROOT
            if moved.any():
                self._bound -= moved[self._first] + moved[self._second]
                self._fresh.clear()
        self._last = (C, B)
        apart = _norms(C[self._first] - C[self._second]) - self._reach
        candidates = np.flatnonzero(np.maximum(apart, self._bound) < distance)
        self.measured = 0
        if not len(candidates):
            return candidates, *_NOTHING
        new = [k for k in candidates.tolist() if k not in self._fresh]
        self.measured = len(new)
        if new:
            self._move(np.unique(s.pairs[new]), R, p)
        for k in new:
            self._fresh[k] = self._measure(k)
            self._bound[k] = self._fresh[k][0]
        asked = distance[candidates] if isinstance(distance, np.ndarray) else distance
        found = candidates[self._bound[candidates] < asked]
        if not len(found):
            return found, *_NOTHING
        d, normals, points = zip(*(self._fresh[k] for k in found.tolist()), strict=True)
        return found, np.array(d), np.array(normals), np.array(points)

    def _move(self, shapes: IntArray, R: Array, p: Array) -> None:
        s = self.shapes
        world_R = R[shapes] @ s.rotation[shapes]
        world_p = (R[shapes] @ s.translation[shapes][:, :, None])[:, :, 0] + p[shapes]
        for i, rotation, translation in zip(shapes.tolist(), world_R, world_p, strict=True):
            s.objects[i].setTransform(self._fcl.Transform(rotation, translation))

    def _measure(self, pair: int) -> tuple[float, Array, Array]:
        i, j = self.shapes.pairs[pair]
        a, b = self.shapes.objects[i], self.shapes.objects[j]
        result: Any = self._fcl.DistanceResult()
        d = float(self._fcl.distance(a, b, self._request, result))
        if d > 0.0:
            near, far = result.nearest_points
            normal = near - far
            length = math.sqrt(float(normal @ normal))
            if length > 1e-9:
                normal, point = normal / length, 0.5 * (near + far)
                if d - self._gap(pair, a, b, normal) > _DOUBT_M:  # it happens with parallel faces
                    return self._along(pair, a, b, [normal], point)
                self._apart[pair] = b.getRotation().T @ normal
                return d, normal, point
        return self._depth(pair, a, b)

    def _gap(self, pair: int, a: Any, b: Any, n: Array) -> float:
        """Return the gap between two shapes along a direction [m]: no more than their distance."""
        i, j = self.shapes.pairs[pair]
        first = self.shapes.corners[i] @ (a.getRotation().T @ n)
        second = self.shapes.corners[j] @ (b.getRotation().T @ n)
        between = (a.getTranslation() - b.getTranslation()) @ n
        thick = self.shapes.thickness[i] + self.shapes.thickness[j]
        return float(between + first.min() - second.max() - thick)

    def _depth(self, pair: int, a: Any, b: Any) -> tuple[float, Array, Array]:
        """Measure a pair that overlaps; ``a`` and ``b`` are its objects."""
        p, q = np.asarray(a.getTranslation()), np.asarray(b.getTranslation())
        point, tried = 0.5 * (p + q), [(p - q) / max(float(np.linalg.norm(p - q)), 1e-9)]
        found: Any = self._fcl.CollisionResult()
        if self._fcl.collide(a, b, self._overlap, found):
            contact = found.contacts[0]
            point, tried = np.asarray(contact.pos), [-np.asarray(contact.normal)]
        return self._along(pair, a, b, tried, point)

    def _along(
        self, pair: int, a: Any, b: Any, tried: list[Array], point: Array
    ) -> tuple[float, Array, Array]:
        """Measure a pair along the best of some directions and the last known one, turned towards larger gaps."""
        if pair in self._apart:
            tried.append(b.getRotation() @ self._apart[pair])
        first, second = self._points(pair, 0, a), self._points(pair, 1, b)
        i, j = self.shapes.pairs[pair]
        thick = self.shapes.thickness[i] + self.shapes.thickness[j]

        def gap(n: Array) -> tuple[float, Array]:
            along, against = first @ n, second @ n
            k, m = int(along.argmin()), int(against.argmax())
            return float(along[k] - against[m]) - thick, first[k] - second[m]

        best, normal = max(((gap(n), n) for n in tried), key=lambda x: x[0][0])
        for share in _TURNS:
            value, towards = best
            size = math.sqrt(float(towards @ towards))
            if size < 1e-9:
                break
            turned = normal + share * (towards - (towards @ normal) * normal) / size
            turned = turned / math.sqrt(float(turned @ turned))
            other = gap(turned)
            if other[0] > value:
                best, normal = other, turned
        self._apart[pair] = b.getRotation().T @ normal
        return best[0], normal, point

    def _points(self, pair: int, side: int, placed: Any) -> Array:
        """Return the corners of a shape of a pair in world, (K, 3)."""
        corners = self.shapes.corners[self.shapes.pairs[pair, side]]
        return np.asarray(corners @ placed.getRotation().T + placed.getTranslation())


def _norms(vectors: Array) -> Array:
    """Return the lengths of vectors, shape (K, D), as (K,)."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))
