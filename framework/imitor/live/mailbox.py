"""The place between two threads where the newest thing wins."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Holds at most one thing: a newer one replaces one that nobody took.

    Attributes:
        replaced: How many things were replaced before they were taken.
    """

    def __init__(self) -> None:
        self._ready = threading.Condition(threading.Lock())
        self._thing: T | None = None
        self._closed = False
        self.replaced = 0

    def put(self, thing: T) -> None:
        """Leave a thing and wake who waits."""
        with self._ready:
            self.replaced += self._thing is not None
            self._thing = thing
            self._ready.notify_all()

    def take(self, timeout_s: float = 0.0) -> T | None:
        """Return the newest thing and empty the box; ``None`` when none comes in time or the box is closed.

        Args:
            timeout_s: How long to wait for one [s].
        """
        with self._ready:
            if self._thing is None and timeout_s > 0 and not self._closed:
                self._ready.wait(timeout_s)
            thing, self._thing = self._thing, None
            return thing

    def close(self) -> None:
        """Wake everybody who waits; from now on nobody waits."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()


__all__ = ["Mailbox"]
