"""NatNet's description of what is sent: names and parents of bones, names of markers."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from imitor.live.natnet import Cursor, Version
from imitor.live.sample import Malformed

_MARKER_SET, _RIGID_BODY, _SKELETON = range(3)
_I: Final = struct.Struct("<i")
_KIND_AND_SIZE: Final = struct.Struct("<iI")
_IDS: Final = struct.Struct("<ii")
_VECTOR: Final = 12
_LEAST_BODY: Final = 1 + 8 + _VECTOR
MOST_BONES: Final = 256
"""Most bones of a skeleton that are believed; Motive's have 21, and 51 with fingers."""


@dataclass(frozen=True, slots=True)
class Bone:
    """A bone: its number in the skeleton, its name, and its parent's number (0: none)."""

    number: int
    name: str
    parent: int


@dataclass(frozen=True, slots=True)
class SkeletonModel:
    """A skeleton: its number in the frames, its name and its bones."""

    number: int
    name: str
    bones: Sequence[Bone]


@dataclass(frozen=True, slots=True)
class Model:
    """What is sent.

    Attributes:
        skeletons: In the order of the sender.
        marker_sets: Name of a set to those of its markers.
    """

    skeletons: Sequence[SkeletonModel]
    marker_sets: Mapping[str, tuple[str, ...]]


def read_model(content: bytes, version: Version) -> Model:
    """Return the description in a message; what comes after skeletons is not read.

    Raises:
        Malformed: It counts what it does not hold, or parents run in circles.
        struct.error: It is cut off.
    """
    c = Cursor(content)
    skeletons, sets = [], {}
    for _ in range(c.count(4)):
        part = c
        if version >= (4, 1):
            kind, size = c.take(_KIND_AND_SIZE)
            part = c.part(size)
        else:
            kind = c.take(_I)[0]
        if kind == _MARKER_SET:
            name = part.text()
            sets[name] = tuple(part.text() for _ in range(part.count(1)))
        elif kind == _RIGID_BODY:
            _bone(part, version)
        elif kind == _SKELETON:
            skeletons.append(_skeleton(part, version))
        elif version < (4, 1):
            break  # force plates, devices and cameras come last, and their size is not told
    return Model(tuple(skeletons), sets)


def _skeleton(c: Cursor, version: Version) -> SkeletonModel:
    name = c.text()
    number = c.take(_I)[0]
    n = c.count(_LEAST_BODY)
    if n > MOST_BONES:
        raise Malformed("too many bones")
    return SkeletonModel(number, name, _in_order([_bone(c, version) for _ in range(n)]))


def _bone(c: Cursor, version: Version) -> Bone:
    name = c.text()
    number, parent = c.take(_IDS)
    c.skip(_VECTOR + (16 if version >= (4, 2) else 0))
    if version >= (3, 0):
        n = c.count(_VECTOR + 4)
        c.skip((_VECTOR + 4) * n)
        for _ in range(n if version >= (4, 0) else 0):
            c.text()
    return Bone(number & 0xFFFF, name, parent & 0xFFFF)


def _in_order(bones: Sequence[Bone]) -> tuple[Bone, ...]:
    """Return the bones of a skeleton, parents before children."""
    numbers = {b.number for b in bones}
    if len(numbers) < len(bones):
        raise Malformed("two bones of one number")
    placed: dict[int, Bone] = {}
    waiting = list(bones)
    while waiting:
        ready = [b for b in waiting if b.parent in placed or b.parent not in numbers or b.parent == b.number]
        if not ready:
            raise Malformed("parents run in circles")
        placed |= {b.number: b for b in ready}
        waiting = [b for b in waiting if b.number not in placed]
    return tuple(placed.values())


__all__ = ["MOST_BONES", "Bone", "Model", "SkeletonModel", "read_model"]
