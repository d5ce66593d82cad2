"""Phases of support over time: which the human has, which the robot executed, and where the CoM is between the feet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from imitor.balance.offset import offset_of
from imitor.types import SIDES, Array, BoolArray


@dataclass(frozen=True)
class Phase:
    """A stretch of frames, first to last, on the left foot, the right foot, both (``double``) or none (``flight``)."""

    mode: str
    first: int
    last: int

    @property
    def single(self) -> bool:
        """Whether it is on one foot."""
        return self.mode in SIDES


def phases(support: BoolArray) -> list[Phase]:
    """Return the phases of support (T, 2), in order."""
    names = {(True, True): "double", (True, False): "left", (False, True): "right", (False, False): "flight"}
    modes = [names[bool(left), bool(right)] for left, right in support]
    cuts = [i for i in range(1, len(modes)) if modes[i] != modes[i - 1]]
    return [Phase(modes[a], a, b - 1) for a, b in zip([0, *cuts], [*cuts, len(modes)], strict=True) if b > a]


def executed(human: BoolArray, robot: BoolArray, shortest: int = 1) -> Iterator[tuple[Phase, Phase | None]]:
    """Yield the human's single supports and the robot's that answers each, or ``None``.

    An answer is on the same foot and begins before the human's next single support does.

    Args:
        human, robot: Feet that stand, shape (T, 2).
        shortest: Least number of frames of a human's single support that counts.
    """
    asked = [p for p in phases(human) if p.single and p.last - p.first + 1 >= shortest]
    answers = [p for p in phases(robot) if p.single]
    for phase, after in zip(asked, [*asked[1:], None], strict=False):
        end = len(human) if after is None else after.first
        yield (
            phase,
            next((a for a in answers if a.mode == phase.mode and phase.first <= a.first < end), None),
        )


def offsets(com: Array, feet: Sequence[Array], support: BoolArray) -> Array:
    """Return the offset of a CoM (T, 3) on the line between the feet (T, 3) [koenemann2014] eq. 6, shape (T,) [-].

    Seen from above; a foot in the air counts where it last stood (or where it will stand, or where it was first).
    """
    left, right = (foot[_last_standing(on)] for foot, on in zip(feet, support.T, strict=True))
    on_the_floor = (points[:, :2] for points in (com, left, right))
    return np.array([offset_of(*row) for row in zip(*on_the_floor, strict=True)])


def _last_standing(on: BoolArray) -> Any:
    """Return for every frame the frame in which a foot last stood, shape (T,)."""
    first = int(on.argmax())
    return np.maximum.accumulate(np.where(on, np.arange(len(on)), first))
