"""A contact sheet: evenly spaced pictures of a run, each with its time, under one title."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_PAPER: Final = (255, 255, 255)
_INK: Final = (52, 60, 70)
_GAP: Final = 6  # [px]


def tile_size(shape_px: tuple[int, int], columns: int, width_px: int) -> tuple[int, int]:
    """Return width and height of the pictures of a sheet [px].

    Args:
        shape_px: Width and height of the video, whose shape is kept [px].
        columns: Pictures in a row.
        width_px: Width of the sheet [px].
    """
    width = (width_px - (columns + 1) * _GAP) // columns
    return width, round(width * shape_px[1] / shape_px[0])


def contact_sheet(
    pictures: Sequence[NDArray[np.uint8]], times_s: Sequence[float], title: str, columns: int, width_px: int
) -> Any:
    """Return the sheet as a PIL image.

    Args:
        pictures: All of one size, not smaller than `tile_size`, shape (height, width, 3).
        times_s: Their times [s].
        title: Written above; nothing for an empty one.
        columns: Pictures in a row.
        width_px: Width of the sheet [px].
    """
    from PIL import Image, ImageDraw, ImageFont

    height, width = pictures[0].shape[:2]
    tile_w, tile_h = tile_size((width, height), columns, width_px)
    small = ImageFont.load_default(min(max(11, round(0.045 * tile_w)), round(0.0125 * width_px)))
    large = ImageFont.load_default(max(14, round(0.016 * width_px)))
    top = round(1.9 * large.size) + _GAP if title else _GAP
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (width_px, top + rows * (tile_h + _GAP)), _PAPER)
    draw = ImageDraw.Draw(sheet)
    if title:
        draw.text((2 * _GAP, top // 2), title, fill=_INK, font=large, anchor="lm")
    for k, (picture, time_s) in enumerate(zip(pictures, times_s, strict=True)):
        x = _GAP + (k % columns) * (tile_w + _GAP)
        y = top + (k // columns) * (tile_h + _GAP)
        sheet.paste(Image.fromarray(picture).resize((tile_w, tile_h), Image.Resampling.LANCZOS), (x, y))
        draw.text((x + 2 * _GAP, y + 2 * _GAP), f"{time_s:.2f} s", fill=_INK, font=small)
    return sheet
