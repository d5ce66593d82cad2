"""A frame of NatNet: skeletons and labelled markers; everything else is stepped over."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imitor.live.natnet import Cursor, Version, packed

BODY: Final = packed(
    ("id", "<i4"), ("position", "<f4", 3), ("quaternion", "<f4", 4), ("error", "<f4"), ("params", "<i2")
)
"""A rigid body from version 3.0 on; the quaternion is x y z w, bit 0 of ``params`` says that it is tracked."""
MARKER: Final = packed(
    ("id", "<i4"), ("position", "<f4", 3), ("size", "<f4"), ("params", "<i2"), ("residual", "<f4")
)
"""A labelled marker from version 3.0 on; bit 0 of ``params`` says that it is occluded."""
_MARKER_2_6: Final = packed(("id", "<i4"), ("position", "<f4", 3), ("size", "<f4"), ("params", "<i2"))
_MARKER_2_3: Final = packed(("id", "<i4"), ("position", "<f4", 3), ("size", "<f4"))
TRACKED: Final = 1
OCCLUDED: Final = 1
MODELS_CHANGED: Final = 2
_I: Final = struct.Struct("<i")
_COUNT_AND_SIZE: Final = struct.Struct("<iI")
_BODY_2: Final = struct.Struct("<i3f4f")
_ERROR: Final = struct.Struct("<f")
_PARAMS: Final = struct.Struct("<h")
_SECONDS: Final = struct.Struct("<d")
_SECONDS_2: Final = struct.Struct("<f")
_VECTOR: Final = 12
_PLACE: Final = packed(("position", "<f4", 3))
_LEAST_SET: Final = 5


@dataclass(frozen=True, slots=True)
class NatNetFrame:
    """One instant in Motive's axes and metres.

    Attributes:
        number: The sender's count.
        time_s: The sender's clock [s].
        skeletons: Number of a skeleton to its bones, items of `BODY`.
        markers: Labelled markers, items of `MARKER` or of its older forms.
        models_changed: Whether the description of what is sent is no longer right.
    """

    number: int
    time_s: float
    skeletons: Mapping[int, NDArray[np.void]]
    markers: NDArray[np.void]
    models_changed: bool


def read_frame(content: bytes, version: Version) -> NatNetFrame:
    """Return the frame in a message.

    Raises:
        Malformed: It counts what it does not hold.
        struct.error: It is cut off.
    """
    c = Cursor(content)
    number = c.take(_I)[0]
    if version >= (4, 1):
        skeletons, markers = _sized_sections(c, version)
    else:
        skeletons, markers = _sections(c, version)
    c.skip(8)  # time code
    time_s = c.take(_SECONDS if version >= (2, 7) else _SECONDS_2)[0]
    c.skip((24 if version >= (3, 0) else 0) + (8 if version >= (4, 1) else 0))
    changed = bool(c.take(_PARAMS)[0] & MODELS_CHANGED)
    return NatNetFrame(number, time_s, skeletons, markers, changed)


def read_marker_sets(content: bytes, version: Version) -> dict[str, NDArray[np.float32]]:
    """Return the marker sets of a frame by name, shape (M, 3) each [m of the sender]; see `read_frame`."""
    c = Cursor(content)
    c.skip(_I.size)
    n = c.count(_LEAST_SET)
    c.skip(_I.size if version >= (4, 1) else 0)
    out = {}
    for _ in range(n):
        name = c.text()
        out[name] = c.items(_PLACE, c.count(_VECTOR))["position"]
    return out


def _sized_sections(c: Cursor, version: Version) -> tuple[dict[int, NDArray[np.void]], NDArray[np.void]]:
    """Read the sections of version 4.1 and newer, whose sizes are told."""

    def section() -> tuple[int, Cursor]:
        n, size = c.take(_COUNT_AND_SIZE)
        return n, c.part(size)

    for _ in ("marker sets", "unlabelled markers", "rigid bodies"):
        section()
    n, part = section()
    skeletons = _skeletons(part, part.checked(n, 8), version)
    section()  # assets
    n, part = section()
    markers = part.items(MARKER, part.checked(n, MARKER.itemsize))
    for _ in ("force plates", "devices"):
        section()
    return skeletons, markers


def _sections(c: Cursor, version: Version) -> tuple[dict[int, NDArray[np.void]], NDArray[np.void]]:
    """Read the sections of older versions, one after the other."""
    for _ in range(c.count(_LEAST_SET)):  # marker sets
        c.text()
        c.skip(_VECTOR * c.count(_VECTOR))
    c.skip(_VECTOR * c.count(_VECTOR))  # unlabelled markers
    _bodies(c, c.count(_BODY_2.size), version)  # rigid bodies
    skeletons = _skeletons(c, c.count(8), version) if version >= (2, 1) else {}
    kind = MARKER if version >= (3, 0) else _MARKER_2_6 if version >= (2, 6) else _MARKER_2_3
    markers = c.items(kind, c.count(kind.itemsize) if version >= (2, 3) else 0)
    for since in ((2, 9), (2, 11)):  # force plates, devices: channels of values
        for _ in range(c.count(8) if version >= since else 0):
            c.skip(4)
            for _ in range(c.count(4)):
                c.skip(4 * c.count(4))
    return skeletons, markers


def _skeletons(c: Cursor, n: int, version: Version) -> dict[int, NDArray[np.void]]:
    out = {}
    for _ in range(n):
        number = c.take(_I)[0]
        out[number] = _bodies(c, c.count(_BODY_2.size), version)
    return out


def _bodies(c: Cursor, n: int, version: Version) -> NDArray[np.void]:
    """Return rigid bodies, items of `BODY`; before version 3.0 each has its markers, and before 2.6 no ``params``."""
    if version >= (3, 0):
        return c.items(BODY, n)
    out = np.empty(n, BODY)
    for i in range(n):
        number, x, y, z, *quaternion = c.take(_BODY_2)
        c.skip((_VECTOR + 4 + 4) * c.count(_VECTOR + 4 + 4))
        error = c.take(_ERROR)[0]
        params = c.take(_PARAMS)[0] if version >= (2, 6) else TRACKED
        out[i] = number, (x, y, z), tuple(quaternion), error, params
    return out


__all__ = [
    "BODY",
    "MARKER",
    "MODELS_CHANGED",
    "OCCLUDED",
    "TRACKED",
    "NatNetFrame",
    "read_frame",
    "read_marker_sets",
]
