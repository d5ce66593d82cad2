"""Whether the person of a recording sits when it begins."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.types import ROLE_INDEX, SIDES, Array

BEGINNING_S: Final = 1.0
"""How much of the recording is looked at [s]."""
_SITS_DEG: Final = 60.0
"""Both thighs this far from the vertical, and shanks that are not, are those of someone who sits [deg]."""
_SHANK_DEG: Final = 45.0


def sitting(position: Array, rate_hz: float) -> float | None:
    """Return how far the thighs are from the vertical when the person sits at the start [deg], else ``None``.

    Someone who squats has the shanks inclined, too; a kneeling or lying person has them level.

    Args:
        position: Role positions, z up, shape (T, R, 3) [m]; NaN where not known.
        rate_hz: Frame rate [Hz].
    """
    first = position[: max(1, round(BEGINNING_S * rate_hz))]
    thigh = [_inclination(first, f"{side}_knee", f"{side}_hip") for side in SIDES]
    shank = [_inclination(first, f"{side}_ankle", f"{side}_knee") for side in SIDES]
    sits = min(thigh) > _SITS_DEG and max(shank) < _SHANK_DEG  # no with NaN
    return float(np.mean(thigh)) if sits else None


def sitting_note(position: Array, rate_hz: float) -> list[str]:
    """Return what to tell about someone who sits at the start: nothing, or one line."""
    thighs = sitting(position, rate_hz)
    if thighs is None:
        return []
    return [
        f"the person sits at the start (thighs {thighs:.0f} degrees from the vertical): a robot without a seat stands "
        "or crouches, and a calibration pose held standing is not there"
    ]


def _inclination(position: Array, low: str, high: str) -> float:
    """Return the angle of a segment with the vertical, median over the frames that show it [deg]; NaN without any."""
    d = position[:, ROLE_INDEX[high]] - position[:, ROLE_INDEX[low]]
    d = d[np.isfinite(d).all(axis=1)]
    if not len(d):
        return float("nan")
    return float(np.median(np.degrees(np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2]))))
