"""Checks of a source: frames in order of time, honest flags, the same again after a reset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from imitor.kinds import Source
from imitor.live.source import LiveSource
from imitor.testing.expect import AnyComponent, Snapshot, attempt, build, check_same, expect
from imitor.testing.frames import ARRAYS, check_frame, check_skeleton, given_words, snapshot
from imitor.testing.lifecycle import begin, end, restart
from imitor.testing.live import check_live_source
from imitor.types import HumanFrame, Skeleton

MOST_FRAMES: Final = 1000
"""How much of a long recording is looked at [frames]."""


def check_source(cls: type[Source[Any]], config: Mapping[str, Any] | None = None) -> None:
    """Check a source by reading it twice, a live one by what its encoder sends (`check_live_source`)."""
    extensions = cls.extensions
    expect(
        all(e.startswith(".") and e == e.lower() for e in extensions),
        cls,
        f"extensions {extensions}: write '.bvh'",
    )
    has_path = "path" in cls.config_type.model_fields
    expect(not extensions or has_path, cls, "it recognises files, so its options need a field `path`")
    if cls.live:
        if issubclass(cls, LiveSource):
            check_live_source(cls, config)
        return
    source = build(cls, config)
    begin(source)
    check_skeleton(cls, source.skeleton)
    expect(np.isfinite(source.rate_hz) and source.rate_hz > 0, cls, f"rate_hz is {source.rate_hz}")
    first = check_frames(cls, source.frames(), source.skeleton, source.rate_hz)
    n = source.n_frames
    if len(first) < MOST_FRAMES:
        expect(n is None or n == len(first), cls, f"n_frames is {n}, but frames() yields {len(first)}")
    restart(source)
    again = check_frames(cls, source.frames(), source.skeleton, source.rate_hz)
    check_same(cls, first, again, "frames() again after reset()")
    end(source)
    other = build(cls, config)
    begin(other)
    check_same(
        cls, first, check_frames(cls, other.frames(), other.skeleton, other.rate_hz), "another instance"
    )
    end(other)


def check_frames(
    cls: AnyComponent, frames: Iterable[HumanFrame], skeleton: Skeleton, rate_hz: float
) -> list[Snapshot]:
    """Check the frames of a source, at most `MOST_FRAMES`; return copies of them.

    Args:
        cls: The source, for messages and for what it promises to give.
        frames: Its frames.
        skeleton: Its skeleton.
        rate_hz: Its rate [Hz].
    """
    out: list[Snapshot] = []
    iterator = iter(frames)
    while len(out) < MOST_FRAMES:
        which = f"frame {len(out)}"
        frame = attempt(cls, which, lambda: next(iterator, None))
        if frame is None:
            break
        check_frame(cls, frame, skeleton, which)
        for name in ARRAYS:
            array = getattr(frame, name)
            expect(
                array is None or not array.flags.writeable,
                cls,
                f"{which}: {name} can be written; pass it through imitor.types.read_only",
            )
        extra = given_words(frame) - cls.gives
        expect(not extra, cls, f"{which} holds {', '.join(sorted(extra))}, which `gives` does not name")
        out.append(snapshot(frame))
    expect(out, cls, "it yields no frame")
    steps = np.diff([float(s["time_s"]) for s in out])
    expect((steps > 0).all(), cls, f"time does not increase at frame {int(np.argmin(steps)) + 1}")
    if len(steps):
        rate = 1.0 / float(steps.mean())
        expect(abs(rate / rate_hz - 1) < 0.01, cls, f"rate_hz is {rate_hz}, but frames come at {rate:.3f} Hz")
    return out
