"""Line plots as pictures: panels with axes, legends and bands of support, drawn large and scaled down."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from imitor.types import Array
from imitor.visual.palette import flat
from imitor.visual.panels import GREY, INK, Colour, Line, Outline, Panel, mixed

_PAPER: Final[Colour] = (255, 255, 255)
_GRID: Final[Colour] = (226, 229, 233)
_SCALE: Final = 2  # drawn so much larger, for smooth edges
_TEXT, _SMALL = 19, 16  # [px]
_MARGIN, _LABELS, _STRIP = 14, 84, 20  # [px]
_TINT: Final = 0.28  # how strong a band's colour is behind the lines


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers within a range: steps of 1, 2 or 5 times a power of ten, at most one more than ``most``."""
    if not high > low:
        return [low]
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(f * power for f in (1.0, 2.0, 5.0, 10.0) if f * power >= rough * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    return [round(k * step, 12) for k in range(first, last + 1)]


def draw(panels: Sequence[Panel], size_px: tuple[int, int], columns: int = 1) -> Any:
    """Return the panels, row by row, as a PIL image of few colours.

    Args:
        panels: What to draw.
        size_px: Width and height of the picture [px].
        columns: Panels in a row.
    """
    from PIL import Image

    width, height = (_SCALE * n for n in size_px)
    image = Image.new("RGB", (width, height), _PAPER)
    rows = -(-len(panels) // columns)
    for k, panel in enumerate(panels):
        column, row = k % columns, k // columns
        box = (
            width * column // columns,
            height * row // rows,
            width * (column + 1) // columns,
            height * (row + 1) // rows,
        )
        _Axes(image, panel, box).draw()
    return flat(image.resize(size_px, Image.Resampling.LANCZOS))


class _Axes:
    """Draws one panel into its box (left, top, right, bottom) [drawn px]."""

    def __init__(self, image: Any, panel: Panel, box: tuple[int, int, int, int]) -> None:
        from PIL import ImageDraw, ImageFont

        self._image, self._panel, self._box = image, panel, box
        self._pen = ImageDraw.Draw(image)
        self._font = ImageFont.load_default(_SCALE * _TEXT)
        self._small = ImageFont.load_default(_SCALE * _SMALL)
        self._labels = [(o.label, o.colour, False) for o in panel.outlines if o.label]
        self._labels += [(line.label, line.colour, line.dashed) for line in panel.lines if line.label]
        left, top, right, bottom = box
        head = _MARGIN + 1.5 * _TEXT + (1.6 * _SMALL if self._labels else 0) + _STRIP * len(panel.strips)
        self._left, self._right = left + _SCALE * _LABELS, right - _SCALE * (_MARGIN + 8)
        self._top = top + round(_SCALE * (head + 6))
        self._bottom = bottom - _SCALE * (_MARGIN + 2 * _TEXT + 14)
        self._x, self._y = self._ranges()

    def _ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        panel = self._panel
        points = [np.column_stack([line.x, line.y]) for line in panel.lines]
        cloud = np.vstack(
            [*points, *(np.asarray(o.points, dtype=float) for o in panel.outlines), np.zeros((0, 2))]
        )
        cloud = cloud[np.isfinite(cloud).all(axis=1)]
        if not len(cloud):
            return (0.0, 1.0), panel.y_range or (0.0, 1.0)
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        span = np.maximum(high - low, 1e-6)
        if not panel.equal:
            y = panel.y_range or (float(low[1] - 0.06 * span[1]), float(high[1] + 0.06 * span[1]))
            return (float(low[0]), float(low[0] + span[0])), y
        size = np.array([self._right - self._left, self._bottom - self._top], dtype=float)
        metres = size * float((1.08 * span / size).max()) / 2.0
        middle = (low + high) / 2.0
        (x0, y0), (x1, y1) = (middle - metres).tolist(), (middle + metres).tolist()
        return (x0, x1), (y0, y1)

    def _at(self, x: Any, y: Any) -> Any:
        (x0, x1), (y0, y1) = self._x, self._y
        px = self._left + (np.asarray(x, dtype=float) - x0) / (x1 - x0) * (self._right - self._left)
        py = self._bottom - (np.asarray(y, dtype=float) - y0) / (y1 - y0) * (self._bottom - self._top)
        return px, py

    def draw(self) -> None:
        """Draw everything, from back to front."""
        self._strips()
        self._grid()
        for outline in self._panel.outlines:  # all of the surfaces lie under all of the edges
            self._pen.polygon(self._corners(outline), mixed(outline.colour, 0.15) if outline.fill else None)
        for outline in self._panel.outlines:
            corners = self._corners(outline)
            self._pen.line([*corners, corners[0]], outline.colour, 2 * _SCALE, "curve")
        for line in self._panel.lines:
            self._line(line)
        self._frame()
        self._head()

    def _strips(self) -> None:
        pen, height = self._pen, _SCALE * _STRIP
        top = self._top - height * len(self._panel.strips) - 2 * _SCALE
        for strip in self._panel.strips:
            bottom = top + height - 3 * _SCALE
            pen.text((self._left - 8 * _SCALE, (top + bottom) / 2), strip.label, INK, self._small, "rm")
            for begin, end, colour, text in strip.spans:
                (x0, x1), _ = self._at([begin, end], [0, 0])
                pen.rectangle((x0, top, x1, bottom), colour)
                if strip.shade:
                    pen.rectangle((x0, self._top, x1, self._bottom), mixed(colour, _TINT))
                if pen.textlength(text, self._small) < x1 - x0 - 6 * _SCALE:
                    pen.text(((x0 + x1) / 2, (top + bottom) / 2), text, INK, self._small, "mm")
            top += height

    def _grid(self) -> None:
        pen, gap = self._pen, 6 * _SCALE
        for x in ticks(*self._x, max(3, (self._right - self._left) // (_SCALE * 90))):
            px, _ = self._at(x, 0)
            pen.line((px, self._top, px, self._bottom), _GRID, _SCALE)
            pen.text((px, self._bottom + gap), f"{x:g}", INK, self._small, "ma")
        for y in ticks(*self._y, max(3, (self._bottom - self._top) // (_SCALE * 36))):
            _, py = self._at(0, y)
            pen.line((self._left, py, self._right, py), _GRID, _SCALE)
            pen.text((self._left - gap, py), f"{y:g}", INK, self._small, "rm")

    def _line(self, line: Line) -> None:
        width = round(_SCALE * line.width_px)
        x, y = self._at(line.x, np.clip(line.y, *self._y))
        for piece in _pieces(np.column_stack([x, y])):
            for part in _dashes(piece, _SCALE * 9.0, _SCALE * 6.0) if line.dashed else [piece]:
                self._pen.line([tuple(p) for p in part.tolist()], line.colour, width, "curve")

    def _corners(self, outline: Outline) -> list[tuple[float, float]]:
        x, y = self._at(*np.asarray(outline.points).T)
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def _frame(self) -> None:
        self._pen.rectangle((self._left, self._top, self._right, self._bottom), None, GREY, _SCALE)

    def _head(self) -> None:
        from PIL import Image, ImageDraw

        left, top, _, bottom = self._box
        pen, panel, y = self._pen, self._panel, top + _SCALE * (_MARGIN + _TEXT // 2)
        pen.text((self._left, y), panel.title, INK, self._font, "lm", stroke_width=1, stroke_fill=INK)
        x, y = float(self._left), y + round(1.45 * _SCALE * _TEXT)
        for label, colour, dashed in self._labels:
            for part in range(2 if dashed else 1):
                start = x + part * 17 * _SCALE
                pen.line((start, y, start + (11 if dashed else 28) * _SCALE, y), colour, 3 * _SCALE)
            x += 36 * _SCALE
            pen.text((x, y), label, INK, self._small, "lm")
            x += pen.textlength(label, self._small) + 26 * _SCALE
        middle = (self._left + self._right) / 2
        pen.text((middle, bottom - _SCALE * _MARGIN), panel.x_label, INK, self._small, "md")
        size = (round(pen.textlength(panel.y_label, self._small)) + 4, round(1.4 * self._small.size))
        text = Image.new("RGB", size, _PAPER)
        ImageDraw.Draw(text).text((size[0] / 2, size[1] / 2), panel.y_label, INK, self._small, "mm")
        turned = text.rotate(90, expand=True)
        self._image.paste(turned, (left + 8 * _SCALE, (self._top + self._bottom - turned.height) // 2))


def _pieces(points: Array) -> Iterator[Array]:
    """Yield the runs of finite points that have at least two."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    for piece in np.split(points, bad):
        finite = piece[np.isfinite(piece).all(axis=1)]
        if len(finite) > 1:
            yield finite


def _dashes(points: Array, on: float, off: float) -> Iterator[Array]:
    """Yield the dashes of a polyline, on and off measured along it."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    for begin in np.arange(0.0, along[-1], on + off):
        end = min(begin + on, along[-1])
        inner = along[(along > begin) & (along < end)]
        at = np.concatenate([[begin], inner, [end]])
        yield np.column_stack([np.interp(at, along, points[:, k]) for k in range(2)])
