"""Quaternions of the wire: to rotation matrices, with what is no rotation lost; and back."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.types import Array

TOLERANCE: Final = 0.01
"""How far the length of a quaternion may be from 1 [-]; rounding is far less, what is more is no rotation."""


def _products() -> Array:
    """Return the matrix from the 16 products of a quaternion's components to the 9 entries of its rotation."""
    w, x, y, z = range(4)
    terms = (
        ((w, w, 1), (x, x, 1), (y, y, -1), (z, z, -1)), ((x, y, 2), (w, z, -2)), ((x, z, 2), (w, y, 2)),
        ((x, y, 2), (w, z, 2)), ((w, w, 1), (x, x, -1), (y, y, 1), (z, z, -1)), ((y, z, 2), (w, x, -2)),
        ((x, z, 2), (w, y, -2)), ((y, z, 2), (w, x, 2)), ((w, w, 1), (x, x, -1), (y, y, -1), (z, z, 1)),
    )  # fmt: skip
    out = np.zeros((16, 9))
    for entry, sum_ in enumerate(terms):
        for i, j, factor in sum_:
            out[4 * i + j, entry] = factor
    return out


_PRODUCTS: Final = _products()


def rotations(wxyz: Array) -> Array:
    """Return the rotations of quaternions w x y z, shape (..., 3, 3); NaN where one is not of length 1."""
    q = wxyz.reshape(-1, 4)
    squared = np.einsum("ki,ki->k", q, q)
    squared[np.abs(np.sqrt(squared) - 1.0) > TOLERANCE] = np.nan
    products = (q[:, :, None] * (q / squared[:, None])[:, None, :]).reshape(-1, 16)
    return np.asarray(np.dot(products, _PRODUCTS).reshape(*wxyz.shape[:-1], 3, 3))


def quaternions(R: Array) -> Array:
    """Return w x y z of rotations, shape (..., 4), w not negative; NaN for NaN.

    Of the four products of a quaternion with its own components, all of which the matrix holds, the longest is taken.
    """
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(R, (-2, -1), (0, 1))
    rows = (
        (1 + a + e + i, h - f, c - g, d - b),
        (h - f, 1 + a - e - i, d + b, c + g),
        (c - g, d + b, 1 - a + e - i, h + f),
        (d - b, c + g, h + f, 1 - a - e + i),
    )
    products = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    best = np.argmax(np.stack([products[..., k, k] for k in range(4)], axis=-1), axis=-1)
    q = np.take_along_axis(products, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.sqrt(np.einsum("...i,...i->...", q, q))[..., None]
    return np.asarray(np.where(q[..., :1] < 0.0, -q, q))


__all__ = ["quaternions", "rotations"]
