"""Where hands take hold of an object, along the way that it can be moved, and how near to it a hand is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from imitor.environment import Slide, rotation
from imitor.errors import ImitorError, did_you_mean
from imitor.types import SIDES, Array

_MIRROR: Final = np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, 1.0]])
"""What the elements of a rotation are multiplied with when left and right change places."""


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
                + f"; it has: {', '.join(objects) or 'none'}; to hold nothing: object: null"
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

    def poses(self, rpy_rad: Sequence[float], room_m: float) -> list[Array]:
        """Return poses of both hands that span the contact, each shape (2, 4, 4), one after the other near the last.

        At the ends of the travel hands also go a little to each side, for they come to the grip and leave it.

        Args:
            rpy_rad: How the left hand is turned at its grip, about world's x, y, z; mirrored for the right one [rad].
            room_m: How far to each side [m].
        """
        turn = rotation(rpy_rad)
        sides = room_m * np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        out = []
        for share, aside in ((0.0, sides), (0.5, sides[:1]), (1.0, sides)):
            for off in aside:
                both = np.tile(np.eye(4), (2, 1, 1))
                both[0, :3, :3], both[1, :3, :3] = turn, _MIRROR * turn
                both[:, :3, 3] = self.closed + share * self.travel + [off, off * (1.0, -1.0, 1.0)]
                out.append(both)
        return out


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
