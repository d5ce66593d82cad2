r"""Keeps the links of a robot apart by the smallest change of the joints that carry no standing foot.

The distance of a pair with unit normal :math:`n` (from the second shape to the first) at the point :math:`p` changes
with the joints as :math:`\dot d = (w^T\,{}^0J) \odot (m_a - m_b)\,\dot q`, :math:`w = (n, p \times n)`, with
Pinocchio's world-frame spatial Jacobian and the masks :math:`m` of the joints that carry the two shapes. The change
of configuration is carried on from frame to frame: it may grow by a bounded step and fades when no longer needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imitor.collision.distances import Distances
from imitor.collision.shapes import Shapes
from imitor.collision.smallest import smallest_motion
from imitor.tasks import TaskKind, TaskStack
from imitor.types import SIDES, Array, BoolArray, IntArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

_WATCH_M = 0.015
"""Pairs this much farther than the margin are kept in sight while others are moved apart [m]."""
_AGAIN_M = 0.002
"""Of these, only pairs this much farther than the margin are measured again after a step [m]."""
_EXACT_M = 1e-4
"""How much nearer than the margin pairs may stay [m]."""
_CLOSE_RAD = 2e-4
"""Iterations end when no joint moves by more [rad]; when all is apart, by more than `_NEAR_RAD`."""
_NEAR_RAD = 0.01
_GONE_RAD = 1e-5
"""A fading change smaller than this is none [rad]."""
_STEP_RAD = 0.2
"""Largest change of a joint in one iteration, within which distances are nearly linear [rad]."""


class Correction:
    """Separates the links of one robot, frame by frame.

    Args:
        robot: The robot, whose `update` is called when something is changed.
        shapes: Its shapes.
        iterations: Linearisations a frame.
        step_rad: Largest growth of a joint's change in a frame, shape (n,) [rad].
        fade: Share of the change kept from frame to frame when it is no longer needed [-].

    Attributes:
        changed: Frames in which the configuration was changed.
        left: Frames in which a pair stayed nearer than the margin less 1 mm.
        largest_rad: Largest change of a joint [rad].
    """

    def __init__(
        self,
        robot: RobotModel,
        shapes: Shapes,
        iterations: int,
        step_rad: Array,
        fade: float,
    ) -> None:
        self._robot, self._margin, self._iterations = robot, shapes.margin, iterations
        self._step, self._fade = step_rad, fade
        self.distances = Distances(robot, shapes)
        masks = np.zeros((len(shapes.links), robot.nv))
        for mask, joint in zip(masks, shapes.joint.tolist(), strict=True):
            at = joint
            while at > 0:
                first, width = robot.model.joints[at].idx_v, robot.model.joints[at].nv
                mask[first : first + width] = 1.0
                at = robot.model.parents[at]
        self._difference = masks[shapes.pairs[:, 0], 6:] - masks[shapes.pairs[:, 1], 6:]
        self._coupling = robot.coupling if robot.coupling is not None else np.eye(robot.n)
        self.reset()

    def reset(self) -> None:
        """Forget earlier frames and counts."""
        self.changed = self.left = 0
        self.largest_rad = 0.0
        self._offset: Array | None = None
        self.distances.reset()

    def jacobian(self, pairs: IntArray, normals: Array, points: Array) -> Array:
        """Return how distances change with the joints at the robot's last update, shape (K, n) [m/rad]."""
        wrench = np.hstack([normals, np.cross(points, normals)])
        rows: Array = (wrench @ self._robot.jacobian[:, 6:]) * self._difference[pairs]
        return rows

    def apply(self, stack: TaskStack, q: Array) -> None:
        """Change ``q`` in place, and leave the robot updated at it."""
        first = self._offset is None
        before = np.zeros(self._robot.n) if self._offset is None else self._offset
        free = self._free(stack)
        before = np.where(free, before, 0.0)  # a foot that stands again stands where it was told to
        self._offset = before
        if not before.any() and not len(self.distances.below(self._margin)[0]):
            return
        step = np.full(self._robot.n, np.inf) if first else self._step
        self._offset, depth = self._separate(stack, q, before, free, step)
        if self._offset.any():
            self.changed += 1
            self.largest_rad = max(self.largest_rad, float(np.abs(self._offset).max()))
        if depth > 0.001:
            self.left += 1

    def _separate(
        self, stack: TaskStack, q: Array, before: Array, free: BoolArray, step: Array
    ) -> tuple[Array, float]:
        """Move ``q``; return the change of the joints (n,) and by how much a pair is nearer than its margin [m]."""
        robot, S, given = self._robot, self._coupling, q[7:].copy()
        lead = S.argmax(axis=0)
        movable = np.array([free[S[:, k] != 0.0].all() for k in range(S.shape[1])])
        S, lead = S[:, movable], lead[movable]
        wish = before[lead] * self._fade
        wish[np.abs(wish) < _GONE_RAD] = 0.0
        low = np.maximum(robot.lower - given, before - step)[lead]
        high = np.maximum(np.minimum(robot.upper - given, before + step)[lead], low)
        u = np.clip(wish, low, high)
        watched = self._com_axes(stack)
        if watched.size:
            self._set(q, given, 0.0 * given)
        goal = robot.com[watched].copy()
        sight: dict[int, tuple[Array, float]] = {}
        moved, depth = np.inf, 0.0
        for k in range(self._iterations + 1):
            self._set(q, given, S @ u)
            pairs, d, normals, points = self.distances.below(self._margin + (_AGAIN_M if k else _WATCH_M))
            lack = self._margin[pairs] - d
            depth = float(lack.max(initial=0.0))
            if k == self._iterations or moved < (_NEAR_RAD if depth < _EXACT_M else _CLOSE_RAD):
                break
            if depth <= 0.0 and not k and not watched.size:
                break
            A = self.jacobian(pairs, normals, points) @ S
            sight.update(zip(pairs.tolist(), zip(A, lack + A @ u, strict=True), strict=True))
            rows = np.array([a for a, _ in sight.values()]).reshape(-1, len(u))
            b = np.array([x for _, x in sight.values()])
            C = robot.com_jacobian[watched, 6:] @ S
            reach_low, reach_high = np.maximum(low, u - _STEP_RAD), np.minimum(high, u + _STEP_RAD)
            new = smallest_motion(wish, rows, b, reach_low, reach_high, C, goal - robot.com[watched] + C @ u)
            moved = float(np.abs(new - u).max(initial=0.0))
            u = new
        offset: Array = S @ u
        return offset, depth

    def _set(self, q: Array, given: Array, offset: Array) -> None:
        q[7:] = np.clip(given + offset, self._robot.lower, self._robot.upper) if offset.any() else given
        self._robot.update(q)

    def _free(self, stack: TaskStack) -> BoolArray:
        """Return the joints whose motion moves neither the anchor nor a standing foot against the base, (n,)."""
        robot = self._robot
        held = np.zeros(robot.nv)
        for side, stands in zip(SIDES, stack.contact.tolist(), strict=True):
            if stands:
                held += robot.ancestors(f"{side}_foot")
        if stack.anchor:
            held += robot.ancestors(stack.anchor)
        return np.asarray(held[6:] == 0.0)

    @staticmethod
    def _com_axes(stack: TaskStack) -> IntArray:
        task = next((t for t in stack if t.kind is TaskKind.COM and t.active[0]), None)
        return np.flatnonzero(task.mask) if task is not None else np.zeros(0, dtype=int)
