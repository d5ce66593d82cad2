"""BVH files as arrays: `read_bvh` and `write_bvh`.

The file is kept as it is: its units, its axes, its angles in degrees. `imitor.motion.kinematics` turns it
into positions and rotations.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.atomic import atomic
from imitor.errors import SourceError
from imitor.motion.bvh_hierarchy import Hierarchy, Node
from imitor.motion.text_file import read_text
from imitor.types import Array

MAX_VALUES: Final = 100_000_000
"""Bound on the numbers of a motion, so that a broken or hostile file cannot take all memory."""

_MOTION = re.compile(r"^[ \t]*MOTION[ \t]*$", re.MULTILINE | re.IGNORECASE)
_FRAMES = re.compile(r"\s*Frames[ \t]*:[ \t]*(.*)", re.IGNORECASE)
_FRAME_TIME = re.compile(r"\s*Frame[ \t]+Time[ \t]*:[ \t]*(.*)", re.IGNORECASE)


@dataclass(frozen=True)
class Bvh:
    """What a BVH file says.

    Attributes:
        nodes: The tree, parents before children, in the order of the file.
        motion: Channel values, shape (T, C) [file units, degrees]; columns in the order of the nodes.
        frame_time_s: Time between frames as written [s].
    """

    nodes: tuple[Node, ...]
    motion: Array
    frame_time_s: float

    @property
    def n_channels(self) -> int:
        """Number of channels, the columns of ``motion``."""
        return sum(len(node.channels) for node in self.nodes)


def read_bvh(path: str | Path) -> Bvh:
    """Read a BVH file.

    Raises:
        SourceError: The file cannot be read or is not a well-formed BVH file; says where and why.
    """
    text = read_text(path, "a BVH file")
    start = _MOTION.search(text)
    header = text[: start.start()] if start else text
    nodes = Hierarchy(path, header).parse(complete=start is not None)
    if start is None:
        raise SourceError(path, "the file ends without a MOTION section", header.count("\n") + 1)
    return _read_motion(path, text, start.end(), nodes)


def write_bvh(
    path: str | Path, nodes: Sequence[Node], motion: Array, frame_time_s: float, digits: int = 17
) -> None:
    """Write a BVH file; it appears whole or not at all.

    Args:
        path: The file.
        nodes: The tree, parents before children; the children of a node in their order.
        motion: Channel values, shape (T, C) [file units, degrees]; columns in the order of ``nodes``.
        frame_time_s: Time between frames [s].
        digits: Significant digits of a number; 17 keep every bit.
    """
    lines = ["HIERARCHY"]
    children: list[list[int]] = [[] for _ in nodes]
    for i, node in enumerate(nodes):
        if node.parent >= 0:
            children[node.parent].append(i)
    columns: list[int] = []
    first = np.cumsum([0, *(len(n.channels) for n in nodes)])
    todo: list[tuple[int, int]] = [(0, 0)]  # (node, depth); a negative node closes a brace
    while todo:
        i, depth = todo.pop()
        pad = "\t" * depth
        if i < 0:
            lines.append(f"{pad}}}")
            continue
        node = nodes[i]
        kind = "End Site" if node.is_end else f"{'ROOT' if node.parent < 0 else 'JOINT'} {node.name}"
        lines += [f"{pad}{kind}", f"{pad}{{"]
        lines.append(f"{pad}\tOFFSET " + " ".join(f"{v:.{digits}g}" for v in node.offset))
        if not node.is_end:
            lines.append(f"{pad}\t" + " ".join(["CHANNELS", str(len(node.channels)), *node.channels]))
        columns += range(first[i], first[i + 1])
        todo.append((-1, depth))
        todo += [(child, depth + 1) for child in reversed(children[i])]
    lines += ["MOTION", f"Frames: {len(motion)}", f"Frame Time: {frame_time_s:.{digits}g}"]
    # The order of the file is depth first, whatever the order of the nodes.
    lines += [" ".join(f"{v:.{digits}g}" for v in row) for row in np.asarray(motion)[:, columns]]
    with atomic(Path(path)) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _read_motion(path: str | Path, text: str, at: int, nodes: tuple[Node, ...]) -> Bvh:
    def line_of(position: int) -> int:
        return text.count("\n", 0, position) + 1

    def number(pattern: re.Pattern[str], label: str) -> tuple[float, int]:
        nonlocal at
        match = pattern.match(text, at)
        if match is None:
            rest = re.compile(r"\s*(\S*)").match(text, at)
            found = rest.group(1)[:40] if rest else ""
            raise SourceError(
                path,
                f"expected '{label}:' in the MOTION section, found '{found}'",
                line_of(rest.start(1) if rest else at),
            )
        at, line = match.end(), line_of(match.start(1))
        try:
            value = float(match.group(1))
        except ValueError:
            raise SourceError(
                path, f"'{label}:' needs a number, found '{match.group(1).strip()[:40]}'", line
            ) from None
        return value, line

    frames, frames_line = number(_FRAMES, "Frames")
    if not (np.isfinite(frames) and frames >= 1 and frames == int(frames)):
        raise SourceError(path, f"'Frames:' is {frames:g}; a motion has one frame at least", frames_line)
    dt, dt_line = number(_FRAME_TIME, "Frame Time")
    if not (np.isfinite(dt) and dt > 0.0):
        raise SourceError(
            path, f"'Frame Time:' is {dt:g}; the time between frames is greater than 0 s", dt_line
        )
    width = sum(len(n.channels) for n in nodes)
    if width == 0:
        raise SourceError(path, "no joint has a channel, so nothing moves", frames_line)
    if frames * width > MAX_VALUES:
        raise SourceError(
            path, f"{frames:.0f} frames of {width} channels are more than {MAX_VALUES} numbers", frames_line
        )
    values = _numbers(text[at:])
    if values is None or not np.isfinite(values).all():
        raise _bad_token(path, text[at:], line_of(at))
    if values.size != int(frames) * width:
        message, line = _wrong_count(text[at:], int(frames), width, values.size)
        raise SourceError(path, message, frames_line if line is None else line_of(at) + line)
    return Bvh(nodes, values.reshape(int(frames), width), dt)


def _numbers(block: str) -> Array | None:
    """Convert a block of numbers in one call; None when something in it is not a number."""
    block = block.strip()
    if not block:  # of blanks alone numpy makes a number
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(block, dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _bad_token(path: str | Path, block: str, first_line: int) -> SourceError:
    """Look for the number that is none; only after the fast way has failed."""
    for number, line in enumerate(block.split("\n"), first_line):
        for column, word in enumerate(line.split(), 1):
            try:
                finite = np.isfinite(float(word))
            except ValueError:
                return SourceError(
                    path, f"value {column} of this line is '{word[:40]}', not a number", number
                )
            if not finite:
                return SourceError(
                    path, f"value {column} of this line is '{word[:40]}', not a finite number", number
                )
    return SourceError(path, "the motion holds something that is not a number", first_line)


def _wrong_count(block: str, frames: int, width: int, size: int) -> tuple[str, int | None]:
    """Say how the amount of numbers differs, and in which line of the block when that can be told."""
    if size % width == 0:
        return (
            f"'Frames:' says {frames}, but the motion holds {size // width} frames of {width} numbers",
            None,
        )
    total = f"{frames} frames of {width} numbers make {frames * width}, the motion holds {size}"
    counts = [len(line.split()) for line in block.split("\n")]
    odd = [(number, n) for number, n in enumerate(counts) if n not in (0, width)]
    if len(odd) <= max(1, len(counts) // 10):  # not merely numbers wrapped over lines
        number, n = odd[0]
        return f"this line has {n} numbers, the hierarchy has {width} channels ({total})", number
    return total, None
