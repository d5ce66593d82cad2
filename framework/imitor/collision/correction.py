"""Keeps the links of a robot apart from frame to frame.

The change of a pose is carried on to the next frame and fades when it is no longer needed. It is found in steps, the
next one where the one before leaves links too near: the joints that carry no standing foot; the standing legs, too,
their feet held as well as may be; the free joints as the last command had them; half and a quarter of the way from
the last command; the last command again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imitor.collision.feet import Feet
from imitor.collision.separation import CLOSE_RAD, EXACT_M, Separation
from imitor.collision.shapes import Shapes
from imitor.errors import ImitorError
from imitor.safety.guard import Guard
from imitor.tasks import TaskStack
from imitor.types import STATUS, Array, BoolArray, Configuration

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

_GONE_RAD = 1e-5
"""A fading change smaller than this is none [rad]."""
_SHARES = (0.5, 0.25)
"""Shares of the way from the last command that are tried where links overlap at its end [-]."""
_HELD = STATUS.index("held")


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
        separation: What parts the links in a pose.
    """

    def __init__(self, robot: RobotModel, shapes: Shapes, settings: Settings) -> None:
        self._robot, self._settings = robot, settings
        self._step = settings.speed_share * robot.speed * settings.dt_s
        self._fade = math.exp(-settings.dt_s / settings.release_s)
        self._guard = None if settings.interim else Guard(robot, settings.dt_s)
        self._feet = Feet(robot, release=settings.interim, slide=settings.slide)
        self.separation = Separation(robot, shapes, self._feet, settings.iterations)
        self.reset()

    def reset(self) -> None:
        """Forget earlier frames and counts."""
        self.changed = self.left = self.slowed = self.held = 0
        self.largest_rad = 0.0
        self._offset: Array | None = None
        self._bent = False
        self.separation.distances.reset()
        if self._guard is not None:
            self._guard.reset()

    def apply(self, stack: TaskStack, state: Configuration) -> None:
        """Change ``state.q`` in place, and leave the robot updated at it.

        Raises:
            ImitorError: The robot begins inside an object of the environment.
        """
        q, sent, robot = state.q, state.sent, self._robot
        self.separation.distances.move_objects(stack.object_shift)
        if sent is not None and np.array_equal(q, sent):
            return  # the last command again: it was corrected then
        first = self._offset is None
        before, wish = self._carried_on(stack, q)
        low, high = robot.lower, robot.upper
        if self._guard is not None and sent is not None:
            low, high = self._slowed(stack, q, wish, sent)
        bounded = first or (self._guard is not None and sent is not None)
        step = np.full(robot.n, np.inf) if bounded else self._step
        self._offset = before
        if not before.any() and not self.separation.depth():
            return
        fixed, bent, free = self._free(stack)
        asked, given = q.copy(), q[7:].copy()
        low, high = low - given, high - given
        box = np.clip(before - step, low, high), np.clip(before + step, low, high)
        self._offset, depth = self.separation.apart(stack, q, wish, free, *box, bent=bent)
        if depth > 0.001 and not bent and self._feet.can_bend(stack):
            bent, depth = self._bend(stack, q, asked, wish, box, depth)
        if depth > 0.001 and sent is not None and self._guard is not None:
            if not bent:
                depth = self._stay(q, given, np.where(free, sent[7:] - given, 0.0), depth)
            if depth > self._settings.margin_m and self._settings.hold:
                asked[7:] += wish
                depth = self._wait(stack, state, asked, sent, wish, bent)
        self._bent = bent and bool((np.abs(self._offset[fixed]) > CLOSE_RAD).any())
        if self._offset.any():
            self.changed += 1
            self.largest_rad = max(self.largest_rad, float(np.abs(self._offset).max()))
        if depth > 0.001:
            self.left += 1
        if sent is None and depth > self._settings.margin_m and self._settings.hold:
            self._check_start()

    def _check_start(self) -> None:
        """Refuse to begin inside an object, where no pose leads out.

        Raises:
            ImitorError: The robot, at its last update, is inside an object; says in which and how deep.
        """
        shapes = self.separation.distances.shapes
        pairs, distance, _, _ = self.separation.distances.below(0.0)
        other = shapes.pairs[pairs].max(axis=1)
        inside = other >= len(shapes.links) - shapes.n_objects
        if not inside.any():
            return
        deepest = int(np.where(inside, distance, np.inf).argmin())
        i, j = sorted(shapes.pairs[pairs[deepest]].tolist())
        raise ImitorError(
            f"the robot begins inside '{shapes.links[j]}' of the environment: {shapes.links[i]} is "
            f"{-1e3 * distance[deepest]:.1f} mm deep in it. Is this recording made there? Move the object, --set "
            f"environment.{shapes.links[j]}.position_m=[x,y,z], or leave all of them out, --set environment=[]"
        )

    def _free(self, stack: TaskStack) -> tuple[BoolArray, bool, BoolArray]:
        """Return the joints of standing feet, whether those may change, too, and all that may, shape (n,) each."""
        fixed = ~self._feet.free(stack)
        bent = self._bent and self._feet.can_bend(stack)
        return fixed, bent, np.ones_like(fixed) if bent else ~fixed

    def _carried_on(self, stack: TaskStack, q: Array) -> tuple[Array, Array]:
        """Return the last frame's change, as far as it may stay, and what it fades to in this one, (n,) each [rad]."""
        robot, offset = self._robot, self._offset
        if offset is None or not offset.any():
            return np.zeros(robot.n), np.zeros(robot.n)
        # A foot that stands again stands where it was told to.
        before = np.where(self._free(stack)[2], offset, 0.0)
        wish = self._fade * before
        wish[np.abs(wish) < _GONE_RAD] = 0.0
        # at the end of a joint's range there is no room for it: no reason to slow the whole pose down
        low, high = np.minimum(robot.lower - q[7:], 0.0), np.maximum(robot.upper - q[7:], 0.0)
        return before, np.clip(wish, low, high)

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
            self._take_back(stack, q, wish)
        return low, high

    def _take_back(self, stack: TaskStack, q: Array, wish: Array) -> None:
        """Take a correction out of a pose that has it; the anchor, which bent legs would move, keeps its place."""
        q[7:] -= wish
        self._robot.update(q)
        if stack.anchor:
            self._robot.place(q, stack.anchor, stack.anchor_pose)

    def _bend(
        self, stack: TaskStack, q: Array, asked: Array, wish: Array, box: tuple[Array, Array], depth: float
    ) -> tuple[bool, float]:
        """Try with the standing legs free, their feet held by rows; return whether that is better, and its depth."""
        found, offset = q.copy(), self._offset
        q[:] = asked
        other, lack = self.separation.apart(
            stack, q, wish, np.ones(self._robot.n, dtype=bool), *box, bent=True
        )
        if lack < depth - EXACT_M:
            self._offset = other
            return True, lack
        q[:] = found
        self._robot.update(q)
        self._offset = offset
        return False, depth

    def _stay(self, q: Array, given: Array, offset: Array, depth: float) -> float:
        """Leave free joints where the last command had them if links are farther apart there; return the depth [m]."""
        found = q.copy()
        self.separation.put(q, given, offset)
        before = self.separation.depth()
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
            self._take_back(stack, q, wish)
            step = self._robot.speed * self._settings.dt_s
            given = q[7:]
            low = np.maximum(robot.lower, sent[7:] - step) - given
            high = np.minimum(robot.upper, sent[7:] + step) - given
            self._offset, depth = self.separation.apart(stack, q, wish, free, low, high, bent=bent)
            if depth <= self._settings.margin_m:
                self.slowed += 1
                return depth
        q[:] = sent
        robot.update(q)
        self._offset, state.status = before, _HELD
        self.held += 1
        return 0.0
