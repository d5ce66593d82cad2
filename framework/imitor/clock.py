"""Time in a run: frames at the pipeline's rate, and the clock of the compute time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from imitor.types import HumanFrame


def played(frames: Iterator[HumanFrame], speed: float) -> Iterator[HumanFrame]:
    """Yield frames with their times stretched from the first one on: half the speed takes twice the time."""
    start: float | None = None
    for frame in frames:
        if speed != 1.0:
            start = frame.time_s if start is None else start
            frame = copied(frame, start + (frame.time_s - start) / speed)  # noqa: PLW2901
        yield frame


def at_rate(frames: Iterator[HumanFrame], source_hz: float, rate_hz: float) -> Iterator[HumanFrame]:
    """Yield frames at another rate, from the first frame's time on.

    Points are interpolated linearly between the two frames around each instant; what is not a point (orientation,
    targets, support) is taken from the nearer one. A point is valid when it is valid in both.
    """
    if abs(source_hz - rate_hz) < 1e-9:
        yield from frames
        return
    before = next(frames, None)
    if before is None:
        return
    start = before.time_s
    after = next(frames, None)
    k = 0
    while True:
        t = start + k / rate_hz
        while after is not None and after.time_s < t:
            before, after = after, next(frames, None)
        if after is None:
            if t <= before.time_s + 1e-6 / rate_hz:
                yield copied(before, t)
            return
        yield _between(before, after, t)
        k += 1


def copied(frame: HumanFrame, time_s: float) -> HumanFrame:
    """Return a frame with the same arrays at another time."""
    return HumanFrame(
        time_s, frame.position, frame.valid, frame.orientation, frame.marker, frame.marker_valid,
        frame.target, frame.target_valid, frame.com, frame.support,
    )  # fmt: skip


def _between(a: HumanFrame, b: HumanFrame, t: float) -> HumanFrame:
    share = (t - a.time_s) / (b.time_s - a.time_s) if b.time_s > a.time_s else 1.0
    if share <= 1e-9:
        return copied(a, t)
    if share >= 1 - 1e-9:
        return copied(b, t)
    out = copied(a if share < 0.5 else b, t)
    out.position = a.position + share * (b.position - a.position)
    out.valid = a.valid & b.valid
    out.position = np.where(out.valid[:, None], out.position, np.nan)
    if (
        a.marker is not None
        and b.marker is not None
        and a.marker_valid is not None
        and b.marker_valid is not None
    ):
        out.marker_valid = a.marker_valid & b.marker_valid
        out.marker = np.where(out.marker_valid[:, None], a.marker + share * (b.marker - a.marker), np.nan)
    if a.com is not None and b.com is not None:
        out.com = a.com + share * (b.com - a.com)
    return out
