"""TRC files of optical markers: `read_trc` and `write_trc`.

Tab-separated text. The number of markers is not taken from the header, which errs, but from the names; a cell
without text is a lost coordinate; cells are split at tabs alone, because a row may begin with empty ones.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from imitor.atomic import atomic
from imitor.errors import SourceError
from imitor.motion.marker_file import MAX_VALUES, UNIT_NAMES, MarkerFile
from imitor.motion.text_file import read_lines
from imitor.types import Array

_MARK: Final = "PathFileType"
_COLUMN: Final = re.compile(r"^[XYZ]\d+$")
_TIME_TOLERANCE: Final = 0.02
"""The time column is rounded: the rate it tells may differ by this from the header's [-]."""


def is_trc(path: Path) -> bool:
    """Tell from the first bytes whether a file is a TRC file."""
    with path.open("rb") as file:
        return file.read(64).lstrip(b"\xef\xbb\xbf").startswith(_MARK.encode())


def read_trc(path: str | Path) -> MarkerFile:
    """Read a TRC file.

    Raises:
        SourceError: The file is broken or no TRC file; says where and why.
    """
    lines = read_lines(path, "a TRC file")
    facts = _header(path, lines)
    names, row = _names(path, lines)
    rate_hz = _positive(path, facts, "DataRate")
    position, time, notes = _rows(path, lines, row, len(names))
    told = facts.get("NumFrames", "")
    if told.isdigit() and int(told) > len(position):
        raise SourceError(
            path, f"the header promises {told} frames, the file holds {len(position)}: it is cut off"
        )
    if told.isdigit() and int(told) < len(position):
        notes.append(f"the header says {told} frames, the file holds {len(position)}")
    number = facts.get("NumMarkers", "")
    if number.isdigit() and int(number) != len(names):
        notes.append(f"the header says {number} markers, {len(names)} are named")
    if len(time) > 2:
        step = float(np.median(np.diff(time)))
        if step > 0.0 and abs(step * rate_hz - 1.0) > max(_TIME_TOLERANCE, 6e-4 * rate_hz):
            notes.append(f"the time column steps by {step:g} s, the header's rate is {rate_hz:g} Hz")
    unit = UNIT_NAMES.get(facts.get("Units", "").lower(), "")
    return MarkerFile(tuple(names), position, rate_hz, unit=unit, notes=tuple(notes))


def _header(path: str | Path, lines: Sequence[str]) -> dict[str, str]:
    """Return what lines 2 and 3 say; values are matched to their names by order, empty cells aside."""
    if not lines[0].startswith(_MARK):
        raise SourceError(path, f"a TRC file begins with '{_MARK}'", 1)
    if len(lines) < 4:
        raise SourceError(path, "the file ends within its header", len(lines))
    names, values = lines[1].split(), [v.strip() for v in lines[2].split("\t") if v.strip()]
    if not names or names[0] != "DataRate":
        raise SourceError(path, "line 2 of a TRC file names DataRate, NumFrames, Units, …", 2)
    if len(values) < len(names):
        values = lines[2].split()
    return dict(zip(names, values, strict=False))


def _names(path: str | Path, lines: Sequence[str]) -> tuple[list[str], int]:
    """Return the markers' names and the row of the first frame."""
    cells = [c.strip() for c in lines[3].split("\t")]
    if cells[0].lower().rstrip("#") not in {"frame", "frames"}:
        raise SourceError(path, "line 4 of a TRC file begins with Frame# and Time", 4)
    names = [c for c in cells[1:] if c][1:]
    if not names:
        raise SourceError(path, "line 4 names no marker", 4)
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise SourceError(path, f"line 4 names a marker twice: {', '.join(twice)}", 4)
    row = 4
    for _ in range(2):  # the row of X1 Y1 Z1 and an empty one; either may be missing
        cells = [c.strip() for c in lines[row].split("\t") if c.strip()] if row < len(lines) else ["end"]
        if not cells or _COLUMN.match(cells[0]):
            row += 1
    return names, row


def _rows(path: str | Path, lines: Sequence[str], row: int, markers: int) -> tuple[Array, Array, list[str]]:
    rows = [(number, text) for number, text in enumerate(lines[row:], row + 1) if text.strip(" ")]
    if not rows:
        raise SourceError(path, "the file holds no frame", min(row, len(lines)))
    if len(rows) * markers * 3 > MAX_VALUES:
        raise SourceError(path, f"{len(rows)} frames of {markers} markers are more than can be read")
    values = np.full((len(rows), markers * 3), np.nan)
    time = np.zeros(len(rows))
    short = 0
    for i, (number, text) in enumerate(rows):
        cells = text.split("\t")
        body = cells[2:]
        while len(body) > markers * 3 and not body[-1].strip():
            body.pop()
        if len(body) > markers * 3:
            raise SourceError(path, f"{len(body)} coordinates, {markers} markers have {markers * 3}", number)
        if len(body) < markers * 3:
            if i < len(rows) - 1 or len(body) % 3:
                raise SourceError(
                    path,
                    f"{len(body)} coordinates, {markers} markers have {markers * 3}"
                    + (": the file is cut off" if i == len(rows) - 1 else ""),
                    number,
                )
            short += 1
        if len(cells) > 1 and cells[1].strip():
            time[i] = _number(path, cells[1], number, "the time")
        for k, cell in enumerate(body):
            if cell and not cell.isspace():
                values[i, k] = _number(path, cell, number, f"coordinate {k + 1}")
    position = values.reshape(len(rows), markers, 3)
    lost = np.isnan(position).any(axis=-1) | (position == 0.0).all(axis=-1)
    position[lost] = np.nan
    notes = ["the last row ends early: its last markers are lost"] if short else []
    return position, time, notes


def _number(path: str | Path, cell: str, line: int, what: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise SourceError(path, f"{what} is '{cell.strip()[:20]}', not a number", line) from None
    if np.isinf(value):
        raise SourceError(path, f"{what} is not finite", line)
    return value


def _positive(path: str | Path, facts: dict[str, str], name: str) -> float:
    text = facts.get(name, "")
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < np.inf:
        raise SourceError(path, f"{name} is '{text}', not a number greater than 0", 3)
    return value


def write_trc(path: str | Path, markers: MarkerFile) -> None:
    """Write a TRC file; lost points are empty cells. It appears whole or not at all."""
    frames, count = markers.position.shape[:2]
    rate = f"{markers.rate_hz:.2f}"
    lines = [
        f"{_MARK}\t4\t(X/Y/Z)\t{Path(path).name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "\t".join([rate, rate, str(frames), str(count), markers.unit or "m", rate, "1", str(frames)]),
        "Frame#\tTime\t" + "\t\t\t".join(markers.labels) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(count) for axis in "XYZ"),
        "",
    ]
    for i, row in enumerate(markers.position):
        cells = ["" if np.isnan(v) else f"{v:.6f}" for v in row.ravel()]
        lines.append("\t".join([str(i + 1), f"{i / markers.rate_hz:.5f}", *cells]))
    with atomic(Path(path)) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
