"""Quaternions of the wire to rotations and back."""

from __future__ import annotations

import numpy as np

from imitor.types import Array


def matrices(quaternion: Array) -> Array:
    """Return the rotations of quaternions w x y z of whatever length, shape (..., 3, 3); NaN of zero and NaN."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        q = quaternion / np.sqrt(np.einsum("...i,...i->...", quaternion, quaternion))[..., None]
        w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
        R = np.empty((*q.shape[:-1], 3, 3))
        R[..., 0, 0], R[..., 1, 1], R[..., 2, 2] = (
            1 - 2 * (y * y + z * z),
            1 - 2 * (x * x + z * z),
            1 - 2 * (x * x + y * y),
        )
        R[..., 0, 1], R[..., 1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
        R[..., 0, 2], R[..., 2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
        R[..., 1, 2], R[..., 2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
    # Numbers near the end of the range lose their last digits on the way to length 1: what is no rotation is not known.
    square = np.einsum("...i,...i->...", q, q)
    R[~(np.abs(square - 1.0) < 1e-9)] = np.nan
    return R


def quaternions(R: Array) -> Array:
    """Return the quaternions w x y z of rotations, w not negative, shape (..., 4); NaN of NaN.

    q qᵀ follows from R; its row with the largest diagonal, scaled to length 1, is q.
    """
    t = np.einsum("...ii->...", R)
    outer = np.empty((*R.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1.0 + t
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        outer[..., i + 1, i + 1] = 1.0 + 2.0 * R[..., i, i] - t
        outer[..., i + 1, j + 1] = outer[..., j + 1, i + 1] = R[..., i, j] + R[..., j, i]
        outer[..., i + 1, 0] = outer[..., 0, i + 1] = R[..., k, j] - R[..., j, k]
    row = np.argmax(np.einsum("...ii->...i", outer), axis=-1)
    q = np.take_along_axis(outer, row[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., :1] < 0.0, -q, q))


__all__ = ["matrices", "quaternions"]
