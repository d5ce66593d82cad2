"""Start, calibrate, reset, close: what every component goes through."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from imitor.kinds import Component
from imitor.testing.expect import attempt, expect
from imitor.types import HumanFrame


def begin(component: Component[Any], frames: Sequence[HumanFrame] = ()) -> None:
    """Start a component and give it the frames it asks for, as the builder does."""
    cls = type(component)
    attempt(cls, "start()", component.start)
    wanted = component.calibration_s
    expect(wanted >= 0, cls, f"calibration_s is {wanted}; it is 0 or more seconds, or WHOLE_RECORDING")
    delay = component.delay_frames
    expect(isinstance(delay, int) and delay >= 0, cls, f"delay_frames is {delay}, not a whole number from 0")
    if wanted > 0 and frames:
        seen = [f for f in frames if f.time_s - frames[0].time_s <= wanted]
        attempt(cls, "calibrate()", lambda: component.calibrate(seen))
    restart(component)


def restart(component: Component[Any]) -> None:
    """Reset a component."""
    attempt(type(component), "reset()", component.reset)


def end(component: Component[Any]) -> None:
    """Close a component, twice: a run that fails may close it again."""
    attempt(type(component), "close()", component.close)
    attempt(type(component), "close() after close()", component.close)
