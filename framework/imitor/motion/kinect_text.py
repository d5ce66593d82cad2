"""Text tables of depth-camera skeletons: reading the file, telling its layout, converting its numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.kinect_points import canonical
from imitor.types import Array

STATES: Final = {"tracked": 1.0, "inferred": 0.5, "nottracked": 0.0, "not tracked": 0.0}
"""Tracking states of the Microsoft SDK as confidences [-]."""

MIN_POINTS: Final = 8
"""A header with fewer known points is no skeleton; a seated Kinect v1 gives 10."""

JOINT_COLUMNS: Final = frozenset({"jointname", "joint", "jointtype", "joint_name", "joint_type"})
"""Names of the column that names the point, in a table with a line a point."""

OFFSET_COLUMNS: Final = 66
NUMBER_COLUMNS: Final = {
    45: (15, 3), 60: (20, 3), 75: (25, 3), 80: (20, 4), 100: (25, 4), 105: (15, 7), 140: (20, 7), 175: (25, 7),
}  # fmt: skip
"""Columns of a table without header -> points and values a point: x y z, then a confidence or a quaternion."""

_AXIS = re.compile(
    r"^(.*?)[\s._\-:]*\(?([xyz]|c|conf|confidence|state|status|trackingstate)\)?$", re.IGNORECASE
)


def tell_layout(lines: Sequence[str]) -> str | None:
    """Tell how a table is laid out, from its first lines.

    Returns:
        ``tuples`` (a line a frame, a bracket a point), ``rows`` (a line a point), ``cells`` (a header of points, x y z
        in one cell), ``columns`` (a header of coordinates), ``offsets`` (22 joints in their parents), ``numbers`` (no
        header), or None for anything else.
    """
    written = [line for line in lines if line.strip()][:2]
    if not written:
        return None
    head = written[0].strip()
    if head.lower().startswith("version") and len(written) > 1:
        head = written[1].strip()
    if re.match(r"[^(]*\(\s*\w+\s*,\s*\w+\s*,\s*[-+.\d]", head):
        return "tuples"
    cells = split(head)
    if _are_numbers(cells):
        n = len(cells)
        if n == OFFSET_COLUMNS:
            return "offsets"
        return "numbers" if n in NUMBER_COLUMNS or n - 1 in NUMBER_COLUMNS else None
    words = {c.lower() for c in cells}
    if words >= {"x", "y", "z"} and words & JOINT_COLUMNS:
        return "rows"
    if sum(canonical(c) is not None for c in cells) >= MIN_POINTS:
        return "cells"
    triples = {name for name, axis in map(split_axis, cells) if axis in "xyz" and canonical(name)}
    return "columns" if len(triples) >= MIN_POINTS else None


def split(line: str) -> list[str]:
    """Return the cells of a line: between ``;``, tabs or commas if there are any, else between blanks."""
    line = line.strip("\n ")
    for mark in ";\t,":
        if mark in line:
            return [c.strip() for c in line.rstrip(mark + " ").split(mark)]
    return line.split()


def split_axis(cell: str) -> tuple[str, str]:
    """Return a column's point and what it holds: ``x``, ``y``, ``z``, ``c`` (confidence) or empty."""
    match = _AXIS.match(cell.strip())
    if match is None or not match[1]:
        return cell, ""
    axis = match[2].lower()
    return match[1], axis if axis in "xyz" else "c"


def _are_numbers(cells: Sequence[str]) -> bool:
    try:
        [float(c) for c in cells]
    except ValueError:
        return False
    return True


def numbers(path: str | Path, cells: Sequence[str], line: int) -> Array:
    """Return the values of a line; ``nan`` and empty cells are gaps.

    Raises:
        SourceError: A cell is no number or infinite.
    """
    try:
        values = np.array([float(c) if c else np.nan for c in cells])
    except ValueError:
        at, word = next((i, c) for i, c in enumerate(cells) if c and not _are_numbers([c]))
        raise SourceError(path, f"value {at + 1} of this line is '{word}', not a number", line) from None
    if np.isinf(values).any():
        at = int(np.flatnonzero(np.isinf(values))[0])
        raise SourceError(path, f"value {at + 1} of this line is '{cells[at]}', not a finite number", line)
    return values


def confidence(path: str | Path, word: str, line: int) -> float:
    """Return a tracking state, as a word or a number from 0 to 1, as a confidence [-].

    Raises:
        SourceError: It is neither.
    """
    state = STATES.get(word.strip().lower())
    if state is not None:
        return state
    try:
        value = float(word)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise SourceError(
            path,
            f"'{word.strip()}' is no tracking state; legal are Tracked, Inferred, NotTracked and 0 to 1",
            line,
        )
    return value
