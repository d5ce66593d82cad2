"""From a file's world to ours: up axis, length unit, frame rate, floor, left and right.

A motion file states none of these; each is found from the size and the motion of the body, or given by the
user. Positions are role positions, shape (T, R, 3), NaN where a role is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, BoolArray

UNITS: Final[Mapping[str, float]] = {
    "m": 1.0,
    "dm": 0.1,
    "cm": 0.01,
    "mm": 0.001,
    "inch": 0.0254,
    "cmu": 0.0254 / 0.45,
}
"""Length units by name [m per unit]; ``cmu`` is the unit of the CMU database, 1/0.45 inch."""

HEIGHT_RANGE_M: Final = (1.4, 2.1)
"""Stature that makes a unit believable [m]; no two units of `UNITS` put one skeleton into it."""
CARD_HEIGHT_RANGE_M: Final = (1.2, 2.3)
"""The same for the unit that the skeleton's card expects."""
DEFAULT_HEIGHT_M: Final = 1.75

RATES_HZ: Final = (24, 25, 30, 50, 60, 72, 90, 100, 120, 144, 200, 240, 250, 300)

ANKLE_FRACTION: Final = 0.045
TOE_FRACTION: Final = 0.012
TIP_FRACTION: Final = 0.006
"""Usual heights of ankle, toe and toe tip over the floor as fractions of stature [-]."""

FLOOR_TOLERANCE_M: Final = 0.03
STILL_M_S: Final = 0.15
FLAT_M: Final = 0.025
LEVEL_M: Final = 0.04
"""When a foot stands flat: slower than this, this low, and so level."""

UP_AXES: Final[Mapping[str, Sequence[Sequence[float]]]] = {
    "x": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    "y": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    "z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-x": ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
    "-y": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),
    "-z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
}
"""Rotation to a world with z up by the file's axis that points up; of y up, z forward, x left: (z, x, y)."""


def role(position: Array, name: str) -> Array:
    """Return one role's positions, shape (..., 3)."""
    return np.asarray(position[..., ROLE_INDEX[name], :])


def middle(position: Array, joint: str) -> Array:
    """Return the middle of a left and a right role, shape (..., 3)."""
    return 0.5 * (role(position, f"left_{joint}") + role(position, f"right_{joint}"))


def unit_vector(vector: Array) -> Array:
    """Return vectors of length 1, shape (..., 3); zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.asarray(np.divide(vector, length, out=np.zeros_like(vector), where=length > 0.0))


def direction(vector: Array) -> Array:
    """Return vectors of length 1, shape (..., 3); of zero and of what is not known NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


def snap_rate(frame_time_s: float) -> float:
    """Return the frame rate [Hz]: a usual one when within 0.1 %, since written times are rounded."""
    raw = 1.0 / frame_time_s
    nearest = min(RATES_HZ, key=lambda r: abs(r - raw))
    return float(nearest) if abs(nearest - raw) <= 1e-3 * nearest else raw


def find_up(position: Array, rest: Array) -> tuple[str, bool]:
    """Find the axis that points up, from the mean direction from the ankles to the neck.

    Args:
        position: Role positions of the motion, shape (T, R, 3).
        rest: Role positions at zero angles, shape (R, 3), for a motion that is never upright.

    Returns:
        The axis, and whether the motion shows it clearly.
    """
    mean = unit_vector(role(position, "neck") - middle(position, "ankle")).mean(axis=0)
    clear = bool(np.abs(mean).max() >= 0.8)
    if not clear:
        zero = unit_vector(role(rest, "neck") - middle(rest, "ankle"))
        if np.abs(zero).max() >= 0.95:
            mean = zero
    axis = int(np.argmax(np.abs(mean)))
    return ("-" if mean[axis] < 0.0 else "") + "xyz"[axis], clear


@dataclass(frozen=True)
class Scale:
    """Metres per file unit and how they were found."""

    factor: float
    name: str
    known: bool = True


def find_scale(height: float, expected: str = "", height_m: float | None = None) -> Scale:
    """Find the length unit from the skeleton's height.

    Args:
        height: Stature in file units.
        expected: The unit that the skeleton's card expects, or empty.
        height_m: The person's stature, when known [m].
    """
    if height_m is not None:
        name, factor = min(UNITS.items(), key=lambda item: abs(np.log(item[1] * height / height_m)))
        if abs(factor * height / height_m - 1.0) <= 0.15:
            return Scale(factor, name)
        return Scale(height_m / height, "scaled", known=False)
    if expected and CARD_HEIGHT_RANGE_M[0] <= UNITS[expected] * height <= CARD_HEIGHT_RANGE_M[1]:
        return Scale(UNITS[expected], expected)
    for name, factor in UNITS.items():
        if HEIGHT_RANGE_M[0] <= factor * height <= HEIGHT_RANGE_M[1]:
            return Scale(factor, name)
    return Scale(DEFAULT_HEIGHT_M / height, "scaled", known=False)


@dataclass(frozen=True)
class Stance:
    """What the feet tell about the floor.

    Attributes:
        floor_m: Height of the floor in the recording's world [m].
        height_m: Heights of ankle, toe and toe tip over that floor in a flat foot [m]; NaN if unknown.
        flat: Frames in which a foot stands flat, shape (T, 2), left and right.
    """

    floor_m: float
    height_m: tuple[float, float, float]
    flat: BoolArray


def find_stance(position: Array, rate_hz: float, height_m: float) -> Stance:
    """Find the floor and the frames in which a foot stands flat on it.

    A foot stands when it is still and low. The floor is then where the lowest of ankle, toe and toe tip puts
    it, each lowered by its usual height over the sole.

    Args:
        position: Role positions, z up, shape (T, R, 3) [m].
        rate_hz: Frames per second [Hz].
        height_m: Stature [m].
    """
    points = ("ankle", "toe", "toe_tip")
    foot = np.stack([[role(position, f"{s}_{p}") for p in points] for s in SIDES])  # (side, point, T, 3)
    known = ~np.isnan(foot[:, :, 0, 0]).any(axis=0)
    foot = foot[:, known]
    usual = height_m * np.array([ANKLE_FRACTION, TOE_FRACTION, TIP_FRACTION])[known]
    if foot.shape[2] > 1:
        speed = np.linalg.norm(np.gradient(foot, axis=2), axis=-1).max(axis=1) * rate_hz
    else:
        speed = np.zeros((2, 1))
    z = np.moveaxis(foot[..., 2], 1, 2)  # (side, T, point)
    sole = (z - usual).min(axis=2)  # whatever part of the foot is lowest stands on the floor, (side, T)
    still = speed < STILL_M_S
    if not still.any():
        still = sole <= np.quantile(sole, 0.1)
    flat = still & (sole < np.quantile(sole[still], 0.1) + FLAT_M)
    floor = float(np.median(sole[flat]))
    level = flat & (np.ptp(z - usual, axis=2) < LEVEL_M)  # neither on the heel nor on the toes
    flat = level if level.any() else flat
    flat &= (np.abs(z - np.median(z[flat], axis=0)) < FLAT_M).all(axis=2)
    heights = np.median(z[flat], axis=0) if flat.any() else floor + usual
    over = np.full(3, np.nan)
    over[known] = heights - floor
    return Stance(floor, (float(over[0]), float(over[1]), float(over[2])), flat.T)


def choose_floor(stance: Stance, wanted: str | float) -> tuple[float, str]:
    """Return the floor's height in the recording [m] and how it was found.

    Args:
        stance: What the feet tell.
        wanted: ``auto``, ``file`` (its zero) or the height [m].
    """
    if isinstance(wanted, int | float):
        return float(wanted), f"floor: at {wanted:g} m of the recording, as given"
    if wanted == "file":
        return 0.0, f"floor: the file's zero (the feet stand {stance.floor_m:+.3f} m from it)"
    if abs(stance.floor_m) <= FLOOR_TOLERANCE_M:
        return 0.0, "floor: the file's zero"
    return stance.floor_m, f"floor: {stance.floor_m:+.3f} m in the recording, from the standing feet"


def foot_heights(stance: Stance, floor: float, height_m: float) -> tuple[float, float]:
    """Return the heights of ankle and toe joints over the floor in use [m]; usual fractions where unknown."""
    ankle, toe, _ = (h + stance.floor_m - floor for h in stance.height_m)
    ankle = ankle if np.isfinite(ankle) and ankle > 0.0 else ANKLE_FRACTION * height_m
    toe = toe if np.isfinite(toe) and toe >= 0.0 else TOE_FRACTION * height_m
    return float(ankle), float(toe)


def lateral_axes(position: Array) -> tuple[Array, Array]:
    """Return the horizontal directions from right to left of hips and of shoulders, shape (..., 3) each."""
    lines = [role(position, f"left_{j}") - role(position, f"right_{j}") for j in ("hip", "shoulder")]
    hips, shoulders = (unit_vector(line * (1.0, 1.0, 0.0)) for line in lines)
    return hips, shoulders


def handedness(position: Array) -> float:
    """Tell whether left is left: mean cosine of the body's lateral axis and the left that the feet define.

    Feet, or without toes the bending of the knees, point forward; up × forward is left.

    Returns:
        +1 for a body as it should be, -1 for a mirrored one, about 0 when nothing can be told.
    """
    forward = np.zeros_like(position[..., 0, :])
    for side in SIDES:
        ahead = toe_direction(position, side)
        if ahead is None:
            hip, knee, ankle = (role(position, f"{side}_{j}") for j in ("hip", "knee", "ankle"))
            ahead = knee - 0.5 * (hip + ankle)
        forward += unit_vector(ahead * (1.0, 1.0, 0.0))
    left = np.cross([0.0, 0.0, 1.0], unit_vector(forward))
    hips, shoulders = lateral_axes(position)
    return float((left * unit_vector(hips + shoulders)).sum(axis=-1).mean())


def toe_direction(position: Array, side: str) -> Array | None:
    """Return the direction from ankle to toe (or its tip), shape (..., 3); None when there is no toe."""
    for toe in (f"{side}_toe", f"{side}_toe_tip"):
        direction = role(position, toe) - role(position, f"{side}_ankle")
        if not np.isnan(direction).any():
            return direction
    return None


def known_roles(position: Array) -> BoolArray:
    """Tell which roles are known, shape (R,)."""
    return np.asarray(~np.isnan(position.reshape(-1, N_ROLES, 3)[0]).any(axis=-1))
