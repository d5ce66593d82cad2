"""The message of SONIC's pose stream, version 1: a topic, a padded JSON header, raw little-endian arrays [luo2025]."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

TOPIC: Final = b"pose"
HEADER: Final = 1280
"""Bytes of the header, padded with NUL."""
VERSION: Final = 1
RATE_HZ: Final = 50.0
"""Frames a second that the tracker takes the stream to have [Hz]."""
_DTYPES: Final[Mapping[str, str]] = {"f32": "<f4", "f64": "<f8", "i32": "<i4", "i64": "<i8"}


def pack(fields: Mapping[str, tuple[str, NDArray[Any]]]) -> bytes:
    """Return a message.

    Args:
        fields: Name -> word for the type (f32, f64, i32, i64) and the array, whose first axis counts frames.
    """
    arrays = {name: np.asarray(values, dtype=_DTYPES[word]) for name, (word, values) in fields.items()}
    header = {
        "v": VERSION,
        "endian": "le",
        "count": len(next(iter(arrays.values()))),
        "fields": [{"name": n, "dtype": w, "shape": list(arrays[n].shape)} for n, (w, _) in fields.items()],
    }
    text = json.dumps(header, separators=(",", ":")).encode()
    return TOPIC + text.ljust(HEADER, b"\0") + b"".join(a.tobytes() for a in arrays.values())


def pose(index: int, quaternion: NDArray[Any], joints: NDArray[Any], speeds: NDArray[Any]) -> bytes:
    """Return the message of one frame.

    Args:
        index: Count of frames.
        quaternion: Rotation of the base, world from base, w x y z, shape (4,).
        joints: Positions in breadth-first order, shape (n,) [rad].
        speeds: Velocities likewise [rad/s].
    """
    return pack(
        {
            "body_quat": ("f32", quaternion[None]),
            "frame_index": ("i64", np.array([index])),
            "joint_pos": ("f32", joints[None]),
            "joint_vel": ("f32", speeds[None]),
        }
    )


__all__ = ["HEADER", "RATE_HZ", "TOPIC", "VERSION", "pack", "pose"]
