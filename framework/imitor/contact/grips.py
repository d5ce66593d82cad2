"""Where hands take hold of an object, along the way that it can be moved, and how near to it a hand is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from imitor.errors import ImitorError, did_you_mean
from imitor.types import SIDES, Array


class Grips:
    """The grips of both hands on an object of the pipeline's ``environment``.

    A handle can be anywhere along its travel while it is held; the nearest of these places counts. So whether a hand
    is in contact depends on where it is alone, not on what was before.

    Args:
        environment: Objects, each with ``name`` and ``position_m``.
        name: Which one is held.
        offset_m: Of the left hand's grip from the object's position, in world; mirrored for the right one.
        travel_m: How far and where to the object can be moved, in world; zero for a fixed one.

    Raises:
        ImitorError: There is no such object.
    """

    def __init__(
        self,
        environment: Sequence[Mapping[str, Any]],
        name: str,
        offset_m: Sequence[float],
        travel_m: Sequence[float],
    ) -> None:
        objects = {str(o.get("name", "")): o for o in environment}
        if name not in objects:
            hint = did_you_mean(name, objects)
            raise ImitorError(
                f"the environment has no object '{name}'"
                + (f"; {hint}" if hint else "")
                + f"; it has: {', '.join(objects) or 'none'}"
            )
        position = np.asarray(objects[name].get("position_m", (0.0, 0.0, 0.0)), dtype=float)
        offset = np.asarray(offset_m, dtype=float)
        self.travel: Array = np.asarray(travel_m, dtype=float)
        self.closed: Array = np.stack([position + offset, position + offset * (1.0, -1.0, 1.0)])
        self._length2 = float(self.travel @ self.travel)

    def moved(self, hand: Array, side: int) -> float:
        """Return the share of the travel at which the object is nearest to a hand, 0 to 1."""
        if self._length2 == 0.0:
            return 0.0
        return float(np.clip((hand - self.closed[side]) @ self.travel / self._length2, 0.0, 1.0))

    def distance(self, hand: Array, side: int) -> float:
        """Return how far a hand, shape (3,) [m], is from its grip wherever the object may be [m]."""
        nearest = self.closed[side] + self.moved(hand, side) * self.travel
        return float(np.linalg.norm(hand - nearest))

    def places(self, n: int = 3) -> list[Array]:
        """Return both grips at ``n`` places of the travel, each shape (2, 3) [m]."""
        return [self.closed + share * self.travel for share in np.linspace(0.0, 1.0, n)]


__all__ = ["SIDES", "Grips"]
