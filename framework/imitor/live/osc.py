"""OSC datagrams: the messages in a bundle, bounded, and bundles that fit into a network packet.

Messages are read and written by python-osc. Bundles are taken apart here, because a size below zero keeps that
library's reader going for ever, and deep nesting ends in a RecursionError.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Any, Final

from imitor.errors import ImitorError
from imitor.live.sample import Foreign, Malformed

EXTRA: Final = "osc"
_BUNDLE: Final = b"#bundle\0"
_BUNDLE_HEAD: Final = 16
_SIZE: Final = struct.Struct(">i")
_DEEPEST: Final = 4
_MOST_MESSAGES: Final = 1000
_LONGEST_MESSAGE: Final = 1024
"""Bytes of a message that are worth reading; python-osc copies the rest of it for every argument."""
_LARGEST_BUNDLE: Final = 1400
"""Bytes that go into a packet of the network with room for its headers."""
_TAGS: Final = frozenset(b"ifsbhdtTFN")


class OscReader:
    """Reads the messages of wanted addresses.

    Args:
        addresses: What to read; all others are passed over unread.

    Raises:
        ImitorError: python-osc is not installed.
    """

    def __init__(self, addresses: Sequence[str]) -> None:
        try:
            from pythonosc.osc_message import OscMessage, ParseError
        except ImportError:
            raise ImitorError(_missing()) from None
        self._message, self._broken = OscMessage, ParseError
        self._wanted = {a.encode(): a for a in addresses}

    def read(self, datagram: bytes) -> list[tuple[str, list[Any]]]:
        """Return addresses and arguments, in the order of the datagram; a message of unknown types is passed over.

        Raises:
            Foreign: It is no OSC.
            Malformed: It is cut off or nested too deep.
        """
        if not datagram.startswith((b"/", _BUNDLE)):
            raise Foreign
        out = []
        for count, raw in enumerate(_messages(datagram, 0)):
            if count >= _MOST_MESSAGES:
                raise Malformed("too many messages")
            end = raw.find(b"\0")
            if end < 0:
                raise Malformed("an address without an end")
            address = self._wanted.get(raw[:end])
            if address is None or len(raw) > _LONGEST_MESSAGE:
                continue
            types = _types(raw, end)
            if types is None:
                continue
            try:
                message = self._message(raw)
            except (self._broken, ValueError, OverflowError, struct.error):
                raise Malformed("an argument cut off") from None
            values = message.params
            if _length(end, types, values) > len(raw):  # python-osc fills in what is missing at the end
                raise Malformed("an argument cut off")
            out.append((address, values))
        return out


def _messages(datagram: bytes, depth: int) -> Iterator[bytes]:
    if datagram.startswith(b"/"):
        yield datagram
        return
    if not datagram.startswith(_BUNDLE) or len(datagram) < _BUNDLE_HEAD or depth > _DEEPEST:
        raise Malformed("neither message nor bundle")
    at = _BUNDLE_HEAD
    while at < len(datagram):
        (size,) = _SIZE.unpack_from(datagram, at)  # struct.error where it is cut off
        at += _SIZE.size
        if not 0 < size <= len(datagram) - at:
            raise Malformed("an element that cannot be")
        yield from _messages(datagram[at : at + size], depth + 1)
        at += size


def _types(raw: bytes, end: int) -> str | None:
    """Return the types of a message whose address ends at ``end``; ``None`` when one of them cannot be read."""
    start = _padded(end)
    tags = raw[start : raw.find(b"\0", start)]
    return tags[1:].decode() if tags.startswith(b",") and _TAGS.issuperset(tags[1:]) else None


def _padded(length: int) -> int:
    """Return the bytes of a string with its end and up to a multiple of four."""
    return (length // 4 + 1) * 4


def _length(end: int, types: str, values: Sequence[Any]) -> int:
    """Return how long a message has to be [bytes]."""
    out = _padded(end) + _padded(len(types) + 1)
    for kind, value in zip(types, values, strict=True):
        if kind == "s":
            out += _padded(len(value.encode()))
        elif kind == "b":
            out += 4 + (len(value) + 3) // 4 * 4
        else:
            out += {"i": 4, "f": 4, "h": 8, "d": 8, "t": 8}.get(kind, 0)
    return out


class OscWriter:
    """Writes messages into bundles.

    Raises:
        ImitorError: python-osc is not installed.
    """

    def __init__(self) -> None:
        try:
            from pythonosc.osc_message_builder import OscMessageBuilder
        except ImportError:
            raise ImitorError(_missing()) from None
        self._builder = OscMessageBuilder

    def message(self, address: str, types: str, *values: Any) -> bytes:
        """Return one message; ``types`` are OSC's letters, one a value."""
        builder = self._builder(address)
        for kind, value in zip(types, values, strict=True):
            builder.add_arg(value, kind)
        return bytes(builder.build().dgram)


def bundles(messages: Sequence[bytes]) -> list[bytes]:
    """Return messages in as few bundles as packets of the network need, to be carried out at once."""
    head = _BUNDLE + struct.pack(">Q", 1)
    out: list[bytes] = []
    for message in messages:
        element = _SIZE.pack(len(message)) + message
        if out and len(out[-1]) + len(element) <= _LARGEST_BUNDLE:
            out[-1] += element
        else:
            out.append(head + element)
    return out


def _missing() -> str:
    return f"OSC is read with python-osc, which is not installed: pip install 'imitor[{EXTRA}]'"


__all__ = ["EXTRA", "OscReader", "OscWriter", "bundles"]
