r"""Moves a pose so that links are apart: the distances are linearised a few times, and the smallest motion is solved.

The distance of a pair with unit normal :math:`n` (from the second shape to the first) at the point :math:`p` changes
with the joints as :math:`\dot d = (w^T\,{}^0J) \odot (m_a - m_b)\,\dot q`, :math:`w = (n, p \times n)`, with
Pinocchio's world-frame spatial Jacobian and the masks :math:`m` of the joints that carry the two shapes. A pair that
was seen once stays in sight with its last row, and is measured again only where a step may have brought it near.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from imitor.collision.distances import Distances
from imitor.collision.feet import Feet, Kept
from imitor.collision.shapes import Shapes
from imitor.collision.smallest import smallest_motion
from imitor.ik.vectors import cross
from imitor.tasks import TaskStack
from imitor.types import Array, BoolArray, IntArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

_WATCH_M: Final = 0.015
"""Pairs this much farther than the margin are kept in sight while others are moved apart [m]."""
_AGAIN_M: Final = 0.002
"""Of these, only pairs this much farther than the margin are measured again after a step [m]."""
EXACT_M: Final = 1e-4
"""How much nearer than the margin pairs may stay [m]."""
CLOSE_RAD: Final = 2e-4
"""Iterations end when no joint moves by more [rad]; when all is apart, by more than `_NEAR_RAD`."""
_NEAR_RAD: Final = 0.01
_WORSE_M: Final = 0.003
"""A step after which a pair is this much nearer is halved [m], at most `_HALVINGS` times."""
_HALVINGS: Final = 3
_STEP_RAD: Final = 0.2
"""Largest change of a joint in one iteration, within which distances are nearly linear [rad]."""


class Separation:
    """Parts the links of one robot in one pose.

    Args:
        robot: The robot, whose `update` is called.
        shapes: Its shapes.
        feet: What standing feet allow.
        iterations: Linearisations a pose.

    Attributes:
        distances: The distances.
        margin: Distance that each pair keeps, (P,) [m].
    """

    def __init__(self, robot: RobotModel, shapes: Shapes, feet: Feet, iterations: int) -> None:
        self._robot, self._feet, self._iterations = robot, feet, iterations
        self.margin, self.distances = shapes.margin, Distances(robot, shapes)
        masks = np.zeros((len(shapes.links), robot.nv))
        for mask, joint in zip(masks, shapes.joint.tolist(), strict=True):
            at = joint
            while at > 0:
                first, width = robot.model.joints[at].idx_v, robot.model.joints[at].nv
                mask[first : first + width] = 1.0
                at = robot.model.parents[at]
        self._difference = masks[shapes.pairs[:, 0], 6:] - masks[shapes.pairs[:, 1], 6:]
        self._in_world = (shapes.joint[shapes.pairs[:, 1]] == 0).astype(float)[:, None]
        self._coupling = robot.coupling if robot.coupling is not None else np.eye(robot.n)

    def jacobian(self, pairs: IntArray, normals: Array, points: Array, base: Array | float = 0.0) -> Array:
        """Return how distances change with the joints at the robot's last update, shape (K, n) [m/rad].

        Args:
            pairs, normals, points: As `Distances.below` returns them.
            base: 1 for each joint that moves the base, (n,): counts for pairs with an object in the world.
        """
        wrench = np.hstack([normals, cross(points, normals)])
        moves = self._difference[pairs] - self._in_world[pairs] * base
        rows: Array = (wrench @ self._robot.jacobian[:, 6:]) * moves
        return rows

    def apart(
        self, stack: TaskStack, q: Array, wish: Array, free: BoolArray, low: Array, high: Array, *, bent: bool
    ) -> tuple[Array, float]:
        """Move ``q`` and leave the robot updated at it.

        Args:
            stack: The tasks: CoM, anchor, contact.
            q: The pose, (nq,); changed in place.
            wish: Change of the joints without any collision, (n,) [rad].
            free: Joints that may change, (n,).
            low, high: Range of the change, (n,) each [rad].
            bent: Whether the standing legs move; the base is then placed so that the anchor stays.

        Returns:
            The change of the joints (n,), and by how much a pair is nearer than its margin [m].
        """
        S, given = self._coupling, q[7:].copy()
        lead = S.argmax(axis=0)
        movable = np.array([free[S[:, k] != 0.0].all() for k in range(S.shape[1])])
        S, lead = S[:, movable], lead[movable]
        wish, low, high = wish[lead], low[lead], high[lead]
        u = np.clip(wish, low, high)
        self.put(q, given, 0.0 * given)
        kept = self._feet.kept(stack, bent=bent)
        sight: dict[int, tuple[Array, float]] = {}
        moved, depth, origin, best = np.inf, 0.0, u, (np.inf, u)
        for k in range(self._iterations + 1):
            known = depth
            for _ in range(_HALVINGS + 1):
                self.put(q, given, S @ u, kept)
                pairs, d, normals, points = self.distances.below(self.margin + (_AGAIN_M if k else _WATCH_M))
                lack = self.margin[pairs] - d
                depth = float(lack.max(initial=0.0))
                if not k or depth <= known + _WORSE_M:
                    break
                u = 0.5 * (origin + u)  # too far: something came into the way that was not in sight
            best = min(best, (depth, u), key=lambda x: x[0])
            if k == self._iterations or moved < (_NEAR_RAD if depth < EXACT_M else CLOSE_RAD):
                break
            if depth <= 0.0 and not k and not kept:
                break
            A = self.jacobian(pairs, normals, points, kept.base) @ S
            sight.update(zip(pairs.tolist(), zip(A, lack + A @ u, strict=True), strict=True))
            rows = np.array([a for a, _ in sight.values()]).reshape(-1, len(u))
            b = np.array([x for _, x in sight.values()])
            C, c = kept.rows()
            C = C @ S
            reach_low, reach_high = np.maximum(low, u - _STEP_RAD), np.minimum(high, u + _STEP_RAD)
            new = smallest_motion(wish, rows, b, reach_low, reach_high, C, c + C @ u)
            moved = float(np.abs(new - u).max(initial=0.0))
            origin, u = u, new
        if depth > max(best[0], EXACT_M):
            depth, u = best
            self.put(q, given, S @ u, kept)
        offset: Array = S @ u
        return offset, depth

    def depth(self) -> float:
        """Return by how much a pair is nearer than its margin at the robot's last update [m]."""
        pairs, d, _, _ = self.distances.below(self.margin)
        return float((self.margin[pairs] - d).max(initial=0.0))

    def put(self, q: Array, given: Array, offset: Array, kept: Kept | None = None) -> None:
        """Set the joints of ``q`` to given ones and a change, and update the robot."""
        q[7:] = np.clip(given + offset, self._robot.lower, self._robot.upper) if offset.any() else given
        self._robot.update(q)
        if kept is not None:
            kept.place(q)
