"""Pictures of few colours: small files that look the same."""

from __future__ import annotations

from typing import Any


def palette_of(image: Any) -> Any:
    """Return an image with 256 colours of a PIL image: most for large areas, some for strong marks, white exact."""
    from PIL import Image

    areas = image.quantize(207, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    marks = image.quantize(48, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    palette = Image.new("P", (1, 1))
    palette.putpalette([255, 255, 255, *areas.getpalette()[: 3 * 207], *marks.getpalette()[: 3 * 48]])
    return palette


def reduced(image: Any) -> Any:
    """Return a PIL image in its own 256 colours."""
    from PIL import Image

    return image.quantize(palette=palette_of(image), dither=Image.Dither.NONE)
