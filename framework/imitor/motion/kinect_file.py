"""Tables of depth-camera points as arrays: `read_capture`.

The file is kept as it is: its units and the sensor's axes. `imitor.motion.kinect_recording` makes a human of it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.kinect_offsets import chain_offsets
from imitor.motion.kinect_points import KINECT_V1, POINT_SETS, UI_PRMD, PointSet, canonical, find_set
from imitor.motion.kinect_text import (
    JOINT_COLUMNS,
    NUMBER_COLUMNS,
    confidence,
    numbers,
    split,
    split_axis,
    tell_layout,
)
from imitor.motion.text_file import read_lines
from imitor.types import Array

TIME_COLUMNS: Final = ("time_s", "time_ms", "time", "timestamp", "timestamp3", "relativetime", "t")
"""Names of a column of time stamps, best first; of the three of IntelliRehabDS the third holds milliseconds."""
TIME_UNITS: Final = (1.0, 1e-3, 1e-6, 1e-7)
"""Units of time stamps [s]: seconds, milliseconds, microseconds (OpenNI), ticks of 100 ns (Kinect)."""
NOMINAL_HZ: Final = 30.0
_WANTED: Final = "a table of skeleton points (.csv, .txt)"
_LAYOUTS: Final = (
    "expected a header of point names, lines of x y z for 15, 20 or 25 points (45, 60 or 75 columns, also with "
    "confidences or quaternions and a leading time), or brackets (name,state,x,y,z)"
)


@dataclass(frozen=True)
class Capture:
    """What a table says.

    Attributes:
        points: The point set.
        layout: How it is laid out, see `tell_layout`.
        position: Points in the sensor's axes, shape (T, P, 3) [file units]; NaN where there is none.
        confidence: From 0 (not tracked) over 0.5 (inferred) to 1 (tracked), shape (T, P) [-].
        time_s: Time stamps from the first frame, shape (T,) [s]; None when the file has none.
    """

    points: PointSet
    layout: str
    position: Array
    confidence: Array
    time_s: Array | None


@dataclass
class _Frame:
    """A frame while it is read: its line, its stamp as written and what was said about each point."""

    line: int
    stamp: float
    points: dict[str, tuple[float, float, float, float]]


def recognise(path: Path) -> bool:
    """Tell from the first bytes of a file whether it is a table of skeleton points."""
    with path.open("rb") as file:
        head = file.read(16384)
    if b"\0" in head:
        return False
    text = head.decode("utf-8-sig", errors="replace").replace("\r\n", "\n")
    return tell_layout(text.split("\n")) is not None


def read_capture(path: str | Path, angles_path: str | None = None) -> Capture:
    """Read a table of skeleton points.

    Args:
        path: The file.
        angles_path: The table of angles that belongs to a table of 22 offsets; default: beside it.

    Raises:
        SourceError: The file is broken or no such table; says where and why.
    """
    lines = read_lines(path, _WANTED)
    layout = tell_layout(lines)
    first = next(i for i, text in enumerate(lines) if text.strip())
    if layout is None:
        raise SourceError(path, f"is no table of skeleton points: {_LAYOUTS}", first + 1)
    if layout == "offsets":
        position = chain_offsets(path, angles_path, lambda p: number_table(p, read_lines(p, _WANTED)))
        position *= (-1.0, 1.0, -1.0)  # written with z towards the sensor and x to the left
        return Capture(UI_PRMD, layout, position, np.ones(position.shape[:2]), None)
    if layout == "numbers":
        return _from_numbers(path, lines)
    reader = {"tuples": _tuples, "rows": _rows, "cells": _cells, "columns": _columns}[layout]
    return _assemble(path, layout, reader(path, lines, first))


def number_table(path: str | Path, lines: Sequence[str]) -> tuple[Array, list[int]]:
    """Return a table without header, shape (T, C), and the line of each row.

    Raises:
        SourceError: A line has another number of columns than the first, or holds no numbers.
    """
    rows: list[Array] = []
    where: list[int] = []
    for i, text in enumerate(lines, start=1):
        if not text.strip():
            continue
        cells = split(text)
        if rows and len(cells) != len(rows[0]):
            raise SourceError(path, f"this line has {len(cells)} columns, the first has {len(rows[0])}", i)
        rows.append(numbers(path, cells, i))
        where.append(i)
    return np.array(rows), where


def _from_numbers(path: str | Path, lines: Sequence[str]) -> Capture:
    table, where = number_table(path, lines)
    timed = table.shape[1] not in NUMBER_COLUMNS
    stamps = table[:, 0] if timed else None
    values = table[:, 1:] if timed else table
    n_points, width = NUMBER_COLUMNS[values.shape[1]]
    if values.shape[1] == 60 and _looks_like_confidences(values):
        n_points, width = 15, 4
    grid = values.reshape(len(values), n_points, width)
    trust = np.ones(grid.shape[:2])
    if width == 4:
        trust = grid[..., 3]
        bad = ~((trust >= 0.0) & (trust <= 1.0))
        if bad.any():
            t, p = np.argwhere(bad)[0]
            raise SourceError(
                path, f"confidence of point {p + 1} is {trust[t, p]:g}; legal is 0 to 1", where[t]
            )
    points = next(s for s in POINT_SETS if len(s.points) == n_points)
    time = None if stamps is None else _seconds(path, stamps, where)
    return Capture(points, "numbers", grid[..., :3].copy(), trust, time)


def _looks_like_confidences(values: Array) -> bool:
    """Tell 15 points with confidences (of OpenNI, in mm) from 20 points: every fourth value is from 0 to 1."""
    grid = values.reshape(len(values), 15, 4)
    return bool(
        ((grid[..., 3] >= 0.0) & (grid[..., 3] <= 1.0)).all() and np.nanmax(np.abs(grid[..., :3])) > 50.0
    )


def _tuples(path: str | Path, lines: Sequence[str], first: int) -> list[_Frame]:
    """Read lines of ``stamp,…,(name,state,x,y,z,…),…``."""
    frames = []
    for i, text in enumerate(lines[first:], start=first + 1):
        if not text.strip() or text.lower().startswith("version"):
            continue
        head, _, rest = text.partition("(")
        stamps = [c for c in split(head) if c]
        stamp = float(numbers(path, stamps, i)[-1]) if stamps else np.nan
        points = {}
        if rest.count("(") + 1 != rest.count(")"):
            raise SourceError(path, "a bracket of this line is not closed; is the file cut off?", i)
        for group in re.findall(r"\(([^()]*)\)", "(" + rest):
            cells = [c.strip() for c in group.split(",")]
            if len(cells) < 5:
                raise SourceError(path, f"({group}) has {len(cells)} values; expected name,state,x,y,z", i)
            x, y, z = numbers(path, cells[2:5], i).tolist()
            points[_name(path, cells[0], i)] = (x, y, z, confidence(path, cells[1], i))
        frames.append(_Frame(i, stamp, points))
    return frames


def _rows(path: str | Path, lines: Sequence[str], first: int) -> list[_Frame]:
    """Read one line a point; a frame ends where a point comes again or the stamp changes."""
    header = [c.lower() for c in split(lines[first])]
    joint = next(i for i, c in enumerate(header) if c in JOINT_COLUMNS)
    at = [header.index(c) for c in "xyz"]
    state = next(
        (i for i, c in enumerate(header) if re.fullmatch(r"(tracking_?)?stat(e|us)|confidence", c)), None
    )
    time = next((header.index(c) for c in TIME_COLUMNS if c in header), None)
    frames: list[_Frame] = []
    for i, text in enumerate(lines[first + 1 :], start=first + 2):
        if not text.strip():
            continue
        cells = split(text)
        if len(cells) != len(header):
            raise SourceError(path, f"this line has {len(cells)} columns, the header has {len(header)}", i)
        name = _name(path, cells[joint], i)
        stamp = np.nan if time is None else float(numbers(path, [cells[time]], i)[0])
        if not frames or name in frames[-1].points or (time is not None and stamp != frames[-1].stamp):
            frames.append(_Frame(i, stamp, {}))
        x, y, z = numbers(path, [cells[k] for k in at], i).tolist()
        trust = 1.0 if state is None else confidence(path, cells[state], i)
        frames[-1].points[name] = (x, y, z, trust)
    return frames


def _cells(path: str | Path, lines: Sequence[str], first: int) -> list[_Frame]:
    """Read a header of points and lines with x y z in one cell; other columns are left out."""
    header = [canonical(c) for c in split(lines[first])]
    frames = []
    for i, text in enumerate(lines[first + 1 :], start=first + 2):
        if not text.strip():
            continue
        cells = split(text)
        if len(cells) < len(header):
            raise SourceError(path, f"this line has {len(cells)} columns, the header has {len(header)}", i)
        points = {}
        for name, cell in zip(header, cells, strict=False):
            if name is None:
                continue
            values = numbers(path, cell.split(), i)
            if len(values) != 3:
                raise SourceError(path, f"'{cell}' holds {len(values)} numbers for {name}; expected x y z", i)
            x, y, z = values.tolist()
            points[name] = (x, y, z, 1.0)
        frames.append(_Frame(i, np.nan, points))
    return frames


def _columns(path: str | Path, lines: Sequence[str], first: int) -> list[_Frame]:
    """Read a header such as ``time,head_x,head_y,head_z,head_confidence,…``."""
    header = split(lines[first])
    where: dict[str, dict[str, int]] = {}
    for k, cell in enumerate(header):
        name, axis = split_axis(cell)
        point = canonical(name) if axis else None
        if point is not None:
            where.setdefault(point, {})[axis] = k
    for point, axes in where.items():
        lacking = [a for a in "xyz" if a not in axes]
        if lacking:
            raise SourceError(path, f"the header has no {' and '.join(lacking)} of {point}", first + 1)
    low = [c.lower() for c in header]
    time = next((low.index(c) for c in TIME_COLUMNS if c in low), None)
    frames = []
    for i, text in enumerate(lines[first + 1 :], start=first + 2):
        if not text.strip():
            continue
        cells = split(text)
        if len(cells) != len(header):
            raise SourceError(path, f"this line has {len(cells)} columns, the header has {len(header)}", i)
        stamp = np.nan if time is None else float(numbers(path, [cells[time]], i)[0])
        points = {}
        for point, axes in where.items():
            x, y, z = numbers(path, [cells[axes[a]] for a in "xyz"], i).tolist()
            points[point] = (x, y, z, confidence(path, cells[axes["c"]], i) if "c" in axes else 1.0)
        frames.append(_Frame(i, stamp, points))
    return frames


def _name(path: str | Path, word: str, line: int) -> str:
    name = canonical(word)
    if name is None:
        raise SourceError(path, f"'{word}' is no point of a skeleton of 15, 20 or 25 points", line)
    return name


def _assemble(path: str | Path, layout: str, frames: list[_Frame]) -> Capture:
    """Put frames of named points into arrays."""
    if not frames:
        raise SourceError(path, "holds no frame: there is only a header")
    names = list(dict.fromkeys(n for f in frames for n in f.points))
    points = find_set(names)
    if points is None:
        extra = ", ".join(sorted(set(names) - set(KINECT_V1.points)))
        raise SourceError(path, f"the points fit no skeleton of 15, 20 or 25 points; not of 20: {extra}")
    table = np.full((len(frames), len(points.points), 4), np.nan)
    table[..., 3] = 0.0
    column = {p: k for k, p in enumerate(points.points)}
    for t, frame in enumerate(frames):
        for name, values in frame.points.items():
            table[t, column[name]] = values
    stamps = np.array([f.stamp for f in frames])
    time = None if np.isnan(stamps).all() else _seconds(path, stamps, [f.line for f in frames])
    return Capture(points, layout, table[..., :3].copy(), table[..., 3].copy(), time)


def _seconds(path: str | Path, stamps: Array, lines: Sequence[int]) -> Array:
    """Return stamps as seconds from the first; the unit is the one that makes the rate most like a sensor's.

    Raises:
        SourceError: A stamp is missing or not later than the one before.
    """
    if np.isnan(stamps).any():
        at = int(np.flatnonzero(np.isnan(stamps))[0])
        raise SourceError(path, "this frame has no time stamp; give each frame one, or none", lines[at])
    steps = np.diff(stamps)
    if (steps <= 0.0).any():
        at = int(np.flatnonzero(steps <= 0.0)[0])
        raise SourceError(
            path,
            f"time stamp {stamps[at + 1]:g} is not later than {stamps[at]:g} before it; "
            "sort the frames and leave out repeated ones",
            lines[at + 1],
        )
    if not len(steps):
        return np.zeros(1)
    unit = min(TIME_UNITS, key=lambda u: abs(np.log(np.median(steps) * u * NOMINAL_HZ)))
    return np.asarray((stamps - stamps[0]) * unit)
