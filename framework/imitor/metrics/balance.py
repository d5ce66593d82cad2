"""Whether the robot would stand: CoM and ZMP in the polygon of the feet that touch the floor."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.metrics.figure import Outcome, Sample, Unmeasured, figure
from imitor.metrics.polygon import margins
from imitor.metrics.run import TOUCH_M, Run
from imitor.types import Array, BoolArray

GRAVITY: Final = 9.81  # [m/s^2]
SMOOTHING_S: Final = 0.05
"""Span of the central difference on each side of a frame [s]; over one frame, noise would swamp it."""

_SUPPORTS: Final = ("single", "double")
_POLYGON: Final = f"convex hull of the sole corners at or under z = {1000 * TOUCH_M:.0f} mm"


def _in_support(run: Run, point: Array, known: BoolArray, what: str) -> dict[str, Outcome]:
    """Return the margin of a point (T, 2) in single and in double support."""
    feet = run.foot_touching.sum(axis=1)
    margin = np.array(margins(np.where(known[:, None], point, 0.0), run.support_polygon))
    out: dict[str, Outcome] = {}
    for support, number in zip(_SUPPORTS, (1, 2), strict=True):
        taken = margin[(feet == number) & known]
        if not taken.size:
            out[support] = Unmeasured(f"no frame in {support} support{what}")
            continue
        inside = int((taken >= 0.0).sum())
        out[support] = Sample(
            {"mean": taken.mean(), "min": taken.min(), "inside": inside, "inside_share": inside / taken.size},
            taken.size,
        )
    return out


@figure(
    "com_margin_{support}_support_m",
    unit="m",
    formula="signed distance of the CoM's floor point to the boundary of the support polygon "
    f"({_POLYGON}), positive inside; frames by the number of feet that touch",
    better="higher",
    about="Static balance; inside_share is the share of those frames with the CoM inside.",
    members=_SUPPORTS,
)
def com_margin(run: Run) -> dict[str, Outcome]:
    """Take the margin of the CoM in the support polygon."""
    return _in_support(run, run.path.com[:, :2], np.ones(len(run), dtype=bool), "")


@figure(
    "zmp_margin_{support}_support_m",
    unit="m",
    formula="the same for the ZMP of the cart-table model [kajita2003] p = c − (c_z / g) c̈, with the central "
    "difference c̈ = (c(t+h) − 2 c(t) + c(t−h)) / h², which smooths too; h is the number of frames nearest to "
    f"{SMOOTHING_S} s, at least one",
    better="higher",
    about="Dynamic balance of a point mass at the CoM, without angular momentum and vertical acceleration.",
    members=_SUPPORTS,
)
def zmp_margin(run: Run) -> dict[str, Outcome]:
    """Take the margin of the cart-table ZMP in the support polygon."""
    point, known = cart_table_zmp(run.path.com, run.period_s)
    return _in_support(run, point, known, " away from both ends of the motion")


def cart_table_zmp(com: Array, period_s: float) -> tuple[Array, BoolArray]:
    """Return the ZMP of the cart-table model [kajita2003] eq. 2 (T, 2) [m], and where it is known (T,).

    Args:
        com: Centre of mass in world, shape (T, 3) [m].
        period_s: Time between frames [s]; NaN for a single frame.
    """
    zmp, known = np.full((len(com), 2), np.nan), np.zeros(len(com), dtype=bool)
    span = max(1, round(SMOOTHING_S / period_s)) if np.isfinite(period_s) else 1
    if len(com) > 2 * span:
        middle = com[span:-span]
        acceleration = (com[2 * span :] - 2.0 * middle + com[: -2 * span]) / (span * period_s) ** 2
        zmp[span:-span] = middle[:, :2] - middle[:, 2:] / GRAVITY * acceleration[:, :2]
        known[span:-span] = True
    return zmp, known
