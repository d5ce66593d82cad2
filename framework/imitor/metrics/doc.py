"""The table of figures in ``docs/metrics.md``: ``python -m imitor.metrics.doc`` prints it."""

from __future__ import annotations

from imitor.metrics.catalogue import FIGURES

HEADER = ("Figure", "Unit", "Good", "How it is taken", "What it is good for")


def table() -> str:
    """Return a Markdown table of every figure."""
    rows = [HEADER, tuple("---" for _ in HEADER)]
    for f in FIGURES:
        rows.append((f"`{f.name}`", f.unit, f.better, f.formula.replace("|", "\\|"), f.about))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"


if __name__ == "__main__":
    print(table(), end="")
