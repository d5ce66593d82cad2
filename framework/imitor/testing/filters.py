"""Checks of a filter: it changes the frame, never its input, and gives what it promises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from imitor.kinds import Filter
from imitor.testing.expect import Snapshot, attempt, build, check_same, expect
from imitor.testing.fixtures import copies, make_context, make_frames, make_skeleton
from imitor.testing.frames import check_frame, check_untouched, given_words, lost_points, snapshot
from imitor.testing.lifecycle import begin, end, restart
from imitor.types import HumanFrame

SCENARIOS: Final = ("step_forward", "wave")


def check_filter(cls: type[Filter[Any]], config: Mapping[str, Any] | None = None) -> None:
    """Check a filter on complete frames and on frames with lost points."""
    context = make_context()
    recordings = [(name, make_frames(name)) for name in SCENARIOS]
    recordings.append(("walk with losses", make_frames("walk", 90, loss=0.1, seed=3)))
    recordings.append(("step_forward with lost limbs", lost_points(make_frames())))
    for name, frames in recordings:
        bare = copies(frames, without=cls.gives)
        component = build(cls, config, context)
        begin(component, copies(bare))
        first = _run(component, bare, name)
        restart(component)
        check_same(cls, first, _run(component, bare, name), f"{name}: run again after reset()")
        end(component)
        other = build(cls, config, context)
        begin(other, copies(bare))
        check_same(cls, first, _run(other, bare, name), f"{name}: run by another instance")
        end(other)
    complete = build(cls, config, context)
    begin(complete, copies(recordings[0][1]))
    _run(complete, recordings[0][1], "frames that hold everything already")
    end(complete)


def _run(component: Filter[Any], frames: Sequence[HumanFrame], name: str) -> list[Snapshot]:
    cls, skeleton, delay = type(component), make_skeleton(), component.delay_frames
    out = []
    for i, frame in enumerate(copies(frames)):
        which = f"{name}, frame {i}"
        held, before, given = given_words(frame), snapshot(frame), frames[i]
        result = attempt(cls, f"step() on {which}", lambda f=frame: component.step(f))  # type: ignore[misc]
        check_frame(cls, result, skeleton, which)
        check_untouched(cls, given, before, which)
        time_s = frames[max(i - delay, 0)].time_s
        expect(
            result.time_s == time_s,
            cls,
            f"{which}: it gives back the time {result.time_s} s instead of {time_s} s (delay_frames is {delay})",
        )
        lost = (held | cls.gives) - given_words(result)
        expect(not lost, cls, f"{which}: {', '.join(sorted(lost))} is missing from what it gives back")
        out.append(snapshot(result))
    return out
