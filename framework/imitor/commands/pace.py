"""One command a period, where no clock of the runner does it: a recording is played at the pace of real time."""

from __future__ import annotations

import time


class Pace:
    """Lets its caller through once a period; who is late by more than one is not made up for.

    Args:
        period_s: The period [s].
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._due_s: float | None = None

    def wait(self) -> None:
        """Sleep until the next instant is due."""
        now = time.perf_counter()
        if self._due_s is None or now - self._due_s > self._period_s:
            self._due_s = now
        if self._due_s > now:
            time.sleep(self._due_s - now)
        self._due_s += self._period_s


__all__ = ["Pace"]
