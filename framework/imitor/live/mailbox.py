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
        self._lock = threading.Lock()
        # Held while there is nothing to take: who waits for it waits for a thing.
        self._empty = threading.Lock()
        self._empty.acquire()
        self._thing: T | None = None
        self._closed = False
        self.replaced = 0

    def put(self, thing: T) -> None:
        """Leave a thing and wake who waits."""
        with self._lock:
            self.replaced += self._thing is not None
            self._thing = thing
            self._wake()

    def take(self, timeout_s: float = 0.0) -> T | None:
        """Return the newest thing and empty the box; ``None`` when none comes in time or the box is closed.

        One thread takes.

        Args:
            timeout_s: How long to wait for one [s].
        """
        if not self._empty.acquire(timeout=max(timeout_s, 0.0)):
            return None
        with self._lock:
            thing, self._thing = self._thing, None
            if self._closed:
                self._wake()
            else:
                self._empty.acquire(blocking=False)  # one that came in between is the one that is taken
            return thing

    def _wake(self) -> None:
        if self._empty.locked():
            self._empty.release()

    def close(self) -> None:
        """Wake who waits; from now on nobody waits."""
        with self._lock:
            self._closed = True
            self._wake()


__all__ = ["Mailbox"]
