"""Plots and panels: ticks are round, curves are where their data are, the picture is small and the same each time."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor.visual.panels import BLUE, RED, Colour, Line, Outline, Panel, Strip, mixed
from imitor.visual.plot import draw, ticks

SIZE = (600, 300)


def pixels(*panels: Panel, columns: int = 1) -> np.ndarray:
    return np.asarray(draw(panels, SIZE, columns).convert("RGB")).astype(int)


def near(picture: np.ndarray, colour: Colour, within: int = 60) -> np.ndarray:
    """Return (row, column) of the pixels of about a colour."""
    return np.argwhere(np.abs(picture - np.array(colour)).max(axis=2) < within)


def panel(*lines: Line, **more: Any) -> Panel:
    return Panel("title", "x [s]", "y [m]", lines, **more)


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4), st.integers(2, 12))
def test_ticks_are_round_and_inside(low: float, span: float, most: int) -> None:
    high = low + span
    found = ticks(low, high, most)
    assert len(found) <= most + 1
    assert all(low - 1e-5 * span <= t <= high + 1e-5 * span for t in found)
    if len(found) > 1:
        steps = np.diff(found)
        digits = steps[0] / 10.0 ** np.floor(np.log10(steps[0]) + 1e-6)
        assert np.isclose(steps, steps[0], rtol=1e-4).all()
        assert min(abs(digits - d) for d in (1, 2, 5)) < 1e-3


def test_a_range_without_extent_has_one_tick() -> None:
    assert ticks(3.0, 3.0, 5) == [3.0]


def test_a_rising_line_rises() -> None:
    x = np.linspace(0.0, 1.0, 50)
    found = near(pixels(panel(Line(x, x))), BLUE)
    left, right = found[found[:, 1] < 200], found[found[:, 1] > 450]
    assert len(left) and len(right)
    assert left[:, 0].mean() > right[:, 0].mean() + 80  # rows count from the top


def test_a_gap_in_the_data_is_a_gap_in_the_line() -> None:
    x = np.linspace(0.0, 1.0, 101)
    whole, broken = np.zeros(101), np.zeros(101)
    broken[40:60] = np.nan
    columns = [len(np.unique(near(pixels(panel(Line(x, y))), BLUE)[:, 1])) for y in (whole, broken)]
    assert columns[1] == pytest.approx(0.79 * columns[0], rel=0.05)


def test_a_dashed_line_covers_less() -> None:
    x = np.linspace(0.0, 1.0, 101)
    solid, dashed = (len(near(pixels(panel(Line(x, x, dashed=d))), BLUE)) for d in (False, True))
    assert 0.4 * solid < dashed < 0.8 * solid


def test_equal_axes_keep_a_square_square() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    found = near(pixels(panel(outlines=[Outline(square, colour=RED)], equal=True)), RED)
    height, width = np.ptp(found, axis=0)
    assert width == pytest.approx(height, abs=2)


def test_a_strip_shades_what_it_stands_over() -> None:
    x = np.linspace(0.0, 2.0, 20)
    strip = Strip("robot", [(0.0, 1.0, BLUE, "left")], shade=True)
    picture = pixels(panel(Line(x, x, colour=RED), strips=[strip]))
    shaded = near(picture, mixed(BLUE, 0.28), 4)
    left, right = 84, 600 - 22  # the axes
    assert shaded[:, 1].min() == pytest.approx(left, abs=3)
    assert shaded[:, 1].max() == pytest.approx((left + right) / 2, abs=3)


def test_panels_stand_side_by_side_and_the_picture_is_small_and_repeatable() -> None:
    t = np.linspace(0.0, 6.0, 400)
    panels = [panel(Line(t, np.sin(k * t), "sine", colour)) for k, colour in ((1, BLUE), (2, RED))]
    picture = pixels(*panels, columns=2)
    assert near(picture, BLUE)[:, 1].max() < 300 < near(picture, RED)[:, 1].min()
    saved = []
    for _ in range(2):
        stream = io.BytesIO()
        draw(panels, SIZE, 2).save(stream, format="PNG", optimize=True)
        saved.append(stream.getvalue())
    assert saved[0] == saved[1]
    assert len(saved[0]) < 50_000


def test_a_panel_without_data_is_drawn() -> None:
    nothing = np.full(3, np.nan)
    assert pixels(panel(Line(nothing, nothing))).shape == (*SIZE[::-1], 3)
