"""Where hands take hold of an object, along the way that it can be moved, and how near to it a hand is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from imitor.environment import Slide
from imitor.errors import ImitorError, did_you_mean
from imitor.types import SIDES, Array


class Grips:
    """The grips of both hands on an object of the pipeline's ``environment``.

    A handle can be anywhere along its travel while it is held; the nearest of these places counts. So whether a hand
    is in contact depends on where it is alone, not on what was before.

    Args:
        environment: Objects, each with ``name`` and ``position_m``, and what they slide with.
        name: Which one is held.
        offset_m: Of the left hand's grip from the object's position, in world; mirrored for the right one.
        travel_m: How far and where to the object can be moved, in world; ``None``: as far as it slides.

    Attributes:
        closed: Both grips where the object is written, shape (2, 3) [m].
        travel: As given or found, shape (3,) [m].
        number: The object's place in the environment.
        moving: Places of all objects that slide with it, itself included; empty when it stands still.

    Raises:
        ImitorError: There is no such object, or it does not slide so.
    """

    def __init__(
        self,
        environment: Sequence[Mapping[str, Any]],
        name: str,
        offset_m: Sequence[float],
        travel_m: Sequence[float] | None,
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
        self.closed: Array = np.stack([position + offset, position + offset * (1.0, -1.0, 1.0)])
        names = list(objects)
        self.number = names.index(name)
        carrier = str(objects[name].get("part_of") or name)
        slide = objects.get(carrier, {}).get("slide")
        self.moving = [
            k for k, o in enumerate(objects.values()) if slide and carrier in (names[k], o.get("part_of"))
        ]
        self.travel: Array = _travel(carrier, Slide.model_validate(slide) if slide else None, travel_m)
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


def _travel(name: str, slide: Slide | None, given: Sequence[float] | None) -> Array:
    """Return how an object is moved: as given, if it can be, else as far as it slides, shape (3,) [m]."""
    if given is None:
        return np.zeros(3) if slide is None else slide.range_m * slide.direction()
    travel = np.asarray(given, dtype=float)
    if slide is not None:
        along = float(travel @ slide.direction())
        aside = float(np.linalg.norm(travel - along * slide.direction()))
        if aside > 1e-6 or not 0.0 <= along <= slide.range_m + 1e-9:
            raise ImitorError(
                f"travel_m {travel.tolist()} does not fit '{name}', which slides {slide.range_m} m along "
                f"{slide.direction().round(3).tolist()}; leave travel_m out for all of that"
            )
    return travel


__all__ = ["SIDES", "Grips"]
