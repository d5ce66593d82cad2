"""The null pose of Xsens MVN's network streaming (type 13): the segments' origins, and points on them.

Counted lists of counted names and places, big endian, in metres and with z up.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.live.sample import Malformed
from imitor.motion.mvnx_file import SEGMENTS
from imitor.types import Array

_MOST: Final = 1000
"""Most origins or points that are believed; MVN sends 23 and about 123."""
_LONGEST_NAME: Final = 64
_COUNT: Final = struct.Struct(">i")
_POINT_ID: Final = struct.Struct(">HH")
_FLAGS: Final = struct.Struct(">I")
_VECTOR: Final = struct.Struct(">3f")


@dataclass(frozen=True)
class NullPose:
    """What type 13 tells of the body: the pose in which every orientation is the identity.

    Attributes:
        origin: Segment origins, shape (23, 3) [m].
        points: (segment, point) -> place from the segment's origin, shape (3,) [m].
    """

    origin: Array
    points: Mapping[tuple[str, str], Array]


def read_null_pose(payload: bytes, before: NullPose | None) -> NullPose | None:
    """Return the null pose with what one datagram of type 13 adds to it.

    Origins come first and begin anew, points follow in pieces.

    Raises:
        Malformed: It is cut off, or counts what it cannot hold.
    """
    reader = _Reader(payload)
    n = reader.count(_MOST)
    origin = {}
    for _ in range(n):
        name = reader.name()
        origin[name] = reader.vector()
    pose = before
    if n:
        if not set(SEGMENTS) <= set(origin):
            raise Malformed("a null pose without all segments")
        pose = NullPose(np.array([origin[s] for s in SEGMENTS]), {})
    points = {}
    for _ in range(reader.count(_MOST)):
        segment, _ = reader.take(_POINT_ID)
        name = reader.name()
        reader.take(_FLAGS)
        place = reader.vector()
        if 1 <= segment <= len(SEGMENTS):
            points[SEGMENTS[segment - 1], name] = place
    if pose is None:
        return None
    if not points:
        return pose
    merged = {**pose.points, **points}
    return NullPose(pose.origin, merged if len(merged) <= _MOST else points)


def null_pose_payloads(pose: NullPose) -> list[bytes]:
    """Return what follows the header in the datagrams of type 13: the origins, then the points."""

    def named(name: str) -> bytes:
        text = name.encode()
        return _COUNT.pack(len(text)) + text

    origins = [named(s) + _VECTOR.pack(*o) for s, o in zip(SEGMENTS, pose.origin, strict=True)]
    points = [
        _POINT_ID.pack(SEGMENTS.index(segment) + 1, i) + named(name) + _FLAGS.pack(0) + _VECTOR.pack(*place)
        for i, ((segment, name), place) in enumerate(pose.points.items())
    ]
    payloads = [_COUNT.pack(len(origins)) + b"".join(origins) + _COUNT.pack(0)]
    if points:
        payloads.append(_COUNT.pack(0) + _COUNT.pack(len(points)) + b"".join(points))
    return payloads


class _Reader:
    """Reads a payload from front to back; what is not there is malformed."""

    def __init__(self, payload: bytes) -> None:
        self._payload, self._at = payload, 0

    def take(self, form: struct.Struct) -> tuple[int, ...]:
        values = form.unpack_from(self._payload, self._at)  # struct.error where it is cut off
        self._at += form.size
        return values

    def count(self, most: int) -> int:
        n = self.take(_COUNT)[0]
        if not 0 <= n <= most:
            raise Malformed("a count that cannot be")
        return n

    def name(self) -> str:
        n = self.count(_LONGEST_NAME)
        text = self._payload[self._at : self._at + n]
        if len(text) < n:
            raise Malformed("cut off in a name")
        self._at += n
        return text.decode("utf-8", "replace")

    def vector(self) -> Array:
        vector = np.array(self.take(_VECTOR))
        if not np.isfinite(vector).all():
            raise Malformed("a place that is no number")
        return vector


__all__ = ["NullPose", "null_pose_payloads", "read_null_pose"]
