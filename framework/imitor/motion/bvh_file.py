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
from imitor.errors import SourceError, did_you_mean
from imitor.types import Array

CHANNELS: Final = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")

MAX_NODES: Final = 4000
MAX_DEPTH: Final = 256
MAX_VALUES: Final = 100_000_000
"""Bounds on what is read, so that a broken or hostile file cannot take all memory."""

_CANONICAL = {c.lower(): c for c in CHANNELS}
_TOKEN = re.compile(r"[{}]|[^\s{}]+")
_MOTION = re.compile(r"^[ \t]*MOTION[ \t]*$", re.MULTILINE | re.IGNORECASE)
_FRAMES = re.compile(r"\s*Frames[ \t]*:[ \t]*(.*)", re.IGNORECASE)
_FRAME_TIME = re.compile(r"\s*Frame[ \t]+Time[ \t]*:[ \t]*(.*)", re.IGNORECASE)


@dataclass(frozen=True)
class Node:
    """A joint or an End Site of the tree. Nodes are known by their index: names may repeat.

    Attributes:
        name: The joint's name as written; empty for an End Site.
        parent: Index of the parent; -1 for the root.
        offset: Position in the parent's axes while no position channel replaces it, shape (3,) [file units].
        channels: Names out of `CHANNELS`, in the order of the file.
        is_end: Whether this is an End Site.
    """

    name: str
    parent: int
    offset: Array
    channels: tuple[str, ...] = ()
    is_end: bool = False


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
    text = _read_text(path)
    start = _MOTION.search(text)
    header = text[: start.start()] if start else text
    nodes = _Hierarchy(path, header).parse(complete=start is not None)
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


def _read_text(path: str | Path) -> str:
    file = Path(path)
    if file.is_dir():
        raise SourceError(path, "is a folder; give a BVH file")
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        raise SourceError(path, "there is no such file") from None
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror or error}") from error
    if not data.strip():
        raise SourceError(path, "the file is empty")
    if b"\0" in data[:4096]:
        raise SourceError(path, "is not a text file, so not BVH")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:  # old files hold names in the code page of their writer
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


class _Hierarchy:
    """Parser of the HIERARCHY section: tokens with their lines, a stack instead of recursion."""

    def __init__(self, path: str | Path, text: str) -> None:
        self.path = path
        self.tokens = [
            (token, number)
            for number, line in enumerate(text.split("\n"), 1)
            for token in _TOKEN.findall(line)
        ]
        self.at = 0

    def fail(self, message: str, line: int | None = None) -> SourceError:
        here = self.tokens[min(self.at, len(self.tokens) - 1)][1]
        return SourceError(self.path, message, here if line is None else line)

    def peek(self) -> str:
        return self.tokens[self.at][0] if self.at < len(self.tokens) else ""

    def next(self, expected: str) -> str:
        if self.at >= len(self.tokens):
            raise self.fail(f"the hierarchy ends where {expected} is expected")
        self.at += 1
        return self.tokens[self.at - 1][0]

    def parse(self, complete: bool) -> tuple[Node, ...]:
        if self.peek().upper() != "HIERARCHY":
            raise self.fail(f"a BVH file begins with HIERARCHY, this one with '{self.peek()[:40]}'")
        self.at += 1
        if self.peek().upper() != "ROOT":
            raise self.fail(f"expected ROOT after HIERARCHY, found '{self.peek()[:40]}'")
        nodes: list[Node] = []
        opened: list[tuple[int, int]] = []  # (node, line of its brace)
        while self.at < len(self.tokens):
            word, line = self.tokens[self.at]
            self.at += 1
            if word == "}":
                if not opened:
                    raise self.fail("a '}' too many: every block is closed already", line)
                opened.pop()
            elif word.upper() in ("ROOT", "JOINT", "END"):
                self._open(word.upper(), line, nodes, opened)
            else:
                raise self.fail(
                    f"expected JOINT, End Site or '}}', found '{word[:40]}'"
                    + (" (unknown words cannot be skipped)" if opened else ": the hierarchy is complete"),
                    line,
                )
        if opened:
            node, line = opened[-1]
            what = nodes[node].name or "End Site"
            cut = "" if complete else "; the file is cut off"
            raise self.fail(f"the '{{' of '{what}' is never closed{cut}", line)
        return tuple(nodes)

    def _open(self, kind: str, line: int, nodes: list[Node], opened: list[tuple[int, int]]) -> None:
        words = []
        while self.peek() not in ("{", "}", ""):
            words.append(self.next("'{'"))
        name = " ".join(words)
        if kind == "ROOT" and nodes:
            raise self.fail(
                f"a second ROOT '{name}' after '{nodes[0].name}': one file is one body here; "
                "write each body into a file of its own",
                line,
            )
        if kind == "JOINT" and not opened:
            raise self.fail(f"JOINT '{name}' stands outside the ROOT's braces", line)
        if kind == "END" and not opened:
            raise self.fail("an End Site stands outside the ROOT's braces", line)
        if opened and nodes[opened[-1][0]].is_end:
            raise self.fail(f"{kind} '{name}' stands inside an End Site, which can have no children", line)
        if self.next("'{'") != "{":
            raise self.fail(f"expected '{{' after {kind} '{name}'", line)
        brace = self.tokens[self.at - 1][1]
        offset = self._offset(name or "End Site")
        channels = self._channels(name or "End Site")
        nodes.append(
            Node(
                "" if kind == "END" else name,
                opened[-1][0] if opened else -1,
                offset,
                channels,
                kind == "END",
            )
        )
        opened.append((len(nodes) - 1, brace))
        if len(nodes) > MAX_NODES or len(opened) > MAX_DEPTH:
            raise self.fail(f"more than {MAX_NODES} joints or {MAX_DEPTH} levels: no human skeleton", line)

    def _offset(self, name: str) -> Array:
        if self.peek().upper() != "OFFSET":
            if self.peek().upper() == "CHANNELS":  # some writers put CHANNELS first, with OFFSET after it
                raise self.fail(f"'{name}' has CHANNELS before OFFSET; OFFSET comes first")
            return np.zeros(3)
        self.at += 1
        return np.array([self._number(f"three numbers after OFFSET of '{name}'") for _ in range(3)])

    def _number(self, expected: str) -> float:
        word = self.next(expected)
        line = self.tokens[self.at - 1][1]
        try:
            value = float(word)
        except ValueError:
            raise self.fail(f"expected {expected}, found '{word[:40]}'", line) from None
        if not np.isfinite(value):
            raise self.fail(
                f"expected {expected}, found '{word[:40]}': only finite numbers have a meaning", line
            )
        return value

    def _channels(self, name: str) -> tuple[str, ...]:
        if self.peek().upper() != "CHANNELS":
            return ()
        line = self.tokens[self.at][1]
        self.at += 1
        word = self.next(f"a number of channels of '{name}'")
        if not word.isdigit():
            raise self.fail(f"expected a number of channels of '{name}', found '{word[:40]}'", line)
        channels: list[str] = []
        for i in range(int(word)):
            given = self.next(f"channel {i + 1} of {word} of '{name}'")
            channel = _CANONICAL.get(given.lower())
            if channel is None:
                hint = did_you_mean(given, CHANNELS)
                raise self.fail(
                    f"channel {i + 1} of {word} of '{name}' is '{given[:40]}'; "
                    f"legal are {', '.join(CHANNELS)}"
                    + (f"; {hint}" if hint else ""),
                    line,
                )
            if channel in channels and channel.endswith("position"):
                raise self.fail(f"'{name}' has the channel {channel} twice", line)
            channels.append(channel)
        return tuple(channels)


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
        raise _wrong_count(path, text[at:], line_of(at), int(frames), width, values.size, frames_line)
    return Bvh(nodes, values.reshape(int(frames), width), dt)


def _numbers(block: str) -> Array | None:
    """Convert a block of numbers in one call; None when something in it is not a number."""
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


def _wrong_count(
    path: str | Path, block: str, first_line: int, frames: int, width: int, size: int, frames_line: int
) -> SourceError:
    if size % width == 0:
        return SourceError(
            path,
            f"'Frames:' says {frames}, but the motion holds {size // width} frames of {width} numbers",
            frames_line,
        )
    counts = [(number, len(line.split())) for number, line in enumerate(block.split("\n"), first_line)]
    odd = [(number, n) for number, n in counts if n not in (0, width)]
    total = f"{frames} frames of {width} numbers make {frames * width}, the motion holds {size}"
    if odd and len(odd) <= max(1, len(counts) // 10):  # one number a frame is missing or too many: say where
        number, n = odd[0]
        return SourceError(
            path, f"this line has {n} numbers, the hierarchy has {width} channels ({total})", number
        )
    return SourceError(path, total, frames_line)
