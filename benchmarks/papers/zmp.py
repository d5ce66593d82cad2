"""The ZMP of a run by four ways: cart-table and whole body as commanded, whole body and floor as executed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from experiment import Played

from imitor.metrics.balance import GRAVITY, cart_table_zmp
from imitor.metrics.polygon import convex_hull, margins
from imitor.metrics.zmp import Momentum, velocities
from imitor.simulation.verdict import polygons, standing_feet
from imitor.types import Array, BoolArray

WAYS: Final = ("cart-table", "whole body", "executed", "physics")
"""Of the command: a point mass at the CoM; the whole body's momentum. Of what the simulated robot did: the whole body's
momentum again; the centre of pressure of the floor's forces. The last two are to be the same."""
SPAN_S: Final = 0.04
"""Time over which the momenta of a command are compared [s]: over one frame, a command's small steps would swamp it."""

LOADED: Final = 0.5
"""Share of the weight [-]."""


@dataclass(frozen=True)
class Zmp:
    """The ZMP of a run.

    Attributes:
        point: By each of `WAYS`, shape (T, 2) [m]; NaN where not known. What was executed is given where the soles
            would be if the robot had not shifted on the floor.
        margin: Distance to the edge of the support polygon, negative outside, shape (T,) [m].
        loaded: Frames in which both feet carry and the floor bears at least `LOADED` of the weight, shape (T,): with
            next to no force the point where it acts has no meaning.
    """

    point: dict[str, Array]
    margin: dict[str, Array]
    loaded: BoolArray

    def difference(self, rows: BoolArray) -> Array:
        """Return the executed ZMP by momentum less the centre of pressure, shape (K, 2) [m]."""
        off = (self.point["executed"] - self.point["physics"])[rows]
        return off[np.isfinite(off).all(axis=1)]


def zmp(p: Played) -> Zmp:
    """Return the ZMP of a run; what was executed until a fall."""
    point = {
        "cart-table": cart_table_zmp(p.run.path.com, p.run.period_s)[0],
        "whole body": commanded_zmp(p),
    }
    hull = [
        convex_hull([(float(x), float(y)) for x, y in sole.reshape(-1, 3)[:, :2]]) for sole in p.run.path.sole
    ]
    margin = {way: _margin(value, hull) for way, value in point.items()}
    loaded = np.zeros(len(p.run), dtype=bool)
    for way in WAYS[2:]:
        point[way], margin[way] = np.full((len(p.run), 2), np.nan), np.full(len(p.run), np.nan)
    if p.trace is not None:
        trace: Any = p.trace
        end = len(trace.time_s) if trace.fall is None else max(trace.fall.frame, 1)
        drift = (trace.sole - p.run.path.sole)[..., :2].mean(axis=(1, 2))
        weight = p.robot.mass_kg * GRAVITY
        feet = standing_feet(trace, weight)
        hull = polygons(trace, feet)
        loaded[:end] = (feet.all(axis=1) & (trace.force[:, :2].sum(axis=1) >= LOADED * weight))[:end]
        measured = {"executed": executed_zmp(p), "physics": trace.zmp}
        for way, value in measured.items():
            point[way][:end] = (value - drift)[:end]
            margin[way][:end] = _margin(value, hull)[:end]
    return Zmp(point, margin, loaded)


def commanded_zmp(p: Played) -> Array:
    """Return the ZMP of the momentum of the commanded motion, shape (T, 2) [m], NaN at both ends."""
    q, dt = p.motion.configurations(), p.run.period_s
    half = max(1, round(0.5 * SPAN_S / dt))
    out = np.full((len(q), 2), np.nan)
    momentum = Momentum.of(p.robot, q, velocities(p.robot, q, dt))
    out[half:-half] = momentum.zmp(dt, 2 * half)
    return out


def executed_zmp(p: Played) -> Array:
    """Return the ZMP of the momentum of the simulated motion, mean since the frame before, shape (T, 2) [m]."""
    trace: Any = p.trace
    first = np.full((1, 2), np.nan)
    return np.vstack([first, Momentum.of(p.robot, trace.q, trace.v).zmp(p.run.period_s)])


def _margin(point: Array, hull: Any) -> Array:
    out = np.array(margins(np.nan_to_num(point), hull))
    out[~np.isfinite(point).all(axis=1)] = np.nan
    return out
