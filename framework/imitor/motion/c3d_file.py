"""C3D files of optical markers: `read_c3d` and `write_c3d`.

ezc3d reads the file, in a process of its own, after the header was compared with the file's length: on a damaged file
it may abort, and it returns fewer frames of a cut one without a word.
"""

from __future__ import annotations

import importlib.util
import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.atomic import atomic
from imitor.errors import SourceError
from imitor.motion.marker_file import MAX_VALUES, UNIT_NAMES, MarkerFile
from imitor.types import Array

EXTRA: Final = "c3d"
"""The optional dependencies that bring the reader."""
BLOCK: Final = 512
_MAGIC: Final = 0x50
_ORDERS: Final = {84: "<", 85: "<", 86: ">"}
"""Byte order by the number of the processor: Intel, DEC, MIPS."""
_SIGN_BYTE: Final = {84: 3, 85: 1, 86: 0}
"""Where a float keeps its sign [byte]."""
_MOST_FRAMES: Final = 65535
"""Frame numbers have 16 bits: from here on the header cannot tell how many there are."""
_PATIENCE_S: Final = 120.0


@dataclass(frozen=True)
class Header:
    """What the first block says.

    Attributes:
        points: Points in a frame.
        analog: Analog values in a frame.
        frames: Number of frames; 0 where 16 bits cannot hold it.
        data_block: Block where the frames begin, from 1.
        value_bytes: Bytes of a number: 4 for floats, 2 for integers.
    """

    points: int
    analog: int
    frames: int
    data_block: int
    value_bytes: int

    @property
    def least_bytes(self) -> int:
        """How long the file must be."""
        frame = (4 * self.points + self.analog) * self.value_bytes
        return (self.data_block - 1) * BLOCK + self.frames * frame


def read_c3d(path: str | Path) -> MarkerFile:
    """Read the points of a C3D file; points that are angles, forces and the like are left out.

    Raises:
        SourceError: The file is broken or no C3D file, or the reader is not installed; says what to do.
    """
    header = check_header(path)
    if importlib.util.find_spec("ezc3d") is None:
        raise SourceError(
            path, f"C3D files are read with ezc3d, which is not installed: pip install 'imitor[{EXTRA}]'"
        )
    if header.frames * header.points * 3 > MAX_VALUES:
        raise SourceError(path, f"{header.frames} frames of {header.points} points are more than can be read")
    data = _in_a_process_of_its_own(path)
    position = data["position"].astype(np.float64)
    if header.frames and len(position) < header.frames:
        raise SourceError(
            path,
            f"the header promises {header.frames} frames, {len(position)} could be read: the file is damaged",
        )
    rate_hz = float(data["rate_hz"])
    if not 0.0 < rate_hz < np.inf:
        raise SourceError(path, f"POINT:RATE is {rate_hz:g}, not a number greater than 0")
    notes = []
    labels = [str(label) for label in data["labels"]]
    if len(labels) < position.shape[1]:
        notes.append(
            f"{position.shape[1] - len(labels)} of {position.shape[1]} points have no label: left out"
        )
    computed = {str(name) for name in data["computed"]}
    keep = [
        i for i, label in enumerate(labels[: position.shape[1]])
        if label and not label.startswith("*") and label not in computed
    ]  # fmt: skip
    position = position[:, keep]
    position[(position == 0.0).all(axis=-1)] = np.nan
    return MarkerFile(
        tuple(labels[i] for i in keep),
        position,
        rate_hz,
        unit=UNIT_NAMES.get(str(next(iter(data["unit"]), "")).lower(), ""),
        up=_axis(str(next(iter(data["up"]), ""))),
        first_frame=int(data["first_frame"]),
        notes=tuple(notes),
    )


def check_header(path: str | Path) -> Header:
    """Read the header and compare it with the file's length.

    Raises:
        SourceError: There is no such file, it is no C3D file, or it is cut off.
    """
    try:
        size = Path(path).stat().st_size
        with Path(path).open("rb") as file:
            block = file.read(BLOCK)
            file.seek((max(block[0] if block else 1, 1) - 1) * BLOCK)
            parameters = file.read(4)
    except FileNotFoundError:
        raise SourceError(path, "there is no such file") from None
    except IsADirectoryError:
        raise SourceError(path, "is a folder, not a file") from None
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror}") from None
    if not block:
        raise SourceError(path, "the file is empty")
    if len(block) < BLOCK or block[1] != _MAGIC:
        raise SourceError(
            path, "is no C3D file: the second byte of one is 0x50, and its header has 512 bytes"
        )
    if len(parameters) < 4 or parameters[3] not in _ORDERS:
        raise SourceError(
            path, f"its parameters should begin at block {block[0]}, byte 3 of them tell the processor"
        )
    processor = parameters[3]
    order = _ORDERS[processor]
    points, analog, first, last = struct.unpack_from(f"{order}4H", block, 2)
    (data_block,) = struct.unpack_from(f"{order}H", block, 16)
    floats = bool(block[12 + _SIGN_BYTE[processor]] & 0x80)
    frames = 0 if last >= _MOST_FRAMES else last - first + 1
    if points == 0:
        raise SourceError(path, "the file holds no points")
    if frames < 0 or (frames == 0 and last < _MOST_FRAMES):
        raise SourceError(path, f"the header counts frames from {first} to {last}: there are none")
    header = Header(points, analog, frames, max(data_block, 1), 4 if floats else 2)
    if size < header.least_bytes:
        whole = (
            (size - (header.data_block - 1) * BLOCK)
            * frames
            // max(header.least_bytes - (header.data_block - 1) * BLOCK, 1)
        )
        raise SourceError(
            path,
            f"the header promises {frames} frames in {header.least_bytes} bytes, the file has {size} bytes, "
            f"{max(whole, 0)} frames: it is cut off",
        )
    return header


def _in_a_process_of_its_own(path: str | Path) -> dict[str, Array]:
    child = Path(__file__).with_name("c3d_child.py")
    with tempfile.TemporaryDirectory(prefix="imitor-c3d-") as folder:
        out = Path(folder) / "points.npz"
        command = [sys.executable, str(child), str(Path(path).absolute()), str(out)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=_PATIENCE_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise SourceError(path, f"ezc3d did not come back within {_PATIENCE_S:.0f} s") from None
        if done.returncode != 0 or not out.is_file():
            said = [line for line in done.stderr.strip().splitlines() if line.strip()]
            why = said[-1].strip() if said else f"it ended with status {done.returncode}"
            raise SourceError(path, f"the file is damaged, ezc3d cannot read it: {why}")
        with np.load(out, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}


def _axis(text: str) -> str:
    """Return our name of an axis such as ``+Z``, or an empty string."""
    word = text.strip().lower().lstrip("+")
    return word if word.lstrip("-") in {"x", "y", "z"} and len(word) <= 2 else ""


def write_c3d(path: str | Path, markers: MarkerFile) -> None:
    """Write a C3D file of floats, little endian; a lost point has the residual -1. It appears whole or not at all.

    Args:
        path: The file.
        markers: What to write; its ``up`` becomes ``Y_SCREEN``.
    """
    frames, count = markers.position.shape[:2]
    last = markers.first_frame + frames - 1
    screen = {} if not markers.up else {"X_SCREEN": ["+X"], "Y_SCREEN": [_screen(markers.up)]}
    parameters = _parameters(
        {
            "POINT": {
                "USED": count,
                "SCALE": -1.0,
                "RATE": float(markers.rate_hz),
                "DATA_START": 0,
                "FRAMES": min(frames, _MOST_FRAMES),
                "UNITS": [markers.unit or "m"],
                "LABELS": list(markers.labels),
                **screen,
            },
            "ANALOG": {"USED": 0},
        }
    )
    data_block = 2 + len(parameters) // BLOCK
    place = parameters.index(b"DATA_START") + len(b"DATA_START") + 4
    parameters = parameters[:place] + struct.pack("<h", data_block) + parameters[place + 2 :]
    header = struct.pack(
        "<BB5HfHHf", 2, _MAGIC, count, 0, markers.first_frame, min(last, _MOST_FRAMES), 0, -1.0, data_block, 0,
        markers.rate_hz,
    )  # fmt: skip
    values = np.zeros((frames, count, 4), dtype="<f4")
    values[..., :3] = np.where(markers.seen[..., None], markers.position, 0.0)
    values[..., 3] = np.where(markers.seen, 0.0, -1.0)
    with atomic(Path(path)) as partial:
        partial.write_bytes(_padded(header) + parameters + _padded(values.tobytes()))


def _screen(up: str) -> str:
    return up.upper() if up.startswith("-") else f"+{up.upper()}"


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % BLOCK)


def _parameters(groups: dict[str, dict[str, int | float | list[str]]]) -> bytes:
    """Return the parameter section: groups with a negative number, then their parameters."""
    parts = []
    for number, (group, members) in enumerate(groups.items(), 1):
        parts.append((-number, group, b"\0"))
        for name, value in members.items():
            if isinstance(value, list):
                width = max(len(v) for v in value)
                body = struct.pack("<bBBB", -1, 2, width, len(value)) + b"".join(
                    v.encode("latin-1").ljust(width) for v in value
                )
            elif isinstance(value, float):
                body = struct.pack("<bBf", 4, 0, value)
            else:
                body = struct.pack("<bBh", 2, 0, value)
            parts.append((number, name, body + b"\0"))
    out = b""
    for i, (number, name, body) in enumerate(parts):
        offset = 0 if i == len(parts) - 1 else len(body) + 2
        out += struct.pack("<bb", len(name), number) + name.encode() + struct.pack("<h", offset) + body
    blocks = -(-(len(out) + 4) // BLOCK)
    return _padded(struct.pack("<BBBB", 1, _MAGIC, blocks, 84) + out)
