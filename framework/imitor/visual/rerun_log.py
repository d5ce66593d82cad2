"""Columns of frames into a recording stream of Rerun.

Columns are sent, never single values: even for one frame that is several times faster.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from imitor.types import Array

TIMELINE: Final = "time"


class RerunLog:
    """Writes what stays and what changes to a recording stream.

    Args:
        stream: A ``rerun.RecordingStream``.
    """

    def __init__(self, stream: Any) -> None:
        import rerun as rr

        self.rr = rr
        self._stream = stream
        self._seen: set[str] = set()

    def fixed(self, path: str, *things: Any) -> None:
        """Write what holds at all times."""
        self._stream.log(path, *things, static=True)

    def blueprint(self, blueprint: Any) -> None:
        """Say how everything is laid out in the viewer."""
        self._stream.send_blueprint(blueprint)

    def columns(self, path: str, time_s: Array, columns: Any) -> None:
        """Write a value for each time, shape (T,) [s]; times may repeat."""
        self._stream.send_columns(path, [self.rr.TimeColumn(TIMELINE, duration=time_s)], columns)

    def varying(
        self,
        path: str,
        time_s: Array,
        columns: Any,
        counts: np.ndarray,
        style: Callable[[], Any] | None = None,
    ) -> None:
        """Write another number of elements in each frame; nothing before there was one.

        Args:
            path: The entity.
            time_s: Times of the frames, shape (T,) [s].
            columns: The elements of all frames, one after the other.
            counts: How many of them each frame has, shape (T,).
            style: Makes what holds for all elements at all times; asked once.
        """
        if path not in self._seen:
            if not counts.any():
                return
            self._seen.add(path)
            if style is not None:
                self.fixed(path, style())
        self.columns(path, time_s, columns.partition(counts))

    def series(self, path: str, time_s: Array, values: Array, names: Sequence[str]) -> None:
        """Write curves.

        Args:
            path: The entity.
            time_s: shape (T,) [s].
            values: shape (T, N).
            names: Of the N curves.
        """
        columns = self.rr.Scalars.columns(scalars=np.ascontiguousarray(values).ravel())
        counts = np.full(len(values), len(names))
        self.varying(path, time_s, columns, counts, lambda: self.rr.SeriesLines(names=list(names)))


def rgb(colour: Sequence[float] | Array) -> tuple[int, int, int]:
    """Return a colour of 0 to 1 in 0 to 255."""
    r, g, b = (round(255 * float(c)) for c in colour)
    return (r, g, b)


__all__ = ["TIMELINE", "RerunLog", "rgb"]
