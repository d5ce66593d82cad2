"""A document: plain data, and for each place in it where that is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from imitor.errors import Problem

_LONGEST_LINE: Final = 200

Loc = tuple[str | int, ...]
"""A place in a document: keys and list indices from the top, e.g. ``("stages", 2, "gain")``."""


@dataclass(frozen=True)
class Mark:
    """Where something is written: in a file, or on the command line (``line`` 0)."""

    path: str
    line: int  # from 1; 0 when no line is known
    column: int  # from 1; 0 when no column is known


@dataclass
class Document:
    """Plain data of a YAML text with the place of every key and value.

    Attributes:
        path: Name of the file, for messages.
        data: Mappings with text keys, lists and scalars; ``None`` when the text could not be read.
        problems: What is wrong with the text itself.
        lines: The lines of the text.
        values: Mark of each value.
        keys: Mark of each mapping key.
    """

    path: str
    data: Any = None
    problems: list[Problem] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    values: dict[Loc, Mark] = field(default_factory=dict)
    keys: dict[Loc, Mark] = field(default_factory=dict)

    def mark_of(self, loc: Loc, *, key: bool = False) -> Mark:
        """Return the mark of the value (or of the key) at a place, else of the nearest place around it."""
        if key and loc in self.keys:
            return self.keys[loc]
        for n in range(len(loc), -1, -1):
            if loc[:n] in self.values:
                return self.values[loc[:n]]
        return Mark(self.path, 0, 0)

    def problem(self, loc: Loc, message: str, suggestion: str = "", *, key: bool = False) -> Problem:
        """Return a problem at a place; ``key`` points at the key instead of the value."""
        return self.problem_at(self.mark_of(loc, key=key), dotted(loc), message, suggestion)

    def problem_at(self, mark: Mark, where: str, message: str, suggestion: str = "") -> Problem:
        """Return a problem at a mark."""
        known = mark.path == self.path and 0 < mark.line <= len(self.lines)
        line = self.lines[mark.line - 1].rstrip() if known else ""
        # A tab or a control character would shift the caret under the line; a very long line hides it.
        line = "".join(c if c.isprintable() else " " for c in line) if len(line) <= _LONGEST_LINE else ""
        return Problem(mark.path, mark.line, mark.column, where, message, suggestion, line)

    def at(self, loc: Loc) -> Any:
        """Return the data at a place; ``None`` when there is nothing."""
        data = self.data
        for step in loc:
            if not contains(data, step):
                return None
            data = data[step]
        return data

    def override(self, loc: Loc, data: Any, origin: str) -> None:
        """Put data at a place on behalf of the command line; problems there name ``origin``.

        The place around ``loc`` must exist, and where that is a list, so must the index.
        """
        for marks in (self.values, self.keys):
            for old in [other for other in marks if other[: len(loc)] == loc]:
                del marks[old]
        if loc:
            self.at(loc[:-1])[loc[-1]] = data
        else:
            self.data = data
        self.values[loc] = self.keys[loc] = Mark(origin, 0, 0)


def contains(data: Any, step: str | int) -> bool:
    """Tell whether a mapping has a key or a list an index."""
    if isinstance(data, Mapping):
        return step in data
    return isinstance(data, list) and isinstance(step, int) and 0 <= step < len(data)


def dotted(loc: Loc) -> str:
    """Return a place as text: ``stages[2].gain``."""
    text = ""
    for step in loc:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text
