"""The clamping loop [baerlocher2004], [pennapoubel2014] section II-B3, with joint speeds.

Solve; fix every joint that leaves its range at the limit and zero its column; solve again with fewer joints, until
all hold. Joints that exceed their speed are fixed at it in the same way, but only in the first rounds, so that a slow
joint is helped by the others; what is then still too fast is slowed down as a whole, which keeps the levels' order: a
foot that has no error does not move when the step is scaled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.ik.hierarchy import prioritised_step
from imitor.types import Array

SPEED_ROUNDS = 2


def clamped_step(
    J: Array,
    e: Array,
    g: Array,
    starts: Sequence[int],
    damping2: Sequence[float],
    floor2: float,
    limits: tuple[Array, Array],
    speeds: tuple[Array, Array],
    first: int,
    max_step: float,
) -> tuple[Array, int]:
    """Return a prioritised step whose joint part stays within bounds, and the number of joints fixed.

    Args:
        J, e, g, starts, damping2, floor2: As for `imitor.ik.hierarchy.prioritised_step`, n columns.
        limits: Lowest and highest steps to the position limits, shapes (n - first,).
        speeds: Lowest and highest steps by speed, shapes (n - first,); not above and not below 0.
        first: Number of leading columns without bounds (a free base).
        max_step: Largest step of one iteration [rad]; a larger one is scaled as a whole before the bounds apply.
    """
    step = prioritised_step(J, e, g, starts, damping2, floor2)
    joints = step[first:]
    largest = float(np.abs(joints).max())
    if largest > max_step:
        share = max_step / largest
        e, g, step = share * e, share * g, share * step
        joints = step[first:]
    lowest, highest = np.maximum(limits[0], speeds[0]), np.minimum(limits[1], speeds[1])
    outside = (joints < lowest) | (joints > highest)
    if not outside.any():
        return step, 0
    fixed = np.zeros(joints.shape[0], dtype=bool)
    at = np.zeros(step.shape[0])
    fixed_at = at[first:]
    free_J, free_g = J.copy(), g.copy()
    for k in range(joints.shape[0]):
        fixed_at[outside] = np.clip(joints, lowest, highest)[outside]
        fixed |= outside
        free_J[:, first:][:, outside] = 0.0
        free_g[first:][outside] = 0.0
        step = prioritised_step(free_J, e - J @ at, free_g, starts, damping2, floor2)
        step += at
        joints = step[first:]
        joints[fixed] = fixed_at[fixed]
        bounds = (lowest, highest) if k + 1 < SPEED_ROUNDS else limits
        outside = ((joints < bounds[0]) | (joints > bounds[1])) & ~fixed
        if not outside.any():
            break
    return step * _share_within(joints, speeds), int(fixed.sum())


def _share_within(joints: Array, speeds: tuple[Array, Array]) -> float:
    """Return the largest share of a step, at most 1, that is within speed bounds."""
    room = np.where(joints > 0, speeds[1], speeds[0])
    fast = np.abs(joints) > np.abs(room)
    return float((room[fast] / joints[fast]).min(initial=1.0))
