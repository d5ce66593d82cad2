"""Frames of a recording in time: uneven time stamps to an even rate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.kinect_file import NOMINAL_HZ
from imitor.motion.normalise import RATES_HZ
from imitor.types import Array

STAMP_TOLERANCE: Final = 0.05
"""Written time stamps are rounded: a usual rate this near to theirs is taken [-]."""
MOST_FILLED: Final = 100
"""Frames that may be made of one; more and the stamps are wrong."""


@dataclass(frozen=True)
class Timing:
    """What the user may say about time; see the options of the source."""

    rate_hz: float | None = None
    resample: bool = True
    longest_gap_s: float = 0.2


def evenly(
    path: str | Path, time: Array | None, point: Array, trust: Array, options: Timing, notes: list[str]
) -> tuple[Array, Array, float]:
    """Return points at an even rate: those between two frames interpolated, and lost in a long gap.

    Args:
        path: The file, for messages.
        time: Time stamps, shape (T,) [s], or None.
        point: Points, shape (T, P, 3); NaN where lost.
        trust: Confidences, shape (T, P) [-].
        options: What the user says.
        notes: Told here what was done.

    Returns:
        Points, confidences and the rate [Hz].

    Raises:
        SourceError: The stamps lie so far apart that the frames between would be made up.
    """
    if time is None or len(time) < 2:
        rate = options.rate_hz or NOMINAL_HZ
        why = "as given" if options.rate_hz else "nominal, the file has no time stamps"
        notes.append(f"rate: {rate:g} Hz ({why})")
        return point, trust, rate
    steps = np.diff(time)
    spread = f"time stamps {1e3 * steps.min():.0f} to {1e3 * steps.max():.0f} ms apart"
    if not options.resample:
        rate = options.rate_hz or (len(time) - 1) / float(time[-1])
        notes.append(f"rate: {rate:.4g} Hz; {spread} are taken as even")
        return point, trust, rate
    median_hz = 1.0 / float(np.median(steps))
    usual = min(RATES_HZ, key=lambda r: abs(r - median_hz))
    rate = options.rate_hz or (float(usual) if abs(usual / median_hz - 1.0) < STAMP_TOLERANCE else median_hz)
    count = int(np.floor(time[-1] * rate + 1e-6)) + 1
    if count > MOST_FILLED * len(time):
        raise SourceError(
            path,
            f"{spread}: {len(time)} frames would become {count} at {rate:g} Hz; set rate_hz or resample: false",
        )
    at = np.arange(count) / rate
    before = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    step = steps[before]
    share = np.clip((at - time[before]) / step, 0.0, 1.0)
    share[share < 1e-6], share[share > 1.0 - 1e-6] = 0.0, 1.0
    w = share[:, None, None]
    a, b = point[before], point[before + 1]
    out = np.where(w == 0.0, a, np.where(w == 1.0, b, (1.0 - w) * a + w * b))
    inside = (share > 0.0) & (share < 1.0)
    gap = inside & (step > options.longest_gap_s)
    out[gap] = np.nan
    s = share[:, None]
    both = np.minimum(trust[before], trust[before + 1])
    kept = np.where(s == 0.0, trust[before], np.where(s == 1.0, trust[before + 1], both))
    kept[gap] = 0.0
    notes.append(
        f"rate: {rate:g} Hz, resampled from {spread}"
        + (f"; {gap.sum()} frames fill gaps" if gap.any() else "")
    )
    return out, kept, rate
