"""A figure of quality: its name with the unit, how it is taken, and what it is good for, in one place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from imitor.metrics.run import Run

BETTER: Final = ("lower", "higher", "neither")
"""Which direction of a figure is good; ``neither`` describes the motion."""


@dataclass(frozen=True)
class Unmeasured:
    """A figure that could not be taken, and why."""

    reason: str


@dataclass(frozen=True)
class Sample:
    """The statistics of a figure.

    Attributes:
        values: Statistic -> number (or the name of the worst joint or pair).
        frames: How many frames it was taken over.
    """

    values: Mapping[str, Any]
    frames: int

    @classmethod
    def over(cls, values: ArrayLike, *, reason: str, **more: Any) -> Sample | Unmeasured:
        """Return mean and max of one value a frame; NaN marks a frame in which it was not taken.

        Args:
            values: One number a frame, shape (T,).
            reason: Why nothing was measured, should every value be NaN.
            more: Further statistics.
        """
        taken = np.asarray(values, dtype=float)
        taken = taken[~np.isnan(taken)]
        if not taken.size:
            return Unmeasured(reason)
        return cls({"mean": taken.mean(), "max": taken.max(), **more}, taken.size)

    @classmethod
    def count(cls, hits: ArrayLike, taken: ArrayLike, *, reason: str, **more: Any) -> Sample | Unmeasured:
        """Return the number and share of frames in which something is so.

        Args:
            hits: Whether it is so, shape (T,).
            taken: Whether it can be told in this frame, shape (T,).
            reason: Why nothing was measured, should it never be told.
            more: Further statistics.
        """
        asked = np.asarray(taken, dtype=bool)
        frames = int(asked.sum())
        if not frames:
            return Unmeasured(reason)
        count = int((np.asarray(hits, dtype=bool) & asked).sum())
        return cls({"count": count, "share": count / frames, **more}, frames)

    def as_dict(self) -> dict[str, Any]:
        """Return the statistics with the number of frames."""
        return {**self.values, "frames": self.frames}

    @property
    def finite(self) -> bool:
        """Whether every number is one."""
        return all(isinstance(v, str) or np.isfinite(v) for v in self.values.values())


Outcome = Sample | Unmeasured


@dataclass(frozen=True)
class Figure:
    """One figure, or a family of figures for which ``{...}`` in the name stands.

    Attributes:
        name: Key in ``metrics.json``, ending with the unit.
        unit: Unit of its values.
        formula: How a frame's value is computed, as text.
        better: One of `BETTER`.
        about: What it is good for.
        take: Computes it: the outcome, or one outcome a member of the family.
        members: What stands for the braces, in order; empty for a single figure.
    """

    name: str
    unit: str
    formula: str
    better: str
    about: str
    take: Callable[[Run], Outcome | Mapping[str, Outcome]]
    members: tuple[str, ...] = ()

    def measure(self, run: Run) -> dict[str, Outcome]:
        """Return the outcome under each full name."""
        outcome = self.take(run)
        if isinstance(outcome, Sample | Unmeasured):
            outcome = {"": outcome}
        return {self.full_name(member): self._checked(o) for member, o in outcome.items()}

    def full_name(self, member: str) -> str:
        """Return the key of one member of the family."""
        before, brace, rest = self.name.partition("{")
        return f"{before}{member}{rest.partition('}')[2]}" if brace else self.name

    @property
    def full_names(self) -> list[str]:
        """Every key under which the figure or its reason can appear."""
        return [self.full_name(m) for m in self.members] if self.members else [self.name]

    @staticmethod
    def _checked(outcome: Outcome) -> Outcome:
        if isinstance(outcome, Sample) and not outcome.finite:
            return Unmeasured("its value is not finite")
        return outcome


def figure(
    name: str, *, unit: str, formula: str, better: str, about: str, members: tuple[str, ...] = ()
) -> Callable[[Callable[[Run], Outcome | Mapping[str, Outcome]]], Figure]:
    """Make a figure of the function that takes it."""

    def wrap(take: Callable[[Run], Outcome | Mapping[str, Outcome]]) -> Figure:
        return Figure(name, unit, formula, better, about, take, members)

    return wrap
