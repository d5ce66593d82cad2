"""Smooth time courses of scalars and vectors; all are C2, as human movement is [flash1985]."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from imitor.types import Array


def minimum_jerk(s: Array) -> Array:
    """Rise from 0 to 1 over ``s`` in 0..1 with the least jerk: 10 s³ − 15 s⁴ + 6 s⁵ [flash1985]."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def rise(t: Array, start: float, end: float) -> Array:
    """Rise from 0 to 1 between the times ``start`` and ``end`` [s]."""
    return minimum_jerk((t - start) / (end - start))


def bump(t: Array, start: float, end: float) -> Array:
    """Go 0, 1, 0 between two times [s]: 64 s³ (1 − s)³, at rest at both ends."""
    s = np.clip((t - start) / (end - start), 0.0, 1.0)
    return np.asarray(64.0 * (s * (1.0 - s)) ** 3)


def plateau(t: Array, up: float, top: float, down: float, end: float) -> Array:
    """Rise from 0 to 1 over ``up``..``top``, stay, fall to 0 over ``down``..``end`` [s]."""
    return rise(t, up, top) - rise(t, down, end)


def keys(t: Array, points: Sequence[tuple[float, ArrayLike]]) -> Array:
    """Go from key to key by minimum jerk, at rest in each; before the first and after the last, stay.

    Args:
        t: Times (T,) [s].
        points: Pairs of a time [s] and a value, a scalar or a vector (n,).

    Returns:
        Shape (T,) or (T, n).
    """
    values = [np.asarray(v, dtype=float) for _, v in points]
    times = [time for time, _ in points]
    out = np.broadcast_to(values[0], (len(t), *values[0].shape)).copy()
    for (t0, t1), (v0, v1) in zip(pairwise(times), pairwise(values), strict=True):
        if np.any(v0 != v1):
            out += np.multiply.outer(rise(t, t0, t1), v1 - v0)
    return np.asarray(out)


def through(t: Array, points: Sequence[tuple[float, ArrayLike]]) -> Array:
    """Pass through the points without stopping: quintic Hermite pieces, at rest at both ends.

    The speed at an inner point is the mean slope over its two neighbours and the acceleration there is zero,
    which neighbouring pieces share: the course is C2.
    """
    times = np.array([time for time, _ in points])
    values = np.array([np.asarray(v, dtype=float) for _, v in points])
    span = (times[2:] - times[:-2]).reshape(-1, *([1] * (values.ndim - 1)))
    slope = np.zeros_like(values)
    slope[1:-1] = (values[2:] - values[:-2]) / span
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    h = times[i + 1] - times[i]
    s = np.clip((t - times[i]) / h, 0.0, 1.0)
    up = minimum_jerk(s)
    leave = s - 6 * s**3 + 8 * s**4 - 3 * s**5
    arrive = -4 * s**3 + 7 * s**4 - 3 * s**5
    if values.ndim == 2:
        up, leave, arrive, h = up[:, None], leave[:, None], arrive[:, None], h[:, None]
    return np.asarray(
        values[i] + up * (values[i + 1] - values[i]) + h * (leave * slope[i] + arrive * slope[i + 1])
    )


def lower_envelope(ceiling: Array, half: int) -> Array:
    """Return a smooth course that nowhere exceeds ``ceiling`` (T,).

    The least value within ``half`` samples, averaged over the same window with weights (1 − s²)³: an average
    of minima that each reach the sample at hand cannot exceed it.
    """
    if half < 1:
        return ceiling
    padded = np.pad(ceiling, 2 * half, mode="edge")
    least = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).min(axis=1)
    kernel = (1.0 - np.linspace(-1.0, 1.0, 2 * half + 3)[1:-1] ** 2) ** 3
    return np.convolve(least, kernel / kernel.sum(), mode="valid")
