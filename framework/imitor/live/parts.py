"""Puts together what a sender had to cut into several datagrams."""

from __future__ import annotations

from collections import OrderedDict
from typing import Generic, TypeVar

from imitor.live.sample import Malformed

K = TypeVar("K")
P = TypeVar("P")


class Parts(Generic[K, P]):
    """Collects the parts of a few wholes at a time; of more than ``most`` begun, the one begun first is given up.

    Args:
        most: How many wholes may be incomplete at once.
    """

    def __init__(self, most: int = 4) -> None:
        self._most = most
        self._open: OrderedDict[K, dict[int, P]] = OrderedDict()

    def add(self, key: K, index: int, count: int, part: P) -> list[P] | None:
        """Add a part; return all of the whole in order once there are ``count``, which the caller has bounded.

        Args:
            key: Which whole.
            index: Which part, from 0.
            count: How many parts the whole has.
            part: The part.

        Raises:
            Malformed: There is no such part.
        """
        if not 0 <= index < count:
            raise Malformed
        if count == 1:
            return [part]
        parts = self._open.setdefault(key, {})
        parts[index] = part
        if len(parts) < count:
            if len(self._open) > self._most:
                self._open.popitem(last=False)
            return None
        del self._open[key]
        if set(parts) != set(range(count)):
            raise Malformed
        return [parts[i] for i in range(count)]

    def clear(self) -> None:
        """Forget what is not complete."""
        self._open.clear()


__all__ = ["Parts"]
