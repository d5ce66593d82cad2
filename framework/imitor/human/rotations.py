"""Rotation matrices (T, 3, 3) for whole clips at once, from angles (T,) or vectors (T, 3)."""

from __future__ import annotations

import numpy as np

from imitor.types import Array


def about_x(angle: Array) -> Array:
    """Rotation about x by ``angle`` [rad], shape (T, 3, 3)."""
    return _about(angle, 0)


def about_y(angle: Array) -> Array:
    """Rotation about y by ``angle`` [rad], shape (T, 3, 3); positive leans z towards +x."""
    return _about(angle, 1)


def about_z(angle: Array) -> Array:
    """Rotation about z by ``angle`` [rad], shape (T, 3, 3)."""
    return _about(angle, 2)


def _about(angle: Array, axis: int) -> Array:
    angle = np.atleast_1d(np.asarray(angle, dtype=float))
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((len(angle), 3, 3))
    R[:, axis, axis] = 1.0
    R[:, i, i] = R[:, j, j] = c
    R[:, i, j], R[:, j, i] = -s, s
    return R


def yaw_pitch_roll(angles: Array) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll) of ``angles`` (T, 3) [rad]."""
    return about_z(angles[:, 0]) @ about_y(angles[:, 1]) @ about_x(angles[:, 2])


def cross_matrix(v: Array) -> Array:
    """Skew-symmetric matrices of ``v`` (T, 3)."""
    K = np.zeros((len(v), 3, 3))
    K[:, 2, 1], K[:, 0, 2], K[:, 1, 0] = v[:, 0], v[:, 1], v[:, 2]
    return K - K.transpose(0, 2, 1)


def exponential(v: Array) -> Array:
    """Rotation by the vectors ``v`` (T, 3) [rad], Rodrigues' formula."""
    angle = np.sqrt(np.einsum("ti,ti->t", v, v))
    # sin(a)/a and (1 - cos(a))/a^2 through sinc stay smooth at a = 0
    a = np.sinc(angle / np.pi)[:, None, None]
    b = 0.5 * np.sinc(angle / (2 * np.pi))[:, None, None] ** 2
    K = cross_matrix(v)
    return np.asarray(np.eye(3) + a * K + b * (K @ K))


def logarithm(R: Array) -> Array:
    """Rotation vectors (T, 3) [rad] of ``R``; of a half turn one of the two."""
    w = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    sine = np.sqrt(np.einsum("ti,ti->t", w, w))
    angle = np.arctan2(sine, 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0))
    out = np.asarray(w / np.sinc(angle / np.pi)[:, None])
    half = angle > np.pi - 1e-4  # the sine tells no axis there: (R + R^T) / 2 = cos I + (1 - cos) a a^T does
    if half.any():
        c = np.cos(angle[half])[:, None, None]
        square = (0.5 * (R[half] + R[half].transpose(0, 2, 1)) - c * np.eye(3)) / (1.0 - c)
        rows = np.arange(len(square))
        axis = unit(square[rows, np.einsum("tii->ti", square).argmax(axis=1)])
        along = np.where(np.einsum("ti,ti->t", axis, w[half]) < 0, -1.0, 1.0)
        out[half] = (along * angle[half])[:, None] * axis
    return out


def blend(R0: Array, R1: Array, share: Array) -> Array:
    """Rotation ``share`` (T,) of the way from ``R0`` to ``R1``, along the shortest turn."""
    return np.asarray(R0 @ exponential(share[:, None] * logarithm(R0.transpose(0, 2, 1) @ R1)))


def apply(R: Array, v: Array) -> Array:
    """Rotate ``v`` of shape (3,) or (T, 3) by ``R`` (T, 3, 3)."""
    if v.ndim == 1:
        return np.asarray(R @ v)
    return np.asarray(np.einsum("tij,tj->ti", R, v))


def unit(v: Array) -> Array:
    """Scale ``v`` (T, 3) to length one."""
    return np.asarray(v / np.sqrt(np.einsum("ti,ti->t", v, v))[:, None])
