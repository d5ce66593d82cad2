"""The clamping loop [baerlocher2004], [pennapoubel2014] section II-B3, for position and speed limits alike.

Solve; fix the joint that leaves its range most at its limit and zero its column; solve again with fewer joints, until
all hold. One joint at a time, the worst first: the others often come back by themselves, and a joint fixed for
nothing is a joint lost. After `ONE_BY_ONE` rounds all that are outside are fixed together.

When so many joints are fixed that tasks above the last level which had no error begin to move (a standing foot would
slide), the step is solved with position limits only and slowed down as a whole: scaling keeps what has no error still.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.ik.hierarchy import prioritised_step
from imitor.types import Array

ONE_BY_ONE = 6
_STILL, _MOVED = 1e-3, 2e-3  # [m or rad]
Bounds = tuple[Array, Array]


def clamped_step(
    J: Array,
    e: Array,
    g: Array,
    starts: Sequence[int],
    damping2: Sequence[float],
    floor2: float | Array,
    limits: Bounds,
    speeds: Bounds,
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
    largest = float(np.abs(step[first:]).max())
    if largest > max_step:
        share = max_step / largest
        e, g, step = share * e, share * g, share * step
    lowest, highest = np.maximum(limits[0], speeds[0]), np.minimum(limits[1], speeds[1])
    joints = step[first:]
    if not ((joints < lowest) | (joints > highest)).any():
        return step, 0
    system = (J, e, g, starts, damping2, floor2)
    fixed_step, count = _fix_joints(step, system, (lowest, highest), first)
    if len(starts) > 1 and _disturbs(J, e, fixed_step, starts[-1]):
        fixed_step, count = _fix_joints(step, system, limits, first)
        fixed_step = fixed_step * _share_within(fixed_step[first:], speeds)
    return fixed_step, count


def _fix_joints(
    step: Array,
    system: tuple[Array, Array, Array, Sequence[int], Sequence[float], float | Array],
    bounds: Bounds,
    first: int,
) -> tuple[Array, int]:
    """Run the loop from an unbounded step."""
    J, e, g, starts, damping2, floor2 = system
    lowest, highest = bounds
    joints = step[first:]
    n = joints.shape[0]
    fixed = np.zeros(n, dtype=bool)
    at = np.zeros(step.shape[0])
    fixed_at = at[first:]
    free_J, free_g = J.copy(), g.copy()
    for k in range(n):
        excess = np.maximum(joints - highest, lowest - joints)
        excess[fixed] = 0.0
        worst = int(excess.argmax())
        if excess[worst] <= 0.0:
            break
        chosen = [worst] if k < ONE_BY_ONE else np.flatnonzero(excess > 0.0)
        fixed_at[chosen] = np.minimum(np.maximum(joints[chosen], lowest[chosen]), highest[chosen])
        fixed[chosen] = True
        free_J[:, first:][:, chosen] = 0.0
        free_g[first:][chosen] = 0.0
        step = prioritised_step(free_J, e - J @ at, free_g, starts, damping2, floor2)
        step += at
        joints = step[first:]
        joints[fixed] = fixed_at[fixed]
    return step, int(fixed.sum())


def _disturbs(J: Array, e: Array, step: Array, end: int) -> bool:
    """Tell whether a row above the last level that had no error would move."""
    still = np.abs(e[:end]) < _STILL
    return bool((np.abs(J[:end] @ step)[still] > _MOVED).any())


def _share_within(joints: Array, speeds: Bounds) -> float:
    """Return the largest share of a step, at most 1, that is within speed bounds."""
    room = np.where(joints > 0, speeds[1], speeds[0])
    fast = np.abs(joints) > np.abs(room)
    return float((room[fast] / joints[fast]).min(initial=1.0))
