"""The datagrams of the sink ``udp_json``: one JSON object each, written out in ``docs/robots/udp_json.md``.

A `command` is sent every period. `names` tell which joints the positions of a command belong to; they are sent at
the start and once in a while, and every command bears their hash, so that a receiver that comes late or that listens
to the wrong robot knows.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

from imitor.commands.command import Command
from imitor.types import STATUS

COMMAND: Final = "imitor-command"
NAMES: Final = "imitor-joints"
VERSION: Final = 1
LARGEST: Final = 1400
"""Bytes of the largest datagram: one frame of an Ethernet, with room for the headers of tunnels."""
_DIGITS: Final = 5
"""Digits after the decimal point of positions [rad, m]."""
_SEPARATORS: Final = (",", ":")
_FAR: Final = 99999.0
"""A base farther away than this is written with more characters than were planned for [m]."""


def names_hash(names: Sequence[str]) -> str:
    """Return the first 8 hexadecimal digits of the SHA-256 of the names joined by line feeds, in UTF-8."""
    return hashlib.sha256("\n".join(names).encode()).hexdigest()[:8]


@dataclass(frozen=True)
class Received:
    """A command as it was received.

    Attributes:
        seq: Count of commands; a larger one is newer.
        t_s: The sender's monotonic clock [s].
        period_s: When the next one is due [s].
        status: ``ok``, ``held`` or ``stopped``.
        hash: Of the joint names.
        position: Joint positions [rad or m].
        base_position: Base link in world (x, y, z) [m].
        base_quaternion: Rotation of the base link, world from base (w, x, y, z).
        contact: The feet that stand (left, right).
    """

    seq: int
    t_s: float
    period_s: float
    status: str
    hash: str
    position: Sequence[float]
    base_position: Sequence[float]
    base_quaternion: Sequence[float]
    contact: Sequence[bool]


class Encoder:
    """Makes datagrams of commands.

    Args:
        robot: Name of the robot.
        names: Its joints, as the receiver calls them.
        period_s: Time between commands [s].

    Raises:
        ValueError: The joints do not fit into a datagram.
    """

    def __init__(self, robot: str, names: Sequence[str], period_s: float) -> None:
        self._robot, self._names, self._period_s = robot, list(names), round(period_s, 6)
        self.hash = names_hash(names)
        far, turn = [-_FAR] * 3, [-0.12345] * 4
        widest = self._command(
            2**53, 1e9 + 0.123456, STATUS[2], [-_FAR / 1e4] * len(names), far, turn, (True, True)
        )
        if len(widest) > LARGEST:
            raise ValueError(
                f"{len(names)} joints make datagrams of {len(widest)} bytes; {LARGEST} is the most"
            )

    def names(self) -> list[bytes]:
        """Return the datagrams that name the joints; several when one is too small for all of them."""
        out: list[bytes] = []
        first = 0
        while first < len(self._names):
            last = len(self._names)
            while len(datagram := self._some_names(first, last)) > LARGEST and last > first + 1:
                last -= 1
            out.append(datagram)
            first = last
        return out

    def _some_names(self, first: int, last: int) -> bytes:
        return _dump(
            {
                "schema": NAMES, "version": VERSION, "robot": self._robot, "hash": self.hash,
                "count": len(self._names), "first": first, "names": self._names[first:last],
            }
        )  # fmt: skip

    def command(self, command: Command, t_s: float) -> bytes:
        """Return the datagram of a command.

        Args:
            command: What the robot is told.
            t_s: Our monotonic clock [s].
        """
        q = command.q.tolist()
        base = [q[6], *q[3:6]]
        left, right = command.contact.tolist()
        return self._command(
            command.index, t_s, STATUS[command.status], q[7:], q[:3], base, (left, right)
        )  # fmt: skip

    def _command(
        self, seq: int, t_s: float, status: str, joints: Sequence[float], position: Sequence[float],
        quaternion: Sequence[float], contact: tuple[bool, bool],
    ) -> bytes:  # fmt: skip
        return _dump(
            {
                "schema": COMMAND, "version": VERSION, "seq": seq, "t": round(t_s, 6), "period": self._period_s,
                "status": status, "hash": self.hash, "position": _rounded(joints),
                "base": {"position": _rounded(position), "quaternion": _rounded(quaternion)},
                "contact": [int(c) for c in contact],
            }
        )  # fmt: skip


def decode(datagram: bytes) -> Received:
    """Read a command, as a receiver has to.

    Raises:
        ValueError: It is no command of this version, or damaged; says what is wrong.
    """
    if len(datagram) > LARGEST:
        raise ValueError(f"{len(datagram)} bytes are more than {LARGEST}")
    try:
        data = json.loads(datagram)
    except (UnicodeDecodeError, RecursionError) as error:
        raise ValueError("no JSON") from error
    if not isinstance(data, dict) or data.get("schema") != COMMAND or data.get("version") != VERSION:
        raise ValueError(f"no '{COMMAND}' of version {VERSION}")
    base = data.get("base")
    if not isinstance(base, dict):
        raise ValueError("no base")
    status, seq = data.get("status"), data.get("seq")
    if status not in STATUS or not isinstance(seq, int) or isinstance(seq, bool):
        raise ValueError("status or seq is wrong")
    contact = _numbers(data, "contact", 2)
    return Received(
        seq, _numbers({"t": [data.get("t")]}, "t", 1)[0], _numbers({"period": [data.get("period")]}, "period", 1)[0],
        str(status), str(data.get("hash")), _numbers(data, "position"), _numbers(base, "position", 3),
        _numbers(base, "quaternion", 4), [bool(c) for c in contact],
    )  # fmt: skip


def _numbers(data: Mapping[str, Any], name: str, n: int | None = None) -> list[float]:
    values = data.get(name)
    sound = isinstance(values, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and isfinite(v) for v in values
    )
    if not sound or not isinstance(values, list) or (n is not None and len(values) != n):
        raise ValueError(f"{name} is no list of {'' if n is None else f'{n} '}numbers")
    return [float(v) for v in values]


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(v, _DIGITS) for v in values]


def _dump(data: Mapping[str, Any]) -> bytes:
    return json.dumps(data, separators=_SEPARATORS, allow_nan=False).encode()


__all__ = ["COMMAND", "LARGEST", "NAMES", "VERSION", "Encoder", "Received", "decode", "names_hash"]
