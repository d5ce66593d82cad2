"""Arrays that grow a row a frame, in memory or, for runs without a known end, on disk."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

BLOCK: Final = 512
"""Rows that are kept in memory before they go to disk."""


class Rows:
    """Named arrays of equal length to which rows are added.

    Args:
        like: Name to shape of a row and type: ``{"time_s": ((), np.float64)}``.
        size: Rows to make room for at first.
        folder: Where finished blocks go; ``None`` keeps everything in memory, which then grows with the run.
    """

    def __init__(
        self, like: Mapping[str, tuple[tuple[int, ...], Any]], size: int = 1024, folder: Path | None = None
    ) -> None:
        self._on_disk = folder is not None
        size = BLOCK if self._on_disk else max(size, 16)
        self._rows: dict[str, NDArray[Any]] = {n: np.zeros((size, *s), dtype=t) for n, (s, t) in like.items()}
        self._files: dict[str, IO[bytes]] = {}
        if folder is not None:  # without a name: whatever happens, nothing is left behind
            self._files = {n: tempfile.TemporaryFile(dir=folder) for n in like}  # noqa: SIM115
        self._size, self._count, self._written = size, 0, 0

    def __len__(self) -> int:
        return self._written + self._count

    def next(self) -> tuple[Mapping[str, NDArray[Any]], int]:
        """Return the arrays and the index of the row to fill; the row counts from now on."""
        if self._count == self._size:
            self._make_room()
        i = self._count
        self._count += 1
        return self._rows, i

    def _make_room(self) -> None:
        if self._on_disk:
            self._flush()
            return
        self._size *= 2
        for name, rows in self._rows.items():
            grown = np.zeros((self._size, *rows.shape[1:]), dtype=rows.dtype)
            grown[: self._count] = rows
            self._rows[name] = grown

    def _flush(self) -> None:
        for name, rows in self._rows.items():
            file = self._files[name]
            file.seek(self._written * rows[:1].nbytes)  # begins again where a full disk stopped it
            file.write(rows[: self._count].tobytes())
            file.flush()
        for rows in self._rows.values():
            rows[:] = 0
        self._written += self._count
        self._count = 0

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the rows so far, shape (T, ...) each; those on disk are mapped, not read."""
        if not self._on_disk:
            return {name: rows[: self._count] for name, rows in self._rows.items()}
        self._flush()
        out: dict[str, NDArray[Any]] = {}
        for name, rows in self._rows.items():
            shape, file = (self._written, *rows.shape[1:]), self._files[name]
            whole = int(np.prod(shape)) > 0
            out[name] = (
                np.memmap(file, rows.dtype, "r", shape=shape) if whole else np.zeros(shape, rows.dtype)
            )
        return out

    def clear(self) -> None:
        """Forget the rows in memory; what `arrays` gave before is written over by the next ones."""
        self._count = 0

    def close(self) -> None:
        """Give the disk space back; safe to call again."""
        for file in self._files.values():
            with contextlib.suppress(OSError):  # what a full disk did not take is not missed now
                file.close()


__all__ = ["BLOCK", "Rows"]
