"""Pictures of few colours: small files that look the same."""

from __future__ import annotations

from typing import Any

import numpy as np


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


def flat(image: Any) -> Any:
    """Return a drawn PIL image in its 256 most frequent colours: surfaces and lines stay exact, soft edges nearly."""
    from PIL import Image

    red, green, blue = np.moveaxis(np.asarray(image.convert("RGB"), dtype=np.int32), -1, 0)
    codes, where, counts = np.unique(red << 16 | green << 8 | blue, return_inverse=True, return_counts=True)
    colours = np.stack([codes >> 16, codes >> 8 & 255, codes & 255], axis=1)
    kept = colours[np.argsort(-counts, kind="stable")[:256]]
    nearest = ((colours[:, None] - kept) ** 2).sum(axis=2).argmin(axis=1).astype(np.uint8)
    out = Image.fromarray(nearest[where].reshape(red.shape))
    out.putpalette(kept.ravel().tolist())
    return out
