"""OptiTrack's NatNet: messages, versions, and a reader that never goes beyond what is there.

A message is a number, the size of what follows, and that; little endian, nothing is aligned. How most of them are read
depends on the sender's version, which it tells when it is asked (``SERVERINFO``).
"""

from __future__ import annotations

import struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imitor.live.sample import Malformed

CONNECT, SERVERINFO, REQUEST, RESPONSE, REQUEST_MODELDEF, MODELDEF, REQUEST_FRAME, FRAME = range(8)
KEEPALIVE: Final = 10
UNRECOGNIZED: Final = 100
MESSAGES: Final = frozenset({*range(15), UNRECOGNIZED})

Version = tuple[int, int]
LEAST_VERSION: Final[Version] = (2, 0)
NEWEST_VERSION: Final[Version] = (4, 1)
"""Versions that are known; newer ones of the same first number are read as the newest."""
_HEADER: Final = struct.Struct("<HH")
_NAME: Final = 256
_LONGEST_TEXT: Final = 256
_COUNT: Final = struct.Struct("<i")


class Cursor:
    """Reads what follows a message's header from front to back.

    Args:
        data: The bytes.
    """

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    @property
    def left(self) -> int:
        """How many bytes were not read yet."""
        return len(self._data) - self._at

    def take(self, form: struct.Struct) -> tuple[Any, ...]:
        """Return the values of a form; what is cut off raises `struct.error`."""
        values = form.unpack_from(self._data, self._at)
        self._at += form.size
        return values

    def skip(self, size: int) -> None:
        """Pass over some bytes.

        Raises:
            Malformed: So many are not there.
        """
        if not 0 <= size <= self.left:
            raise Malformed("cut off")
        self._at += size

    def count(self, item_size: int) -> int:
        """Return a count of items, each of at least so many bytes.

        Raises:
            Malformed: So many items are not there.
        """
        return self.checked(self.take(_COUNT)[0], item_size)

    def checked(self, n: int, item_size: int) -> int:
        """Return a count that was read, after the check of `count`."""
        if not 0 <= n * item_size <= self.left:
            raise Malformed("a count that cannot be")
        return n

    def part(self, size: int) -> Cursor:
        """Return a reader of the next bytes alone, and pass over them."""
        at = self._at
        self.skip(size)
        return Cursor(self._data[at : self._at])

    def text(self) -> str:
        """Return a text that ends with a zero."""
        end = self._data.find(b"\0", self._at, self._at + _LONGEST_TEXT + 1)
        if end < 0:
            raise Malformed("a text without an end")
        raw, self._at = self._data[self._at : end], end + 1
        return raw.decode("utf-8", "replace")

    def items(self, dtype: np.dtype[np.void], n: int) -> NDArray[np.void]:
        """Return ``n`` items of a type, checked by `count` before."""
        at = self._at
        self.skip(n * dtype.itemsize)
        return np.frombuffer(self._data, dtype, n, at)


def opened(datagram: bytes) -> tuple[int, bytes]:
    """Return number and content of a message; -1 for what is none.

    Raises:
        Malformed: It is cut off.
    """
    if len(datagram) < _HEADER.size:
        return -1, b""
    number, size = _HEADER.unpack_from(datagram)
    if number not in MESSAGES:
        return -1, b""
    if size > len(datagram) - _HEADER.size:
        raise Malformed("cut off")
    return int(number), datagram[_HEADER.size : _HEADER.size + size]


def message(number: int, content: bytes = b"") -> bytes:
    """Return a message."""
    return _HEADER.pack(number, len(content)) + content


def server_version(content: bytes) -> Version:
    """Return the version in a ``SERVERINFO``.

    Raises:
        Malformed: It is cut off, or the version is none that can be read.
    """
    if len(content) < _NAME + 8:
        raise Malformed("cut off")
    version = (content[_NAME + 4], content[_NAME + 5])
    if not LEAST_VERSION <= version < (NEWEST_VERSION[0] + 1, 0):
        raise Malformed("a version that is not known")
    return version


def who(name: str, version: Version) -> bytes:
    """Return the content of ``CONNECT`` and the beginning of that of ``SERVERINFO``: name and versions."""
    return name.encode()[: _NAME - 1].ljust(_NAME, b"\0") + bytes([1, 0, 0, 0]) + bytes([*version, 0, 0])


def packed(*fields: tuple[Any, ...]) -> np.dtype[np.void]:
    """Return the type of an item without alignment."""
    out: np.dtype[np.void] = np.dtype(list(fields))
    return out


__all__ = [
    "CONNECT",
    "FRAME",
    "KEEPALIVE",
    "LEAST_VERSION",
    "MODELDEF",
    "NEWEST_VERSION",
    "REQUEST_MODELDEF",
    "SERVERINFO",
    "UNRECOGNIZED",
    "Cursor",
    "Version",
    "message",
    "opened",
    "packed",
    "server_version",
    "who",
]
