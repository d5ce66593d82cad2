"""When hands hold an object, and how far they have moved it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.contact.grips import Grips
from imitor.types import Array, BoolArray


class Grasp:
    """Follows the hands of a person and the object that they take, move along its travel and leave.

    A hand takes hold where it comes so near its grip as the object stands; a hand that passes where the object
    might be, but is not, holds nothing. The object goes with the hands that hold it, in their mean. A hand lets
    go once it is farther than that from every place of the travel; then the object stays where it is.

    Args:
        grips: The grips of both hands.
        reach_m: How near a hand comes to take hold [m].

    Attributes:
        holds: Which hand holds the object, left and right, shape (2,).
        moved: Share of the travel at which the object is, 0 to 1.
    """

    def __init__(self, grips: Grips, reach_m: float) -> None:
        self.grips, self._reach = grips, reach_m
        self.reset()

    def reset(self) -> None:
        """Put the object back; no hand holds it."""
        self.holds: BoolArray = np.zeros(2, dtype=bool)
        self.moved = 0.0

    @property
    def shift(self) -> Array:
        """How far the object is from where it was, in world, shape (3,) [m]."""
        return self.moved * self.grips.travel

    def step(self, hands: Sequence[tuple[int, Array]]) -> None:
        """Take in where hands are: side, 0 for the left, and position, shape (3,) [m]."""
        places = []
        for side, hand in hands:
            if not self.holds[side]:
                grip = self.grips.closed[side] + self.shift
                self.holds[side] = np.linalg.norm(hand - grip) <= self._reach
            elif self.grips.distance(hand, side) > self._reach:
                self.holds[side] = False
            if self.holds[side]:
                places.append(self.grips.moved(hand, side))
        if places:
            self.moved = sum(places) / len(places)
