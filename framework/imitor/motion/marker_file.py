"""What a file of optical markers says, before anybody knows which marker sits where; and its gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.types import Array, BoolArray

MAX_VALUES: Final = 100_000_000
"""Bound on the numbers of a file, so that a broken or hostile one cannot take all memory."""

UNIT_NAMES: Final = {
    "m": "m", "mete": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "dm": "dm", "cm": "cm", "centimeters": "cm", "mm": "mm", "millimeters": "mm", "millimetres": "mm",
    "in": "inch", "inch": "inch", "inches": "inch",
}  # fmt: skip
"""How files write units (C3D cuts words to four letters), and our names."""


@dataclass(frozen=True)
class MarkerFile:
    """Labelled points over time.

    Attributes:
        labels: Names as written, without blanks around them.
        position: Shape (T, M, 3) [file units]; NaN where a point is lost.
        rate_hz: Frames per second [Hz].
        unit: Our name of the length unit, or empty when the file does not say.
        up: Axis that points up, such as ``z`` or ``-y``, or empty when the file does not say.
        first_frame: Number of the first frame in the trial that the file was cut from.
        notes: What was odd, for the report.
    """

    labels: tuple[str, ...]
    position: Array
    rate_hz: float
    unit: str = ""
    up: str = ""
    first_frame: int = 1
    notes: tuple[str, ...] = ()

    @property
    def seen(self) -> BoolArray:
        """Which points are seen, shape (T, M)."""
        return np.asarray(np.isfinite(self.position).all(axis=-1))


@dataclass(frozen=True)
class Gaps:
    """What is lost of some markers.

    Attributes:
        markers: How many markers have gaps; those never seen do not count.
        count: Number of gaps: runs of frames in which one marker is lost.
        frames: Marker-frames lost.
        longest: The longest gap [frames].
        never: How many markers are never seen.
    """

    markers: int
    count: int
    frames: int
    longest: int
    never: int

    def told(self, names: int) -> str:
        """Return a sentence about ``names`` markers."""
        text = f"{names} markers"
        if self.count:
            text += (
                f", {self.count} gaps in {self.markers} of them, {self.frames} marker-frames lost, "
                f"the longest gap {self.longest} frames"
            )
        else:
            text += ", no gaps"
        return text + (f"; {self.never} never seen" if self.never else "")


def find_gaps(seen: BoolArray, columns: Sequence[int] | None = None) -> Gaps:
    """Count the gaps of markers.

    Args:
        seen: Which markers are seen, shape (T, M).
        columns: The markers to look at; all by default.
    """
    part = seen if columns is None else seen[:, list(columns)]
    ever = part.any(axis=0)
    lost = ~part[:, ever]
    edges = np.diff(np.pad(lost.astype(np.int8), ((1, 1), (0, 0))), axis=0)
    lengths = []
    for column in edges.T:
        lengths.append(np.flatnonzero(column == -1) - np.flatnonzero(column == 1))
    every = np.concatenate(lengths) if lengths else np.zeros(0, dtype=int)
    return Gaps(
        markers=int(lost.any(axis=0).sum()),
        count=len(every),
        frames=int(lost.sum()),
        longest=int(every.max(initial=0)),
        never=int((~ever).sum()),
    )
