"""When the next step is due: at a fixed rate, in step with what arrives."""

from __future__ import annotations

from typing import Final

EARLY: Final = 0.02
LATE: Final = 0.25
"""By so much of a period a command may leave before or after its time on the grid, when it is ready then [-]."""
APART: Final = 0.7
"""After a late command the grid moves: the next time is so much of a period away at least [-]."""
READY: Final = 0.05
"""The grid follows the arrivals so that commands are ready so much of a period after their time: they leave at once."""
_GAIN: Final = 0.1
_MOST: Final = 0.01
"""Share of a period by which the grid is shifted in one step, so that arrivals come at their time [-]."""
_OLD: Final = 0.5
_HURRY: Final = 0.98
_BEHIND: Final = 0.5


class Steps:
    """When the next step of the computation may begin: at most at the rate, at once when something arrives.

    Args:
        rate_hz: Steps per second [Hz].
        now_s: The time [s].

    Attributes:
        period_s: Time between steps [s].
        due_s: When the next step may begin [s]; `patience_s` later it begins with nothing new.
    """

    def __init__(self, rate_hz: float, now_s: float) -> None:
        self.period_s = 1.0 / rate_hz
        self.due_s = now_s

    @property
    def patience_s(self) -> float:
        """Until when something new is waited for [s]."""
        return self.due_s + self.period_s

    def begun(self, now_s: float, waiting: bool) -> None:
        """Say that a step begins.

        Args:
            now_s: The time [s].
            waiting: Whether something new lay ready before the step was due: then the next one is due a little sooner.
        """
        period = self.period_s
        self.due_s = max(self.due_s + (_HURRY if waiting else 1.0) * period, now_s - _BEHIND * period)


class Grid:
    """Times at which commands leave, at a fixed rate; the grid follows the arrivals slowly.

    Args:
        rate_hz: Commands per second [Hz].
        now_s: The time [s].

    Attributes:
        next_s: When the next command leaves [s].
    """

    def __init__(self, rate_hz: float, now_s: float) -> None:
        self.period_s = 1.0 / rate_hz
        self.next_s = now_s + self.period_s

    @property
    def earliest_s(self) -> float:
        """From when on a command that is ready leaves at once [s]."""
        return self.next_s - EARLY * self.period_s

    @property
    def latest_s(self) -> float:
        """When a command leaves that was not ready [s]."""
        return self.next_s + LATE * self.period_s

    def is_old(self, ready_s: float) -> bool:
        """Tell whether what is ready has waited so long that the next one is about to come."""
        return ready_s < self.next_s - _OLD * self.period_s

    def left(self, now_s: float, ready_s: float | None) -> None:
        """Say that a command left.

        Args:
            now_s: The time [s].
            ready_s: When it was ready [s]; ``None``: nothing new was.
        """
        period = self.period_s
        shift = 0.0
        if ready_s is not None:
            error = (ready_s - self.next_s) / period
            error -= READY
            error -= round(error)
            shift = period * max(-_MOST, min(_MOST, _GAIN * error))
        self.next_s = max(self.next_s + period + shift, now_s + APART * period)


__all__ = ["EARLY", "LATE", "Grid", "Steps"]
