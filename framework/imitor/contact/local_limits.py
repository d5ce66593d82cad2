"""Joint values brought within limits by scaling them near the limits alone, after [safonova2003]."""

from __future__ import annotations

import numpy as np

from imitor.types import Array


class LocalLimits:
    """Scales a motion where it nears or passes the limits and leaves it as it is elsewhere.

    Within ``margin`` of a limit the slope falls from 1 smoothly to 0, so that velocities stay continuous,
    extremes stay extremes in the same order, and no value passes the limit.

    Args:
        lower, upper: Joint limits, shape (n,) [rad].
        margin: Where scaling begins, as a share of the range [-].
    """

    def __init__(self, lower: Array, upper: Array, margin: float) -> None:
        self._room = margin * (upper - lower)
        self._low, self._high = lower + self._room, upper - self._room

    def __call__(self, q: Array) -> Array:
        """Return the scaled values, shape (n,) [rad]."""
        room = self._room
        inside = np.clip(q, self._low, self._high)
        return np.asarray(inside + room * np.tanh((q - inside) / room))
