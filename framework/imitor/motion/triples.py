"""Single vectors as three floats: for one frame plain floats beat arrays of length 1 by far. NaN stays NaN."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from imitor.ik.vectors import cross3 as cross

Vector = Sequence[float]
Triple = tuple[float, float, float]

NOWHERE: Final[Triple] = (math.nan, math.nan, math.nan)


def plus(a: Vector, b: Vector, share: float = 1.0) -> Triple:
    """Return a + share b."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


def minus(a: Vector, b: Vector) -> Triple:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def towards(a: Vector, b: Vector, share: float = 0.5) -> Triple:
    """Return the point ``share`` of the way from a to b."""
    return plus(a, minus(b, a), share)


def dot(a: Vector, b: Vector) -> float:
    """Return a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def length(a: Vector) -> float:
    """Return the length of a."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def unit(a: Vector) -> Triple:
    """Return a at length 1; NaN of zero."""
    size = length(a)
    if not size > 0.0:
        return NOWHERE
    return a[0] / size, a[1] / size, a[2] / size


def across(a: Vector, along: Vector) -> Triple:
    """Return the part of a at right angles to a unit vector."""
    return plus(a, along, -dot(a, along))


def known(a: Vector) -> bool:
    """Tell whether a is finite."""
    return math.isfinite(a[0] + a[1] + a[2])


__all__ = [
    "NOWHERE",
    "Triple",
    "Vector",
    "across",
    "cross",
    "dot",
    "known",
    "length",
    "minus",
    "plus",
    "towards",
    "unit",
]
