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
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:  # turns left
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
    x, y = point
    ax, ay = hull[-1]
    for bx, by in hull:
        dx, dy, px, py = bx - ax, by - ay, x - ax, y - ay
        inside = inside and dx * py - dy * px >= 0.0
        share = min(max((px * dx + py * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        nearest = min(nearest, math.hypot(px - share * dx, py - share * dy))
        ax, ay = bx, by
    return nearest if inside else -nearest


def margins(points: Array, hulls: Sequence[Sequence[Point]]) -> list[float]:
    """Return the margin of each point (T, 2) in its hull [m]; NaN where the hull has no corner."""
    return [
        margin((x, y), hull) if hull else math.nan
        for (x, y), hull in zip(points.tolist(), hulls, strict=True)
    ]
