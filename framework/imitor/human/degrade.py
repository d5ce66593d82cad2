"""What a real capture adds to the truth: seeded noise, bursts of loss, and skin that moves over the bones."""

from __future__ import annotations

import numpy as np

from imitor.human.rotations import exponential
from imitor.types import Array, BoolArray


def noise(rng: np.random.Generator, shape: tuple[int, ...], std: float) -> Array:
    """White Gaussian noise of standard deviation ``std``."""
    return np.asarray(rng.normal(0.0, std, shape))


def rotation_noise(rng: np.random.Generator, n: int, std_rad: float) -> Array:
    """Rotations (n, 3, 3) about random axes, their vectors with standard deviation ``std_rad`` [rad]."""
    return exponential(rng.normal(0.0, std_rad, (n, 3)))


def lost(
    rng: np.random.Generator, n_frames: int, n_points: int, share: float, burst_frames: float
) -> BoolArray:
    """Return when each point is lost, shape (T, N): bursts of geometric length, independent between points.

    Args:
        rng: Source of randomness.
        n_frames: Number of frames T.
        n_points: Number of points N.
        share: Probability that a point is lost in a frame [-].
        burst_frames: Mean length of a loss [frames], at least 1.
    """
    out = np.zeros((n_frames, n_points), dtype=bool)
    if share <= 0.0:
        return out
    end = 1.0 / max(burst_frames, 1.0)
    begin = min(end * share / (1.0 - share), 1.0)  # keeps the share stationary
    draw = rng.random((n_frames, n_points))
    state = draw[0] < share
    for i in range(n_frames):
        if i:
            state = np.where(state, draw[i] >= end, draw[i] < begin)
        out[i] = state
    return out


def band_limited(rng: np.random.Generator, time_s: Array, shape: tuple[int, ...], std: float) -> Array:
    """Return smooth random courses (T, *shape) of standard deviation ``std`` with content from 0.5 to 4 Hz.

    A sum of sines with random phases and directions, so its bandwidth does not depend on the frame rate.
    """
    waves = 12
    frequency = rng.uniform(0.5, 4.0, waves)
    size = int(np.prod(shape))
    cosine, sine = rng.normal(0.0, std / np.sqrt(waves), (2, waves, size))
    angle = 2 * np.pi * np.multiply.outer(time_s, frequency)
    return np.asarray((np.cos(angle) @ cosine + np.sin(angle) @ sine).reshape(len(time_s), *shape))
