"""Xsens MVNX files as arrays: `read_mvnx`, for versions 3 and 4."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.mvnx_xml import Elements, Frame, is_number, read_elements
from imitor.types import Array, BoolArray

SEGMENTS: Final = (
    "Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head",
    "RightShoulder", "RightUpperArm", "RightForeArm", "RightHand",
    "LeftShoulder", "LeftUpperArm", "LeftForeArm", "LeftHand",
    "RightUpperLeg", "RightLowerLeg", "RightFoot", "RightToe",
    "LeftUpperLeg", "LeftLowerLeg", "LeftFoot", "LeftToe",
)  # fmt: skip
"""The 23 segments of the body, which every configuration writes."""
REST_TYPES: Final = ("tpose", "identity", "npose")
"""Types of frames that hold a calibration pose, best first. In ``npose`` of version 3, the null pose, the arms are out,
too."""
CONTACTS: Final = ("LeftFoot_Heel", "LeftFoot_Toe", "RightFoot_Heel", "RightFoot_Toe")


@dataclass(frozen=True)
class Pose:
    """One calibration pose: segment origins, shape (S, 3) [m], and quaternions w x y z, shape (S, 4)."""

    position: Array
    quaternion: Array


@dataclass(frozen=True)
class Mvnx:
    """What an MVNX file says; global axes, z up, metres.

    Attributes:
        version: ``3`` or ``4``.
        rate_hz: Frames per second [Hz].
        configuration: E.g. ``FullBody`` or ``UpperBody``; empty when the file does not say.
        segments: Labels, in the order of the arrays.
        points: Points of the segments in their axes of the T-pose: (segment, point) -> (3,) [m].
        rest: Calibration poses by type.
        index: Number of each frame, shape (T,); a step of more than one is a gap.
        position: Segment origins, shape (T, S, 3) [m].
        quaternion: World from segment, w x y z, shape (T, S, 4).
        com: Centre of mass, shape (T, 3) [m]; None when the file has none.
        contact: Heel and toe of the left foot, then of the right, shape (T, 4); None when the file has none.
    """

    version: str
    rate_hz: float
    configuration: str
    segments: tuple[str, ...]
    points: Mapping[tuple[str, str], Array]
    rest: Mapping[str, Pose]
    index: Array
    position: Array
    quaternion: Array
    com: Array | None
    contact: BoolArray | None


def read_mvnx(path: str | Path) -> Mvnx:
    """Read an MVNX file.

    Raises:
        SourceError: The file cannot be read or is not a whole MVNX file; says where and why.
    """
    return _assemble(path, read_elements(path))


def _assemble(path: str | Path, reader: Elements) -> Mvnx:
    missing = [s for s in SEGMENTS if s not in reader.segments]
    if missing:
        raise SourceError(
            path,
            f"the file has no segment {', '.join(missing)}; a body has the 23 from Pelvis to LeftToe",
            reader.subject_line or None,
        )
    rate_hz = float(reader.rate) if is_number(reader.rate) else 0.0
    if not 0.0 < rate_hz < np.inf:
        raise SourceError(
            path,
            f"frameRate is '{reader.rate}'; frames per second are greater than 0",
            reader.subject_line or None,
        )
    normal = [f for f in reader.frames if f.kind == "normal"]
    if not normal:
        found = ", ".join(sorted({f.kind for f in reader.frames})) or "none"
        raise SourceError(path, f"holds no frame of a motion (type normal), only: {found}")
    n = len(reader.segments)
    rest = {
        f.kind: Pose(_block(path, f, "position", 3, n), _unit(path, f, _block(path, f, "orientation", 4, n)))
        for f in reader.frames
        if f.kind in REST_TYPES
    }
    if not rest:
        raise SourceError(
            path,
            f"holds no calibration pose (a frame of type {', '.join(REST_TYPES)}), "
            "which tells how the segments' axes lie; export again with the calibration poses",
        )
    has_contact = all("footContacts" in f.data for f in normal) and set(CONTACTS) <= set(reader.contacts)
    return Mvnx(
        version=reader.version.split(".")[0],
        rate_hz=rate_hz,
        configuration=reader.configuration,
        segments=tuple(reader.segments),
        points=reader.points,
        rest=rest,
        index=_indices(normal),
        position=np.stack([_block(path, f, "position", 3, n) for f in normal]),
        quaternion=np.stack([_unit(path, f, _block(path, f, "orientation", 4, n)) for f in normal]),
        com=_com(path, normal),
        contact=_contact(path, normal, reader.contacts) if has_contact else None,
    )


def _block(path: str | Path, frame: Frame, tag: str, width: int, n: int) -> Array:
    if tag not in frame.data:
        raise SourceError(
            path,
            f"this frame of type {frame.kind} has no <{tag}>; export {tag}s of the segments, too",
            frame.line,
        )
    line, values = frame.data[tag]
    if len(values) != width * n:
        raise SourceError(path, f"<{tag}> has {len(values)} numbers, {n} segments need {width * n}", line)
    return values.reshape(n, width)


def _unit(path: str | Path, frame: Frame, quaternion: Array) -> Array:
    length = np.linalg.norm(quaternion, axis=1)
    if (np.abs(length - 1.0) > 0.01).any():
        k = int(np.argmax(np.abs(length - 1.0)))
        raise SourceError(
            path,
            f"quaternion {k + 1} of <orientation> has length {length[k]:.3f}, not 1",
            frame.data["orientation"][0],
        )
    return np.asarray(quaternion / length[:, None])


def _indices(frames: Sequence[Frame]) -> Array:
    """Return the frame numbers; consecutive ones when the file's are missing or do not grow."""
    plain = np.arange(len(frames), dtype=np.float64)
    if not all(f.index.strip().isdigit() for f in frames):
        return plain
    index = np.array([float(f.index) for f in frames])
    grows = bool((np.diff(index) >= 1.0).all()) and index[-1] - index[0] < 10 * len(frames) + 1000
    return index - index[0] if grows else plain


def _com(path: str | Path, frames: Sequence[Frame]) -> Array | None:
    if not all("centerOfMass" in f.data for f in frames):
        return None
    for frame in frames:
        line, values = frame.data["centerOfMass"]
        if len(values) not in (3, 9):
            raise SourceError(path, f"<centerOfMass> has {len(values)} numbers; expected 3 or 9", line)
    return np.array([f.data["centerOfMass"][1][:3] for f in frames])


def _contact(path: str | Path, frames: Sequence[Frame], labels: Sequence[str]) -> BoolArray:
    for frame in frames:
        line, values = frame.data["footContacts"]
        if len(values) != len(labels):
            raise SourceError(
                path, f"<footContacts> has {len(values)} numbers, {len(labels)} are defined", line
            )
    order = [labels.index(c) for c in CONTACTS]
    return np.array([f.data["footContacts"][1][order] > 0.5 for f in frames])
