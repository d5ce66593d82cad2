"""Quaternions of the wire: to rotation matrices, with what is no rotation lost; and back."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.types import Array

TOLERANCE: Final = 0.01
"""How far the length of a quaternion may be from 1 [-]; rounding is far less, what is more is no rotation."""


def rotations(wxyz: Array) -> Array:
    """Return the rotations of quaternions w x y z, shape (..., 3, 3); NaN where one is not of length 1."""
    length = np.sqrt(np.einsum("...i,...i->...", wxyz, wxyz))
    length = np.where(np.abs(length - 1.0) <= TOLERANCE, length, np.nan)
    w, x, y, z = np.moveaxis(wxyz / length[..., None], -1, 0)
    out = np.empty((*wxyz.shape[:-1], 3, 3))
    xx, yy, zz = 2 * x * x, 2 * y * y, 2 * z * z
    xy, xz, yz = 2 * x * y, 2 * x * z, 2 * y * z
    wx, wy, wz = 2 * w * x, 2 * w * y, 2 * w * z
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - yy - zz, xy - wz, xz + wy
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = xy + wz, 1 - xx - zz, yz - wx
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = xz - wy, yz + wx, 1 - xx - yy
    return out


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
