"""Figures of a run without an end, in bounded memory."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

_PER_DECADE: Final = 200
_LEAST_S: Final = 1e-6
_DECADES: Final = 8


class Durations:
    """Counts durations in bins that are 1.2 % wide, from a microsecond to 100 s."""

    def __init__(self) -> None:
        self._counts = np.zeros(_PER_DECADE * _DECADES + 1, dtype=np.int64)
        self.count = 0
        self.largest_s = 0.0

    def add(self, seconds: float) -> None:
        """Count one duration [s]."""
        at = int(_PER_DECADE * math.log10(max(seconds, _LEAST_S) / _LEAST_S))
        self._counts[min(at, len(self._counts) - 1)] += 1
        self.count += 1
        self.largest_s = max(self.largest_s, seconds)

    def quantile(self, share: float) -> float:
        """Return the duration that this share does not exceed [s]; NaN when there is none."""
        if not self.count:
            return math.nan
        at = int(np.searchsorted(np.cumsum(self._counts), share * self.count))
        return min(float(_LEAST_S * 10 ** ((at + 0.5) / _PER_DECADE)), self.largest_s)

    def figures(self) -> dict[str, float]:
        """Return median, 99th percentile and largest [ms], and how many there were."""
        if not self.count:
            return {"count": 0}
        return {
            "median_ms": 1e3 * self.quantile(0.5),
            "p99_ms": 1e3 * self.quantile(0.99),
            "largest_ms": 1e3 * self.largest_s,
            "count": self.count,
        }


__all__ = ["Durations"]
