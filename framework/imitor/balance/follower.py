"""A reference that goes to its goal no faster than a robot in static balance may move."""

from __future__ import annotations

from math import sqrt

import numpy as np

from imitor.types import Array

_THERE = 1e-9  # [m]


class Follower:
    """A point that follows a goal within a speed and an acceleration, and comes to rest on it.

    Attributes:
        at: Where the reference is, shape (d,) [m].
        velocity: How it moves, shape (d,) [m/s].
    """

    def __init__(self, speed: float, acceleration: float, dt_s: float) -> None:
        self._speed, self._acceleration, self._dt_s = speed, acceleration, dt_s
        self.reset(np.zeros(0))

    def reset(self, at: Array) -> None:
        """Rest at a place, shape (d,) [m]."""
        self.at: Array = np.array(at, dtype=float)
        self.velocity: Array = np.zeros_like(self.at)

    def step(self, goal: Array) -> Array:
        """Advance by a frame and return where the reference is, shape (d,) [m]; a view, valid until the next."""
        a, dt = self._acceleration, self._dt_s
        gap = goal - self.at
        distance = sqrt(float(gap @ gap))
        wish = np.zeros_like(self.at)
        if distance > _THERE:
            half = 0.5 * a * dt  # from this speed on, steps shrinking by a * dt end within the distance
            stoppable = sqrt(half * half + 2.0 * a * distance) - half
            wish = gap * (min(self._speed, stoppable, distance / dt) / distance)
        change = wish - self.velocity
        size = sqrt(float(change @ change))
        if size > a * dt:
            change *= a * dt / size
        self.velocity += change
        self.at += dt * self.velocity
        return self.at

    def rests_at(self, goal: Array, within: float) -> bool:
        """Tell whether the reference is this near to a goal [m]."""
        gap = goal - self.at
        return bool(gap @ gap <= within * within)
