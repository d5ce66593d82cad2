"""What the body of a depth-camera recording tells: how the sensor was tilted, the sides, the floor.

Positions are role positions in a world with z up, shape (T, R, 3), NaN where a role is not known in a frame.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.human import masses
from imitor.motion.body_lengths import median
from imitor.motion.normalise import (
    ANKLE_FRACTION,
    FLAT_M,
    TOE_FRACTION,
    handedness,
    middle,
    role,
    unit_vector,
)
from imitor.types import SIDES, Array, BoolArray

MOST_TILT_RAD: Final = 0.5
LEAST_TILT_RAD: Final = 0.035
"""A tilt beyond the first is no sensor's, one below the second drowns in the posture [rad]."""
_STRAIGHT: Final = 0.9
_UPRIGHT: Final = 0.75
_MIN_FRAMES: Final = 10
_BENT_M: Final = 0.05
_HALF_FOOT: Final = 0.03
"""Middle of the base of support ahead of the ankles, for sets without toes, as a fraction of stature."""


def find_tilt(position: Array, height_m: float) -> float | None:
    """Find how far the sensor looks down, from balance: who stands has the CoM over the middle of the feet.

    Only frames count in which both legs are straight and the body is about upright.

    Args:
        position: Positions in the sensor's world, x towards the sensor.
        height_m: Stature [m].

    Returns:
        The tilt [rad], positive when it looks down; None when nobody stands.
    """
    legs = [
        (
            unit_vector(role(position, f"{s}_hip") - role(position, f"{s}_knee")),
            unit_vector(role(position, f"{s}_knee") - role(position, f"{s}_ankle")),
        )
        for s in SIDES
    ]
    with np.errstate(invalid="ignore"):
        stands = np.all(
            [
                ((thigh * shank).sum(-1) > _STRAIGHT) & (thigh[:, 2] > _UPRIGHT) & (shank[:, 2] > _UPRIGHT)
                for thigh, shank in legs
            ],
            axis=0,
        )
    if stands.sum() < _MIN_FRAMES:
        return None
    known: BoolArray = np.asarray(np.isfinite(position[stands]).all(axis=-1))
    weights = masses.weights(masses.winter(), np.asarray(known.any(axis=0)))
    if weights is None:
        return None
    used = weights != 0.0
    com = np.einsum("r,tri->ti", weights[used], position[stands][:, used])
    base = middle(position[stands], "ankle")
    toes = middle(position[stands], "toe")
    base = np.where(np.isnan(toes), base + np.array([_HALF_FOOT * height_m, 0.0, 0.0]), 0.5 * (base + toes))
    up = com - base
    up = up[np.isfinite(up).all(axis=1)]
    if len(up) < _MIN_FRAMES:
        return None
    return float(np.median(np.arctan2(up[:, 0], up[:, 2])))


def side_evidence(position: Array) -> tuple[float, float]:
    """Tell whether left is left, from the feet (bent knees without them), and whether the body faces +x.

    Returns:
        Mean cosines, +1 for a body as it should be; 0 where nothing can be told.
    """
    points = [f"{s}_{j}" for s in SIDES for j in ("hip", "shoulder", "knee", "ankle")]
    known = np.all([np.isfinite(role(position, p)).all(axis=-1) for p in points], axis=0)
    body = position[known]
    if not len(body):
        return 0.0, 0.0
    toes = np.all([np.isfinite(role(body, f"{s}_toe")).all(axis=-1) for s in SIDES], axis=0)
    bend = middle(body, "knee") - 0.5 * (middle(body, "hip") + middle(body, "ankle"))
    bent = np.linalg.norm(bend[:, :2], axis=-1) > _BENT_M
    tells = toes if toes.any() else bent
    anatomy = handedness(body[tells]) if tells.any() else 0.0
    lateral = unit_vector((role(body, "left_hip") - role(body, "right_hip")) * (1.0, 1.0, 0.0))
    return anatomy, float(lateral[:, 1].mean())


def find_floor(position: Array, height_m: float) -> tuple[float, float, float]:
    """Find the floor under the lower foot: in most frames it stands.

    A sole is where the lowest of ankle and toe puts it, each lowered by its usual height. The median of all frames is
    taken, since the sensor sees a planted foot rise and sink by several centimetres.

    Args:
        position: The motion, without gaps.
        height_m: Stature [m].

    Returns:
        Heights of the floor in the recording and of ankle and toe over it when a foot stands flat [m]; NaN if unknown.
    """
    usual = height_m * np.array([ANKLE_FRACTION, TOE_FRACTION])
    z = np.stack(
        [[role(position, f"{s}_{p}")[:, 2] for p in ("ankle", "toe")] for s in SIDES]
    )  # (side, point, T)
    sole = np.fmin.reduce(z - usual[:, None], axis=1)
    floor = median(sole.min(axis=0))
    flat = np.abs(sole - floor) < FLAT_M
    ankle, toe = (median(z[:, i][flat]) - floor for i in range(2))
    return floor, ankle, toe
