"""The support polygon and the margin in it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor.metrics.polygon import Point, convex_hull, margin, margins

SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]

coordinate = st.integers(-8, 8).map(lambda i: i / 8) | st.floats(-1, 1).map(lambda x: round(x, 6))
point = st.tuples(coordinate, coordinate)


def brute_force_margin(p: Point, points: list[Point]) -> float:
    """Return the signed distance to a hull as the least gap to it over all directions that can matter.

    For a convex set with support function h, min over unit u of h(u) - u.p is the margin inside and minus the
    distance outside; u is normal to a pair of corners or points from a corner to p.
    """
    corners = np.array(points)
    pairs = [(b[1] - a[1], a[0] - b[0]) for a in points for b in points if a != b]
    rays = [(p[0] - a[0], p[1] - a[1]) for a in points if math.dist(p, a) > 1e-12]
    directions = np.array(pairs + rays + [(1.0, 0.0), (0.0, 1.0)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return float(((directions @ corners.T).max(axis=1) - directions @ np.array(p)).min())


def test_margin_in_a_square() -> None:
    hull = convex_hull([*SQUARE, (1.0, 1.0), (1.0, 0.0)])
    assert sorted(hull) == sorted(SQUARE)
    assert margin((1.0, 1.0), hull) == 1.0
    assert margin((0.25, 1.0), hull) == 0.25
    assert margin((0.0, 0.5), hull) == 0.0
    assert margin((3.0, 1.0), hull) == -1.0
    assert margin((5.0, 6.0), hull) == -5.0


def test_line_and_point_have_no_inside() -> None:
    line = convex_hull([(0.0, 0.0), (1.0, 0.0), (0.5, 0.0)])
    assert margin((0.5, 0.0), line) == 0.0
    assert margin((0.5, 0.2), line) == margin((0.5, -0.2), line) == -0.2
    assert margin((3.0, 4.0), convex_hull([(0.0, 0.0), (0.0, 0.0)])) == -5.0


def test_no_corner_gives_nan() -> None:
    out = margins(np.array([[1.0, 1.0], [1.0, 1.0]]), [SQUARE, []])
    assert out[0] == 1.0
    assert math.isnan(out[1])


@given(p=point, points=st.lists(point, min_size=1, max_size=9))
def test_margin_agrees_with_brute_force(p: Point, points: list[Point]) -> None:
    assert margin(p, convex_hull(points)) == pytest.approx(brute_force_margin(p, points), abs=1e-9)


@given(points=st.lists(point, min_size=1, max_size=9), dx=coordinate, turn=st.floats(-math.pi, math.pi))
def test_margin_moves_with_the_polygon(points: list[Point], dx: float, turn: float) -> None:
    c, s = math.cos(turn), math.sin(turn)

    def move(p: Point) -> Point:
        return c * p[0] - s * p[1] + dx, s * p[0] + c * p[1]

    before = margin((0.1, 0.2), convex_hull(points))
    after = margin(move((0.1, 0.2)), convex_hull([move(p) for p in points]))
    assert after == pytest.approx(before, abs=1e-9)
