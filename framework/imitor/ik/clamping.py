"""The clamping loop [baerlocher2004], [pennapoubel2014] section II-B3.

Solve; fix every joint that leaves its range at the limit and zero its column; solve again with fewer joints, until
all hold. The ranges are those of the step, so position limits and speed limits are one mechanism.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.ik.hierarchy import prioritised_step
from imitor.types import Array


def clamped_step(
    J: Array,
    e: Array,
    g: Array,
    starts: Sequence[int],
    damping2: Sequence[float],
    floor2: float,
    lowest: Array,
    highest: Array,
    first: int,
) -> tuple[Array, int]:
    """Return a prioritised step whose joint part stays within bounds, and the number of joints fixed.

    Args:
        J, e, g, starts, damping2, floor2: As for `imitor.ik.hierarchy.prioritised_step`, n columns.
        lowest, highest: Bounds of the joints' steps, shape (n - first,); ``lowest <= 0 <= highest`` is not required,
            ``lowest <= highest`` is.
        first: Number of leading columns without bounds (a free base).
    """
    step = prioritised_step(J, e, g, starts, damping2, floor2)
    joints = step[first:]
    outside = (joints < lowest) | (joints > highest)
    if not outside.any():
        return step, 0
    fixed = np.zeros(lowest.shape[0], dtype=bool)
    at = np.zeros(step.shape[0])
    free_J, free_g = J.copy(), g.copy()
    for _ in range(lowest.shape[0]):
        fixed |= outside
        np.clip(joints, lowest, highest, out=at[first:], where=outside)
        at[first:][~fixed] = 0.0
        free_J[:, first:][:, fixed] = 0.0
        free_g[first:][fixed] = 0.0
        step = prioritised_step(free_J, e - J @ at, free_g, starts, damping2, floor2)
        step += at
        joints = step[first:]
        joints[fixed] = at[first:][fixed]
        outside = ((joints < lowest) | (joints > highest)) & ~fixed
        if not outside.any():
            break
    return step, int(fixed.sum())
