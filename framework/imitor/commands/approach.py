"""From where the robot is to what it is told: slowly at first, and never faster than it may move."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from imitor.types import Array

_PEAK: Final = 1.5
"""Fastest by mean speed of the way 3 s^2 - 2 s^3 [-]."""
_STEEPEST: Final = 6.0
"""Largest acceleration by way per time squared of it [-]."""
_SHARE: Final = 0.5
"""Share of the acceleration limits that the way may take [-]."""
_ROUNDING: Final = 1e-9


class Approach:
    """Blends the present posture into the commands, which may move meanwhile.

    The share of the command grows as 3 s² - 2 s³ over a time in which no joint needs more than the given speed, and
    half of its acceleration limit, for the way to the first command: the other half is for what the commands do
    meanwhile. Afterwards commands pass unchanged. From one call to the next no joint ever moves farther than its speed
    limit allows.

    Args:
        present: Where the robot is, shape (n,) [rad].
        speed, acceleration: Limits, shape (n,) each [rad/s], [rad/s²]; infinite where there is none.
        dt_s: Time between calls [s].
        blend_speed: Largest speed of the way to the first command [rad/s].
    """

    def __init__(
        self, present: Array, speed: Array, acceleration: Array, dt_s: float, blend_speed: float
    ) -> None:
        self._from, self._last = present.copy(), present.copy()
        self._step = speed * dt_s * (1.0 + _ROUNDING)
        self._dt_s, self._blend_speed = dt_s, np.minimum(blend_speed, speed)
        self._blend_acceleration = _SHARE * acceleration
        self._steps, self._taken = -1, 0

    @property
    def done(self) -> bool:
        """Whether the whole way lies behind, apart from the last command."""
        return 0 <= self._steps <= self._taken

    @property
    def duration_s(self) -> float:
        """How long the way takes, once the first command is known [s]."""
        return max(self._steps, 0) * self._dt_s

    def plan(self, first: Array) -> None:
        """Choose how long the way takes, by the first command, shape (n,) [rad]."""
        way = np.abs(first - self._from)
        by_speed = (_PEAK * way / self._blend_speed).max(initial=0.0)
        by_acceleration = np.sqrt(_STEEPEST * way / self._blend_acceleration).max(initial=0.0)
        time_s = float(max(by_speed, by_acceleration))
        self._steps = math.ceil(time_s / self._dt_s - _ROUNDING)

    def stay(self) -> Array:
        """Return where the robot was told to be last; the way goes on with the next `step` [rad]."""
        return self._last

    def step(self, target: Array) -> Array:
        """Return what the robot is told now, for a command of shape (n,) [rad]."""
        if self._steps < 0:
            self.plan(target)
        if self.done:
            wanted = target
        else:
            self._taken += 1
            s = self._taken / self._steps
            wanted = self._from + (3.0 - 2.0 * s) * s * s * (target - self._from)
        self._last = self._last + np.clip(wanted - self._last, -self._step, self._step)
        return self._last


__all__ = ["Approach"]
