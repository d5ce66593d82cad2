"""Plain tables on a terminal or in a file."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Sequence


def table(rows: Sequence[Sequence[str]], *, indent: str = "  ", right: Sequence[int] = ()) -> str:
    """Return rows as aligned columns; the last column is wrapped to the terminal.

    Args:
        rows: Cells, the same number in each row.
        indent: Put before each line.
        right: Indices of the columns that are aligned to the right.
    """
    if not rows:
        return ""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    start = len(indent) + sum(w + 2 for w in widths[:-1])
    room = max(shutil.get_terminal_size((100, 24)).columns - start, 30)
    lines = []
    for row in rows:
        cells = [
            c.rjust(w) if i in right else c.ljust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        last = textwrap.wrap(row[-1], room) or [""]
        if len(last) == 1:
            last = [cells[-1]]
        lines.append((indent + "  ".join([*cells[:-1], last[0]])).rstrip())
        lines += [" " * start + more for more in last[1:]]
    return "\n".join(lines)


def plural(n: int, word: str) -> str:
    """Return a count with its word: ``1 stage``, ``3 stages``."""
    return f"{n} {word}" + ("" if n == 1 else "s")
