"""The HIERARCHY section of a BVH file: its tree, and the parser that says what is wrong with it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError, did_you_mean
from imitor.types import Array

CHANNELS: Final = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")

MAX_NODES: Final = 4000
MAX_DEPTH: Final = 256
"""Bounds on what is read: no human skeleton comes near."""

_CANONICAL = {c.lower(): c for c in CHANNELS}
_TOKEN = re.compile(r"[{}]|[^\s{}]+")


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


class Hierarchy:
    """Parser of the HIERARCHY section: tokens with their lines, a stack instead of recursion."""

    def __init__(self, path: str | Path, text: str) -> None:
        self.path = path
        self.tokens: list[tuple[str, int]] = [
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
        word, _ = self.tokens[self.at - 1]
        return word

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
                    f"legal are {', '.join(CHANNELS)}" + (f"; {hint}" if hint else ""),
                    line,
                )
            if channel in channels and channel.endswith("position"):
                raise self.fail(f"'{name}' has the channel {channel} twice", line)
            channels.append(channel)
        return tuple(channels)
