"""The ZMP of a motion three ways: cart-table, whole body, and as measured in physics."""

from __future__ import annotations

from typing import Any

import numpy as np
from experiment import Played

from imitor.metrics.balance import GRAVITY
from imitor.metrics.polygon import margins
from imitor.simulation.verdict import polygons, standing_feet
from imitor.types import Array

SPAN_S = 0.02
"""Half of the time over which momenta are differentiated [s]."""


def whole_body_zmp(p: Played) -> Array:
    r"""Return the ZMP of the whole body's momentum, shape (T, 2) [m], NaN at both ends.

    With the CoM :math:`c` and the angular momentum :math:`L` about it,
    :math:`p_x = c_x - (c_z \ddot c_x + \dot L_y / m) / (\ddot c_z + g)`, and
    :math:`p_y = c_y - (c_z \ddot c_y - \dot L_x / m) / (\ddot c_z + g)`.
    """
    import pinocchio as pin

    robot, dt = p.robot, p.run.period_s
    q, model = p.motion.configurations(), robot.model
    data = model.createData()
    h = np.full((len(q), 6), np.nan)
    for k in range(1, len(q) - 1):
        v = pin.difference(model, q[k - 1], q[k + 1]) / (2.0 * dt)
        h[k] = pin.computeCentroidalMomentum(model, data, q[k], v).vector
    span = max(1, round(SPAN_S / dt))
    rate = np.full_like(h, np.nan)
    rate[span:-span] = (h[2 * span :] - h[: -2 * span]) / (2 * span * dt)
    force, turn = rate[:, :3] / robot.mass_kg, rate[:, 3:] / robot.mass_kg
    com = p.run.path.com
    lift = force[:, 2] + GRAVITY
    return np.column_stack(
        [
            com[:, 0] - (com[:, 2] * force[:, 0] + turn[:, 1]) / lift,
            com[:, 1] - (com[:, 2] * force[:, 1] - turn[:, 0]) / lift,
        ]
    )


def physics_zmp(p: Played) -> tuple[Array, Array]:
    """Return the ZMP in physics until a fall, and its margin in the polygon of the soles that carry weight.

    The ZMP is given where the soles would be if the robot had not shifted on the floor, shapes (T, 2) and (T,) [m].
    """
    trace: Any = p.trace
    out, margin = np.full((len(p.run), 2), np.nan), np.full(len(p.run), np.nan)
    if trace is None:
        return out, margin
    end = len(trace.time_s) if trace.fall is None else max(trace.fall.frame, 1)
    drift = (trace.sole - p.run.path.sole[: len(trace.sole)])[..., :2].mean(axis=(1, 2))
    feet = standing_feet(trace, p.robot.mass_kg * GRAVITY)
    out[:end] = (trace.zmp - drift)[:end]
    margin[:end] = np.array(margins(np.nan_to_num(trace.zmp), polygons(trace, feet)))[:end]
    margin[~np.isfinite(out).all(axis=1)] = np.nan
    return out, margin
