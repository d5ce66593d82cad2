"""Small vector kernels on arrays of vectors; numpy's general versions cost more than the arithmetic."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.types import Array


def cross(a: Array, b: Array) -> Array:
    """Return a x b over the last axis, with broadcasting, shape (..., 3)."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a1 * b2 - a2 * b1
    out[..., 1] = a2 * b0 - a0 * b2
    out[..., 2] = a0 * b1 - a1 * b0
    return out


def cross3(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """Return a x b of two single vectors given as floats; for one vector plain floats beat arrays."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def skew(p: Array) -> Array:
    """Return the matrices [p]x with [p]x v = p x v, shape (..., 3, 3)."""
    out = np.zeros((*p.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -p[..., 2], p[..., 1]
    out[..., 1, 0], out[..., 1, 2] = p[..., 2], -p[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -p[..., 1], p[..., 0]
    return out


def tangent_basis(d: Array) -> Array:
    """Return two unit vectors orthogonal to each unit vector and to each other, shape (S, 2, 3).

    Continuous but at z = 0; formulas without branches after [duff2017].
    """
    x, y, z = d[:, 0], d[:, 1], d[:, 2]
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    out = np.empty((d.shape[0], 2, 3))
    out[:, 0, 0] = 1.0 + sign * x * x * a
    out[:, 0, 1] = sign * b
    out[:, 0, 2] = -sign * x
    out[:, 1, 0] = b
    out[:, 1, 1] = sign + y * y * a
    out[:, 1, 2] = -y
    return out
