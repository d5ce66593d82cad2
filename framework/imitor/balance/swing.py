"""The way of a foot that is off the ground: up, after the mapper's wish, over its landing place, and straight down."""

from __future__ import annotations

import numpy as np

from imitor.balance.follower import Follower
from imitor.types import Array

_OVER_M = 0.002
"""How near its landing place a foot is to be, horizontally, before it goes down [m]."""


class Swing:
    """Reference of a free foot's ankle, within a speed and an acceleration.

    Attributes:
        at: Where the ankle shall be, shape (3,) [m].
        descends: Whether the foot is on its last way, straight down.
    """

    def __init__(self, speed: float, acceleration: float, patience_s: float, dt_s: float) -> None:
        self._follower = Follower(speed, acceleration, dt_s)
        self._patience_s, self._dt_s = patience_s, dt_s
        self.reset(np.zeros(3))

    @property
    def at(self) -> Array:
        """Where the ankle shall be, shape (3,) [m]."""
        return self._follower.at

    def reset(self, ankle: Array) -> None:
        """Begin at rest where the ankle is, shape (3,) [m]."""
        self._follower.reset(ankle)
        self.hold()

    def hold(self) -> None:
        """Begin a new way from here."""
        self._held: Array = self._follower.at.copy()
        self.descends = False
        self._tried_s = 0.0

    def lift(self, height: float) -> Array:
        """Go straight up to a height of the ankle [m]."""
        return self._follower.step(np.array([self._held[0], self._held[1], height]))

    def follow(self, wish: Array, lowest: float) -> Array:
        """Go where the mapper would have the ankle, shape (3,) [m], at once as high as clears the floor [m]."""
        at = self._follower.step(wish)
        if at[2] < lowest:
            at[2] = lowest
            self._follower.velocity[2] = max(float(self._follower.velocity[2]), 0.0)
        return at

    def land(self, place: Array, actual: Array, ground: float, height: float, flat: bool) -> Array:
        """Go over a place, shape (2,) [m], then straight down to the ground.

        Args:
            place: Where to land; given up for where the foot is when it cannot get there in time. A foot that is not
                flat stays up.
            actual: Where the robot's ankle is, shape (3,) [m].
            ground: Height of the ankle when the sole is on the ground [m].
            height: Height at which to go over the place [m]; a foot that is lower goes up first.
            flat: Whether the robot's sole is flat.
        """
        if not self.descends:
            self._tried_s += self._dt_s
            off = actual[:2] - place
            over = float(off @ off) <= _OVER_M**2 and self._follower.rests_at(
                self._goal(place, height), _OVER_M
            )
            late = self._tried_s > self._patience_s
            if flat and (over or late):
                self.descends = True
                self._held = np.array([*(place if over else actual[:2]), ground])
        if self.descends:
            return self._follower.step(self._held)
        low = self._follower.at[2] < 0.5 * (ground + height)
        return self._follower.step(self._goal(self._held[:2] if low else place, height))

    def _goal(self, place: Array, height: float) -> Array:
        return np.array([place[0], place[1], height])
