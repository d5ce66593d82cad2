"""Datagrams of Xsens MVN's network streaming: poses (types 01 and 02), both ways.

Big endian. A header of 24 bytes: ``MXTP`` and two digits for the type, sample counter, datagram counter (the highest
bit marks the last of a sample), items in this datagram, time code [ms], character, counts of segments, payload size.
Old senders leave everything after the character zero. A sample may be split over several datagrams.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imitor.human.rotations import about_x, about_y, about_z
from imitor.live.quaternions import rotations
from imitor.live.sample import Foreign, Malformed, Sample
from imitor.live.xsens_null_pose import NullPose, read_null_pose
from imitor.motion.mvnx_file import SEGMENTS
from imitor.types import Array

HEADER: Final = struct.Struct(">6sIBBIBBBBHH")
EULER: Final = np.dtype([("id", ">i4"), ("position", ">f4", 3), ("angle", ">f4", 3)])
"""Item of type 01: y up, cm, degrees about the fixed axes x, y, z in this order."""
QUATERNION: Final = np.dtype([("id", ">i4"), ("position", ">f4", 3), ("quaternion", ">f4", 4)])
"""Item of type 02: z up, m, w x y z."""
LAST: Final = 0x80
"""Bit of the datagram counter that marks the last datagram of a sample."""
_ITEMS: Final = {b"MXTP01": EULER, b"MXTP02": QUATERNION}
_NULL_POSE: Final = b"MXTP13"
_Z_UP: Final = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
_MOST_PENDING: Final = 4
"""So many samples may be incomplete at a time; the oldest goes."""


@dataclass(frozen=True, slots=True)
class XsensPose:
    """One instant, z up.

    Attributes:
        position: Segment origins in the order of MVN, shape (23, 3) [m]; NaN where a segment is not told.
        rotation: World from segment, shape (23, 3, 3).
        null_pose: The newest null pose told so far.
    """

    position: Array
    rotation: Array
    null_pose: NullPose | None = None


@dataclass
class _Parts:
    """Datagrams of one sample, by their index."""

    items: dict[int, NDArray[np.void]] = field(default_factory=dict)
    last: int | None = None

    @property
    def complete(self) -> bool:
        return self.last is not None and len(self.items) == self.last + 1


class XsensDecoder:
    """Decodes the datagrams of one character.

    Args:
        character: Which person to take, from 0.
    """

    def __init__(self, character: int = 0) -> None:
        self._character = character
        self._quaternions = False
        self._null_pose: NullPose | None = None
        self._pending: dict[tuple[bytes, int], _Parts] = {}

    def reset(self) -> None:
        """Forget samples that are not complete."""
        self._pending.clear()

    def decode(self, datagram: bytes) -> Sample | None:
        """Return the sample that a datagram completes; see `imitor.live.sample.Decoder`.

        A sender may tell the same pose as type 01 and as type 02: then the latter counts.
        """
        if len(datagram) < HEADER.size or not datagram.startswith(b"MXTP"):
            raise Foreign
        kind, counter, part, count, time_ms, character, *_, size = HEADER.unpack_from(datagram)
        if not kind[4:].isdigit():
            raise Foreign
        payload = datagram[HEADER.size :]
        if size > len(payload):
            raise Malformed("cut off")
        payload = payload[:size] if size else payload
        if character != self._character:
            return None
        if kind == _NULL_POSE:
            self._null_pose = read_null_pose(payload, self._null_pose)
            return None
        item = _ITEMS.get(kind)
        if item is None:
            return None
        if count == 0 or count * item.itemsize > len(payload):
            raise Malformed("fewer items than told")
        items = np.frombuffer(payload, item, count)
        if (items["id"] < 1).any():
            raise Malformed("no segment has such a number")
        self._quaternions |= item is QUATERNION
        if item is EULER and self._quaternions:
            return None
        whole = self._collect((kind, counter), part, items)
        if whole is None:
            return None
        pose = _pose(whole)
        return Sample(counter, time_ms / 1000.0, XsensPose(*pose, self._null_pose))

    def _collect(self, key: tuple[bytes, int], part: int, items: NDArray[np.void]) -> NDArray[np.void] | None:
        index, last = part & ~LAST, bool(part & LAST)
        if index == 0 and last:  # the usual case: a whole sample in one datagram
            self._forget_before(key)
            return items
        parts = self._pending.get(key)
        if parts is None:
            while len(self._pending) >= _MOST_PENDING:
                del self._pending[next(iter(self._pending))]
            parts = self._pending[key] = _Parts()
        if parts.last is not None and (index > parts.last or (last and index != parts.last)):
            raise Malformed("more datagrams than the sample has")
        if last and parts.items and index < max(parts.items):
            raise Malformed("the last datagram of the sample is not its last")
        parts.items[index] = items
        parts.last = index if last else parts.last
        if not parts.complete:
            return None
        self._forget_before(key)
        return np.concatenate([parts.items[i] for i in range(len(parts.items))])

    def _forget_before(self, key: tuple[bytes, int]) -> None:
        """Forget a sample that is complete, and those begun before it."""
        for other in list(self._pending):
            if other[1] <= key[1]:
                del self._pending[other]


def _pose(items: NDArray[np.void]) -> tuple[Array, Array]:
    """Return position (23, 3) [m] and rotation (23, 3, 3) of the segments of the body, z up."""
    n = len(SEGMENTS)
    number = items["id"].astype(np.int_)
    if len(number) < n or (number[:n] != _NUMBERS).any():  # else the body comes first, in order
        body = number <= n
        items, number = items[body], number[body]
        if not len(number) or len(np.unique(number)) < len(number):
            raise Malformed("a segment twice, or none of the body")
    else:
        items, number = items[:n], _NUMBERS
    position, rotation = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    with np.errstate(invalid="ignore", over="ignore"):
        place = items["position"].astype(np.float64)
        if "angle" in (items.dtype.names or ()):
            position[number - 1] = 0.01 * place @ _Z_UP.T
            x, y, z = np.deg2rad(items["angle"].astype(np.float64)).T
            # About the fixed axes x, y, z of a world with y up: those are y, z, x of ours.
            rotation[number - 1] = about_x(z) @ about_z(y) @ about_y(x)
        else:
            position[number - 1] = place
            rotation[number - 1] = rotations(items["quaternion"].astype(np.float64))
    position[~np.isfinite(position).all(axis=-1)] = np.nan
    rotation[~np.isfinite(rotation).all(axis=(-2, -1))] = np.nan
    return position, rotation


_NUMBERS: Final = np.arange(1, len(SEGMENTS) + 1)


def write_pose(
    counter: int,
    time_s: float,
    position: Array,
    quaternion: Array,
    *,
    character: int = 0,
    most_items: int = 40,
) -> list[bytes]:
    """Return the datagrams of one sample of type 02.

    Args:
        counter: The sender's count of samples.
        time_s: The sender's clock [s].
        position: Segment origins in the order of MVN, shape (S, 3) [m].
        quaternion: World from segment, w x y z, shape (S, 4).
        character: Which person it is.
        most_items: Most segments in one datagram.
    """
    items = np.empty(len(position), QUATERNION)
    items["id"] = np.arange(1, len(position) + 1)
    items["position"], items["quaternion"] = position, quaternion
    pieces = [items[i : i + most_items] for i in range(0, len(items), most_items)]
    out = []
    for k, piece in enumerate(pieces):
        part = k | (LAST if k == len(pieces) - 1 else 0)
        out.append(header("02", counter, part, len(piece), time_s, character, piece.nbytes) + piece.tobytes())
    return out


def header(kind: str, counter: int, part: int, items: int, time_s: float, character: int, size: int) -> bytes:
    """Return the header of a datagram; the time code wraps as the sender's does."""
    time_ms = round(time_s * 1000) & 0xFFFFFFFF
    n = len(SEGMENTS)
    return HEADER.pack(
        b"MXTP" + kind.encode(), counter & 0xFFFFFFFF, part, items, time_ms, character, n, 0, 0, 0, size
    )


__all__ = ["HEADER", "LAST", "XsensDecoder", "XsensPose", "header", "write_pose"]
