"""What a plot shows: panels with curves, outlines and bars of support; `imitor.visual.plot` draws them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from imitor.types import Array

Colour = tuple[int, int, int]

BLUE: Final[Colour] = (0, 114, 178)
RED: Final[Colour] = (213, 94, 0)
GREEN: Final[Colour] = (0, 158, 115)
PURPLE: Final[Colour] = (170, 90, 150)
INK: Final[Colour] = (40, 46, 54)
GREY: Final[Colour] = (140, 147, 156)


def mixed(colour: Colour, share: float) -> Colour:
    """Return a colour thinned with white."""
    r, g, b = (round(255 - share * (255 - c)) for c in colour)
    return r, g, b


@dataclass(frozen=True)
class Line:
    """One curve; NaN interrupts it.

    Attributes:
        x, y: Its points, shape (T,) each.
        label: For the legend; empty for none.
    """

    x: Array
    y: Array
    label: str = ""
    colour: Colour = BLUE
    dashed: bool = False
    width_px: float = 2.2


@dataclass(frozen=True)
class Outline:
    """A closed polygon, its corners in order, shape (K, 2)."""

    points: Array
    label: str = ""
    colour: Colour = GREY
    fill: bool = True


@dataclass(frozen=True)
class Strip:
    """A bar over the axes that says what holds when.

    Attributes:
        label: Written before it.
        spans: (begin, end, colour, text) along x.
        shade: Whether the colours also lie, lighter, behind the curves.
    """

    label: str
    spans: Sequence[tuple[float, float, Colour, str]]
    shade: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes with what is drawn in it.

    Attributes:
        equal: Whether a unit is equally long along both axes, as in a map.
        y_range: Ends of the y axis; from the data where it is ``None``.
    """

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line] = ()
    outlines: Sequence[Outline] = ()
    strips: Sequence[Strip] = ()
    equal: bool = False
    y_range: tuple[float, float] | None = None
