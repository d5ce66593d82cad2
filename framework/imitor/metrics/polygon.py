"""The support polygon: the convex hull of points on the floor, and how far inside it a point lies."""

from __future__ import annotations

import math
from collections.abc import Sequence

from imitor.types import Array

Point = tuple[float, float]


def convex_hull(points: Sequence[Point]) -> list[Point]:
    """Return the corners of the convex hull, counter-clockwise, by Andrew's monotone chain [andrew1979].

    One corner for coincident points, two for points on a line.
    """
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered
    chains: list[list[Point]] = []
    for sequence in (ordered, ordered[::-1]):
        chain: list[Point] = []
        for p in sequence:
            x, y = p
            while len(chain) > 1:  # the turn is written out: this is the inner loop of every balance
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                    break
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return chains[0] + chains[1]


def margin(point: Point, hull: Sequence[Point]) -> float:
    """Return the distance of a point to the boundary of a hull [m], negative outside.

    A hull without area (a line, a point) has no inside: the margin is 0 on it and negative elsewhere.

    Args:
        point: Where, e.g. the CoM over the floor [m].
        hull: Corners from `convex_hull`, at least one.
    """
    if len(hull) == 1:
        return -math.dist(point, hull[0])
    inside = len(hull) > 2
    nearest = math.inf
    for a, b in zip(hull, [*hull[1:], hull[0]], strict=True):
        inside = inside and _turn(a, b, point) >= 0.0
        nearest = min(nearest, _distance(point, a, b))
    return nearest if inside else -nearest


def margins(points: Array, hulls: Sequence[Sequence[Point]]) -> list[float]:
    """Return the margin of each point (T, 2) in its hull [m]; NaN where the hull has no corner."""
    return [
        margin((x, y), hull) if hull else math.nan
        for (x, y), hull in zip(points.tolist(), hulls, strict=True)
    ]


def _turn(a: Point, b: Point, c: Point) -> float:
    """Return twice the area of the triangle a b c, positive where it turns left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _distance(p: Point, a: Point, b: Point) -> float:
    """Return the distance of a point to the segment a b."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy)
    share = min(max(share, 0.0), 1.0)
    return math.hypot(p[0] - a[0] - share * dx, p[1] - a[1] - share * dy)
