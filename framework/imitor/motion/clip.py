"""A recording in our world, whatever file it came from; and the part of it to read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from imitor.errors import SourceError
from imitor.types import Array, BoolArray, HumanFrame, Skeleton, Support, read_only


@dataclass(frozen=True)
class Clip:
    """A clip in our world: z up, metres. Horizontally it stays where it was recorded.

    Attributes:
        skeleton: Constant facts.
        rate_hz: Frames per second [Hz].
        position: Role positions, shape (T, R, 3) [m]; NaN where not valid.
        valid: Which roles are known, shape (T, R).
        facts: What was found: unit, up axis, floor, rate; for reports.
        orientation: World from segment, the identity in the rest pose, shape (T, R, 3, 3).
        confidence: Tracking state of each role: 0 not tracked, 0.5 inferred, 1 tracked, shape (T, R) [-].
        com: Centre of mass, shape (T, 3) [m]; NaN where not known.
        support: Feet in contact, left and right, shape (T, 2).
        marker, marker_valid: Marker positions, shape (T, M, 3) [m], and which are seen, shape (T, M).
        target, target_valid: World from target, shape (T, K, 4, 4), and which are seen, shape (T, K).
    """

    skeleton: Skeleton
    rate_hz: float
    position: Array
    valid: BoolArray
    facts: Mapping[str, str | float | bool]
    orientation: Array | None = None
    confidence: Array | None = None
    com: Array | None = None
    support: BoolArray | None = None
    marker: Array | None = None
    marker_valid: BoolArray | None = None
    target: Array | None = None
    target_valid: BoolArray | None = None

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.position)

    def part(self, first: int, last: int) -> Clip:
        """Return the frames from ``first`` to before ``last``; their arrays cannot be written."""
        arrays: dict[str, Any] = {
            f.name: read_only(np.ascontiguousarray(value[first:last]))
            for f in fields(self)
            if isinstance(value := getattr(self, f.name), np.ndarray)
        }
        return replace(self, **arrays)

    def frames(self) -> Iterator[HumanFrame]:
        """Yield the frames; their arrays are views of the clip."""
        has_com: list[bool] = [] if self.com is None else [bool(np.isfinite(c).all()) for c in self.com]
        feet: list[list[bool]] = [] if self.support is None else self.support.tolist()
        for i in range(len(self)):
            frame = HumanFrame(i / self.rate_hz, self.position[i], self.valid[i])
            if self.orientation is not None:
                frame.orientation = self.orientation[i]
            if self.com is not None and has_com[i]:
                frame.com = self.com[i]
            if feet:
                frame.support = Support(*feet[i])
            if self.marker is not None and self.marker_valid is not None:
                frame.marker, frame.marker_valid = self.marker[i], self.marker_valid[i]
            if self.target is not None and self.target_valid is not None:
                frame.target, frame.target_valid = self.target[i], self.target_valid[i]
            yield frame


def window(
    path: str | Path, frames: int, rate_hz: float, start_s: float, stop_s: float | None
) -> tuple[int, int]:
    """Return the first frame of the part to read and the one after its last.

    Args:
        path: The file, for messages.
        frames: How many there are.
        rate_hz: Frames per second [Hz].
        start_s: Where to begin, from the first frame of the motion [s].
        stop_s: Where to end [s]; None: at the end.

    Raises:
        SourceError: No frame lies there.
    """
    first = round(start_s * rate_hz)
    last = frames if stop_s is None else min(frames, round(stop_s * rate_hz) + 1)
    if first >= last:
        stop = "its end" if stop_s is None else f"{stop_s:g} s"
        raise SourceError(
            path,
            f"no frame lies between {start_s:g} s and {stop}; "
            f"the motion lasts {(frames - 1) / rate_hz:.3f} s",
        )
    return first, last
