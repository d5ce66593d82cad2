r"""Keeps the links of a robot apart by the smallest change of the joints that carry no standing foot.

The distance of a pair with unit normal :math:`n` (from the second shape to the first) at the point :math:`p` changes
with the joints as :math:`\dot d = (w^T\,{}^0J) \odot (m_a - m_b)\,\dot q`, :math:`w = (n, p \times n)`, with
Pinocchio's world-frame spatial Jacobian and the masks :math:`m` of the joints that carry the two shapes. The change
of configuration is carried on from frame to frame: it may grow by a bounded step and fades when no longer needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imitor.collision.distances import Distances
from imitor.collision.feet import Feet, Kept
from imitor.collision.shapes import Shapes
from imitor.collision.smallest import smallest_motion
from imitor.safety.guard import Guard
from imitor.tasks import TaskStack
from imitor.types import STATUS, Array, BoolArray, Configuration, IntArray

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
_WORSE_M = 0.003
"""A step after which a pair is this much nearer is halved [m], at most `_HALVINGS` times."""
_HALVINGS = 3
_SHARES = (0.5, 0.25)
"""Shares of the way from the last command that are tried where links overlap at its end [-]."""
_HELD = STATUS.index("held")
_STEP_RAD = 0.2
"""Largest change of a joint in one iteration, within which distances are nearly linear [rad]."""


@dataclass(frozen=True)
class Settings:
    """How links are kept apart; the options of the post-processor.

    Attributes:
        dt_s: Time between frames [s].
        margin_m: Distance that links keep [m].
        iterations: Linearisations a frame.
        speed_share: Share of a joint's speed that a change may grow with [-].
        release_s: Time in which a change fades to 37 % when no longer needed [s].
        interim: Whether later stages set the feet on the ground anew: standing feet may move, and the pose is not
            slowed down to what the guard lets through.
        slide: Whether a standing foot that is not the anchor may slide on the ground.
        hold: Whether a pose whose links would still overlap is approached more slowly, or not at all.
    """

    dt_s: float
    margin_m: float = 0.005
    iterations: int = 6
    speed_share: float = 0.8
    release_s: float = 0.15
    interim: bool = False
    slide: bool = False
    hold: bool = True


class Correction:
    """Separates the links of one robot, frame by frame.

    Args:
        robot: The robot, whose `update` is called when something is changed.
        shapes: Its shapes.
        settings: How it is done.

    Attributes:
        changed: Frames in which the configuration was changed.
        left: Frames in which a pair stayed nearer than its margin less 1 mm.
        slowed, held: Frames in which only a share of the way was gone, and in which the last command was repeated.
        largest_rad: Largest change of a joint [rad].
    """

    def __init__(self, robot: RobotModel, shapes: Shapes, settings: Settings) -> None:
        self._robot, self._margin, self._settings = robot, shapes.margin, settings
        self._step = settings.speed_share * robot.speed * settings.dt_s
        self._fade = math.exp(-settings.dt_s / settings.release_s)
        self._guard = None if settings.interim else Guard(robot, settings.dt_s)
        self._feet = Feet(robot, release=settings.interim, slide=settings.slide)
        self.distances = Distances(robot, shapes)
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
        self.reset()

    def reset(self) -> None:
        """Forget earlier frames and counts."""
        self.changed = self.left = self.slowed = self.held = 0
        self.largest_rad = 0.0
        self._offset: Array | None = None
        self._bent = False
        self.distances.reset()
        if self._guard is not None:
            self._guard.reset()

    def jacobian(self, pairs: IntArray, normals: Array, points: Array, base: Array | float = 0.0) -> Array:
        """Return how distances change with the joints at the robot's last update, shape (K, n) [m/rad].

        Args:
            pairs, normals, points: As `Distances.below` returns them.
            base: 1 for each joint that moves the base, (n,): counts for pairs with an object in the world.
        """
        wrench = np.hstack([normals, np.cross(points, normals)])
        moves = self._difference[pairs] - self._in_world[pairs] * base
        rows: Array = (wrench @ self._robot.jacobian[:, 6:]) * moves
        return rows

    def apply(self, stack: TaskStack, state: Configuration) -> None:
        """Change ``state.q`` in place, and leave the robot updated at it."""
        q, sent, robot = state.q, state.sent, self._robot
        if sent is not None and np.array_equal(q, sent):
            return  # the last command again: it was corrected then
        first = self._offset is None
        fixed = ~self._feet.free(stack)
        bent = self._bent and self._feet.can_bend(stack)
        free = np.ones_like(fixed) if bent else ~fixed
        # a foot that stands again stands where it was told to
        before = np.where(free, np.zeros(robot.n) if self._offset is None else self._offset, 0.0)
        wish = self._fade * before
        wish[np.abs(wish) < _GONE_RAD] = 0.0
        low, high = robot.lower, robot.upper
        if self._guard is not None and sent is not None:
            low, high = self._slowed(stack, q, wish, sent)
        bounded = first or (self._guard is not None and sent is not None)
        step = np.full(robot.n, np.inf) if bounded else self._step
        self._offset = before
        if not before.any() and not len(self.distances.below(self._margin)[0]):
            return
        asked, given = q.copy(), q[7:].copy()
        low, high = low - given, high - given
        box = np.clip(before - step, low, high), np.clip(before + step, low, high)
        self._offset, depth = self._separate(stack, q, wish, free, *box, bent=bent)
        if depth > 0.001 and not bent and self._feet.can_bend(stack):
            bent, depth = self._bend(stack, q, asked, wish, box, depth)
        if depth > 0.001 and sent is not None and self._guard is not None:
            if not bent:
                depth = self._stay(q, given, np.where(free, sent[7:] - given, 0.0), depth)
            if depth > self._settings.margin_m and self._settings.hold:
                asked[7:] += wish
                depth = self._wait(stack, state, asked, sent, wish, bent)
        self._bent = bent and bool((np.abs(self._offset[fixed]) > _CLOSE_RAD).any())
        if self._offset.any():
            self.changed += 1
            self.largest_rad = max(self.largest_rad, float(np.abs(self._offset).max()))
        if depth > 0.001:
            self.left += 1

    def _slowed(self, stack: TaskStack, q: Array, wish: Array, sent: Array) -> tuple[Array, Array]:
        """Slow ``q`` down as the guard would; return the range of the joints at this frame, (n,) each [rad].

        Else the guard would send a pose between the last command and one without collisions, which may have some.
        """
        assert self._guard is not None
        low, high = self._guard.follow(sent)
        joints = q[7:] + wish
        if (joints < low - 1e-12).any() or (joints > high + 1e-12).any():
            trial = Configuration(q.copy(), np.asarray(stack.contact))
            trial.q[7:] = joints
            self._guard.apply(stack, trial)
            q[:] = trial.q
            q[7:] -= wish
            self._robot.update(q)
        return low, high

    def _separate(
        self, stack: TaskStack, q: Array, wish: Array, free: BoolArray, low: Array, high: Array, *, bent: bool
    ) -> tuple[Array, float]:
        """Move ``q``; return the change of the joints (n,) and by how much a pair is nearer than its margin [m]."""
        S, given = self._coupling, q[7:].copy()
        lead = S.argmax(axis=0)
        movable = np.array([free[S[:, k] != 0.0].all() for k in range(S.shape[1])])
        S, lead = S[:, movable], lead[movable]
        wish, low, high = wish[lead], low[lead], high[lead]
        u = np.clip(wish, low, high)
        self._set(q, given, 0.0 * given)
        kept = self._feet.kept(stack, bent=bent)
        sight: dict[int, tuple[Array, float]] = {}
        moved, depth, origin, best = np.inf, 0.0, u, (np.inf, u)
        for k in range(self._settings.iterations + 1):
            known = depth
            for _ in range(_HALVINGS + 1):
                self._set(q, given, S @ u, kept)
                pairs, d, normals, points = self.distances.below(self._margin + (_AGAIN_M if k else _WATCH_M))
                lack = self._margin[pairs] - d
                depth = float(lack.max(initial=0.0))
                if not k or depth <= known + _WORSE_M:
                    break
                u = 0.5 * (origin + u)  # too far: something came into the way that was not in sight
            best = min(best, (depth, u), key=lambda x: x[0])
            if k == self._settings.iterations or moved < (_NEAR_RAD if depth < _EXACT_M else _CLOSE_RAD):
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
        if depth > max(best[0], _EXACT_M):
            depth, u = best
            self._set(q, given, S @ u, kept)
        offset: Array = S @ u
        return offset, depth

    def _bend(
        self, stack: TaskStack, q: Array, asked: Array, wish: Array, box: tuple[Array, Array], depth: float
    ) -> tuple[bool, float]:
        """Try with the standing legs free, their feet held by rows; return whether that is better, and its depth."""
        found, offset = q.copy(), self._offset
        q[:] = asked
        other, lack = self._separate(stack, q, wish, np.ones(self._robot.n, dtype=bool), *box, bent=True)
        if lack < depth - _EXACT_M:
            self._offset = other
            return True, lack
        q[:] = found
        self._robot.update(q)
        self._offset = offset
        return False, depth

    def _stay(self, q: Array, given: Array, offset: Array, depth: float) -> float:
        """Leave free joints where the last command had them if links are farther apart there; return the depth [m]."""
        found = q.copy()
        self._set(q, given, offset)
        pairs, d, _, _ = self.distances.below(self._margin)
        before = float((self._margin[pairs] - d).max(initial=0.0))
        if before < depth:
            self._offset = offset
            return before
        q[:] = found
        self._robot.update(q)
        return depth

    def _wait(
        self, stack: TaskStack, state: Configuration, asked: Array, sent: Array, wish: Array, bent: bool
    ) -> float:
        """Go a share of the way from the last command to what is asked for, or stay there; return the depth [m].

        Args:
            stack: The tasks: the anchor keeps its place.
            state: What is written.
            asked: The pose that cannot be reached without a collision, (nq,).
            sent: The last command, (nq,).
            wish: Part of ``asked`` that is a correction, (n,) [rad].
            bent: Whether the standing legs may move.
        """
        robot, q = self._robot, state.q
        before = self._offset
        free = np.ones(robot.n, dtype=bool) if bent else self._feet.free(stack)
        for share in _SHARES:
            q[:] = robot.interpolate(sent, asked, share)
            robot.update(q)
            if stack.anchor:
                robot.place(q, stack.anchor, stack.anchor_pose)
            q[7:] -= wish
            step = self._robot.speed * self._settings.dt_s
            given = q[7:]
            low = np.maximum(robot.lower, sent[7:] - step) - given
            high = np.minimum(robot.upper, sent[7:] + step) - given
            self._offset, depth = self._separate(stack, q, wish, free, low, high, bent=bent)
            if depth <= self._settings.margin_m:
                self.slowed += 1
                return depth
        q[:] = sent
        robot.update(q)
        self._offset, state.status = before, _HELD
        self.held += 1
        return 0.0

    def _set(self, q: Array, given: Array, offset: Array, kept: Kept | None = None) -> None:
        q[7:] = np.clip(given + offset, self._robot.lower, self._robot.upper) if offset.any() else given
        self._robot.update(q)
        if kept is not None:
            kept.place(q)
