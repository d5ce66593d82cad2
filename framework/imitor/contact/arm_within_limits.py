r"""The pose of an arm within joint limits that is nearest to one beyond them, by its segments, not joint by joint.

A joint that is scaled into its limits by itself turns all that it carries: upper arms that point aside and a little
back, where ROMEO's shoulders do not reach, would point up and the forearms at the head. So :math:`x` minimises, within
the limits,
:math:`\|u(x) - u(q)\|^2 + \|f(x) - f(q)\|^2 + w^2 \|\log R_h(q) R_h(x)^T\|^2 + v^2 \|x - s\|^2`:
elbow from shoulder, hand from elbow and the hand's rotation as the unlimited joints :math:`q` have them, the joints as
:math:`s`, the scaled ones.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import pinocchio as pin

from imitor.ik.vectors import skew
from imitor.robot.model import RobotModel
from imitor.types import Array, BoolArray

_MISS: Final = (0.2, 0.4)
"""Taking over begins where scaling moves elbow or hand this far, and is complete there; by the arm's length [-]."""
_TURN: Final = 0.12
"""Error of a segment's end that a hand turned by 1 rad is worth, by the arm's length [-]."""
_JOINT: Final = 0.025
"""The same of a joint that is 1 rad from its scaled value [-]."""
_LARGEST_STEP: Final = 0.3
"""A step moves no joint further [rad]."""
_ENOUGH: Final = 1e-4
"""A step that moves no joint further ends the search [rad]."""
_STEPS, _FIRST_STEPS = 3, 40
"""Most steps of the search in a frame, and in the first one."""


class ArmWithinLimits:
    """One arm, led from frame to frame; where scaling moves elbow and hand by little, it does nothing.

    Args:
        robot: The robot in its own size; a twin is moved.
        side: ``left`` or ``right``; the robot has that hand.
        joints: The joints of this arm alone, shape (n,).
    """

    def __init__(self, robot: RobotModel, side: str, joints: BoolArray) -> None:
        self._robot, self._index = robot.twin(), np.flatnonzero(joints)
        self._low, self._high = robot.lower[joints], robot.upper[joints]
        self._roles = [role for role in (f"{side}_elbow", f"{side}_hand") if robot.has(role)]
        self._frames = [robot.frame_id(role) for role in self._roles]
        self._carried = [robot.ancestors(role)[6:][joints] for role in self._roles]
        along = [r for r in (f"{side}_shoulder", *self._roles) if robot.has(r)]
        places = [self._robot.position(role) for role in along]
        length = float(sum(np.linalg.norm(b - a) for a, b in itertools.pairwise(places)))
        self._from, self._whole = (share * length for share in _MISS)
        self._turn, self._joint = _TURN * length, _JOINT * length
        self._q: Array = robot.standing.copy()
        self.reset()

    def reset(self) -> None:
        """Forget the pose of the last frame."""
        self._last: Array | None = None
        self._begun = False

    def __call__(self, q: Array, scaled: Array) -> Array:
        """Return the joints of the arm, within the limits, shape (k,) [rad].

        Args:
            q: All joints as imitated, shape (n,) [rad].
            scaled: The same scaled into the limits, shape (n,) [rad].
        """
        self._q[7:] = scaled
        own = scaled[self._index]
        points, _ = self._at(own)
        goal = self._at(q[self._index])
        miss = float(np.linalg.norm(np.subtract(points, goal[0]), axis=1).max(initial=0.0))
        share = min(max((miss - self._from) / max(self._whole - self._from, 1e-9), 0.0), 1.0)
        steps = _STEPS if self._begun else _FIRST_STEPS
        self._begun = True
        if share == 0.0:
            self._last = None
            return own
        x = own if self._last is None else self._last
        for _ in range(steps):
            before, x = x, self._nearer(x, goal, own)
            if np.abs(x - before).max() < _ENOUGH:
                break
        self._last = x
        mixed = own + share**2 * (3.0 - 2.0 * share) * (x - own)
        return np.asarray(np.clip(mixed, self._low, self._high))

    def _at(self, arm: Array) -> tuple[list[Array], Array]:
        """Bring the robot to joints of the arm; return elbow and hand, (3,) each [m], and the hand's rotation."""
        self._q[7 + self._index] = arm
        self._robot.update_frames(self._q, self._frames)
        points = [self._robot.position(r).copy() for r in self._roles]
        return points, self._robot.rotation(self._roles[-1]).copy()

    def _nearer(self, x: Array, goal: tuple[list[Array], Array], own: Array) -> Array:
        """Return the joints after one step towards the minimum, within the limits."""
        points, rotation = self._at(x)
        spatial = self._robot.jacobian[:, 6 + self._index]
        J = [(spatial[:3] - skew(p) @ spatial[3:]) * m for p, m in zip(points, self._carried, strict=True)]
        e = [g - p for g, p in zip(goal[0], points, strict=True)]
        if len(J) == 2:
            J[1], e[1] = J[1] - J[0], e[1] - e[0]  # the hand from the elbow
        J += [self._turn * spatial[3:] * self._carried[-1], self._joint * np.eye(len(x))]
        e += [self._turn * pin.log3(goal[1] @ rotation.T), self._joint * (own - x)]
        return _bounded(np.vstack(J), np.concatenate(e), x, self._low, self._high)


def _bounded(J: Array, e: Array, x: Array, low: Array, high: Array) -> Array:
    """Return x after the step that minimises |J dx - e|; joints that would pass a limit stay at it."""
    H, g = J.T @ J, J.T @ e
    dx = np.zeros(len(x))
    free = np.ones(len(x), dtype=bool)
    while free.any():
        step = np.linalg.solve(H[np.ix_(free, free)], g[free] - H[np.ix_(free, ~free)] @ dx[~free])
        dx[free] = step * min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), _ENOUGH))
        to = np.clip(x + dx, low, high)
        outside = free & (np.abs(to - x - dx) > 1e-12)
        if not outside.any():
            break
        dx[outside] = (to - x)[outside]
        free &= ~outside
    return np.asarray(np.clip(x + dx, low, high))


__all__ = ["ArmWithinLimits"]
