"""From a table of depth-camera points to the human in our world."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.human.rotations import about_y
from imitor.motion.body_lengths import filled, rest_pose, smoothed, stature
from imitor.motion.clip import Clip, window
from imitor.motion.kinect_body import LEAST_TILT_RAD, MOST_TILT_RAD, find_floor, find_tilt, side_evidence
from imitor.motion.kinect_file import Capture
from imitor.motion.kinect_points import OPENNI
from imitor.motion.kinect_timing import Timing, evenly
from imitor.motion.normalise import ANKLE_FRACTION, TOE_FRACTION, UNITS
from imitor.types import ROLE_INDEX, ROLES, SIDES, Array, BoolArray, Skeleton

TO_WORLD: Final = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation from the sensor's axes (x to the right hand of an actor who faces it, y up, z away) to ours."""
SENSOR_UNITS: Final = ("m", "cm", "mm")
NEEDED: Final = ("head", *(f"{s}_{j}" for s in SIDES for j in ("shoulder", "hip")))
"""Roles without which there is no body."""
_MIRRORED: Final = -0.3
_FLOOR_WINDOW_S: Final = 0.2


@dataclass(frozen=True)
class KinectOptions:
    """What the user may say; see the options of the source."""

    fifteen: bool = False
    min_confidence: float = 0.5
    unit: str = "auto"
    height_m: float | None = None
    timing: Timing = field(default_factory=Timing)
    tilt_rad: float | None = None
    floor_m: float | None = None
    sides: str = "check"
    start_s: float = 0.0
    stop_s: float | None = None
    mass_kg: float = 70.0
    sex: str = "male"


def make_kinect_recording(path: str | Path, capture: Capture, options: KinectOptions) -> Clip:
    """Bring a capture into our world, x towards the sensor; below the sensor is x = y = 0.

    Raises:
        SourceError: There is no body in it, it is mirrored, or no frame is left.
    """
    notes = [f"skeleton: {capture.points.title}"]
    if options.fifteen and capture.points is not OPENNI:
        capture = _reduce(path, capture)
        notes.append("reduced to the 15 points of OpenNI")
    point, trust = _usable(capture, options)
    point, trust, rate_hz = evenly(path, capture.time_s, point, trust, options.timing, notes)
    position, confidence = _roles(capture, point, trust)
    position, confidence = _trim(path, position, confidence, notes)

    scale = _scale(path, position, options)
    unit = next(u for u in SENSOR_UNITS if UNITS[u] == scale)
    position = scale * position @ TO_WORLD.T
    height_m = options.height_m or stature(position)
    notes.append(f"length unit: {unit}, stature {height_m:.2f} m" + (" as given" if options.height_m else ""))
    tilt = _tilt(position, height_m, options, notes)
    position = position @ about_y(np.array([-tilt]))[0].T
    position, confidence = _sides(path, position, confidence, options, notes)
    valid: BoolArray = np.asarray(np.isfinite(position).all(axis=-1))

    floor, ankle_m, toe_m = _floor(position, valid, rate_hz, height_m, options, notes)
    position[..., 2] -= floor
    first, last = window(path, len(position), rate_hz, options.start_s, options.stop_s)
    roles = frozenset(name for name in ROLES if valid[:, ROLE_INDEX[name]].any())
    _count_gaps(valid[first:last], confidence[first:last], roles, notes)
    skeleton = Skeleton(
        name=capture.points.name,
        roles=roles,
        rest_position=rest_pose(position, height_m, ankle_m, toe_m, roles),
        height_m=height_m,
        ankle_height_m=ankle_m,
        toe_height_m=toe_m,
        mass_kg=options.mass_kg,
        sex=options.sex,
        notes=tuple(notes),
    )
    facts: dict[str, str | float] = {
        "skeleton": capture.points.name, "layout": capture.layout, "unit": unit, "height_m": height_m,
        "tilt_rad": tilt, "floor_m": floor, "rate_hz": rate_hz,
    }  # fmt: skip
    return Clip(skeleton, rate_hz, position, valid, facts, confidence=confidence).part(first, last)


def _reduce(path: str | Path, capture: Capture) -> Capture:
    """Return the 15 points of OpenNI out of 20 or 25."""
    if not capture.points.fifteen:
        raise SourceError(
            path, "the 15 points are derived from 20 or 25 points, not from 22 joints; set points: all"
        )
    pick = [capture.points.points.index(p) for p in capture.points.fifteen]
    return Capture(
        OPENNI, capture.layout, capture.position[:, pick], capture.confidence[:, pick], capture.time_s
    )


def _usable(capture: Capture, options: KinectOptions) -> tuple[Array, Array]:
    """Return points with NaN where they are not to be used, and confidences; a point at zero is the sensor itself."""
    nowhere = np.isnan(capture.position).any(axis=-1) | (capture.position == 0.0).all(axis=-1)
    lost: BoolArray = np.asarray(nowhere)
    trust = np.where(lost, 0.0, capture.confidence)
    bad = lost | (trust < options.min_confidence) | (trust <= 0.0)
    return np.where(bad[..., None], np.nan, capture.position), trust


def _roles(capture: Capture, point: Array, trust: Array) -> tuple[Array, Array]:
    """Return role positions, NaN where a point of theirs is, and the least confidence of their points."""
    weights = capture.points.weights()
    known: BoolArray = np.asarray(np.isfinite(point).all(axis=-1))
    position = weights @ np.where(known[..., None], point, 0.0)
    needs = weights != 0.0
    lost = (~known).astype(np.float64) @ needs.T > 0.0
    lost |= ~needs.any(axis=1)
    position[lost] = np.nan
    confidence = np.zeros(position.shape[:2])
    for r in np.flatnonzero(needs.any(axis=1)):
        confidence[:, r] = trust[:, needs[r]].min(axis=1)
    return position, confidence


def _trim(path: str | Path, position: Array, confidence: Array, notes: list[str]) -> tuple[Array, Array]:
    """Leave out the frames before the body is first seen and after it is last seen."""
    index = [ROLE_INDEX[r] for r in NEEDED]
    seen: BoolArray = np.asarray(np.isfinite(position[:, index]).all(axis=-1))
    never = [r for r, ever in zip(NEEDED, seen.T, strict=True) if not ever.any()]
    if never:
        raise SourceError(
            path,
            f"{', '.join(never)}: never seen; a body needs head, shoulders and hips. "
            "Lower min_confidence, or capture again with the whole body in view",
        )
    whole = np.flatnonzero(seen.all(axis=1))
    if not len(whole):
        raise SourceError(
            path, "no frame has head, shoulders and hips together; lower min_confidence, or capture again"
        )
    first, last = int(whole[0]), int(whole[-1]) + 1
    if last - first < len(position):
        notes.append(
            f"{first} frames before and {len(position) - last} after the body is in view are left out"
        )
    return position[first:last], confidence[first:last]


def _scale(path: str | Path, position: Array, options: KinectOptions) -> float:
    if options.unit != "auto":
        return UNITS[options.unit]
    size = stature(position)
    if not size > 0.0:
        raise SourceError(path, "the skeleton has no size: all its points lie in one place")
    expected = options.height_m or 1.65
    return min((UNITS[u] for u in SENSOR_UNITS), key=lambda f: abs(np.log(f * size / expected)))


def _tilt(position: Array, height_m: float, options: KinectOptions, notes: list[str]) -> float:
    if options.tilt_rad is not None:
        notes.append(f"sensor tilt: {_down(options.tilt_rad)}, as given")
        return options.tilt_rad
    tilt = find_tilt(position, height_m)
    if tilt is None:
        notes.append(
            "sensor tilt: taken as level, nobody stands upright to tell it; set tilt_rad if you know it"
        )
        return 0.0
    if not LEAST_TILT_RAD <= abs(tilt) <= MOST_TILT_RAD:
        notes.append(f"sensor tilt: taken as level (balance tells {_down(tilt)})")
        return 0.0
    notes.append(f"sensor tilt: {_down(tilt)}, so that the body stands over its feet")
    return tilt


def _down(tilt: float) -> str:
    return f"{abs(np.degrees(tilt)):.1f} degrees {'down' if tilt >= 0.0 else 'up'}"


def _sides(
    path: str | Path, position: Array, confidence: Array, options: KinectOptions, notes: list[str]
) -> tuple[Array, Array]:
    if options.sides == "swap":
        other = [ROLE_INDEX[_other_side(name)] for name in ROLES]
        position, confidence = position[:, other], confidence[:, other]
        notes.append("left and right names are exchanged, as given")
    elif options.sides == "mirror":
        position = position * (1.0, -1.0, 1.0)
        notes.append("the picture is mirrored back, as given")
    anatomy, facing = side_evidence(position)
    if options.sides == "check" and anatomy < _MIRRORED:
        raise SourceError(
            path,
            "left and right are swapped: the feet point backwards if the names are right. Set sides: swap if the "
            "names are those a viewer sees, sides: mirror if the whole picture is mirrored, sides: keep if it is right",
        )
    if anatomy < -_MIRRORED:
        notes.append("left and right could not be checked: the feet do not point across the body")
    if facing < _MIRRORED:
        notes.append(
            "the left is on the far side: the person turns the back to the sensor, or sides must be swapped"
        )
    return position, confidence


def _other_side(name: str) -> str:
    for a, b in (SIDES, SIDES[::-1]):
        if name.startswith(f"{a}_"):
            return b + name[len(a) :]
    return name


def _floor(
    position: Array,
    valid: BoolArray,
    rate_hz: float,
    height_m: float,
    options: KinectOptions,
    notes: list[str],
) -> tuple[float, float, float]:
    """Return the floor's height in the sensor's levelled world and the heights of ankle and toe over it [m]."""
    usual = ANKLE_FRACTION * height_m, TOE_FRACTION * height_m
    if not all(valid[:, ROLE_INDEX[f"{s}_ankle"]].any() for s in SIDES):
        hips = float(np.nanmedian(position[:, ROLE_INDEX["pelvis"], 2]))
        floor = hips - 0.53 * height_m if options.floor_m is None else options.floor_m
        notes.append("floor: the feet are never seen; put under a person who stands upright")
        return floor, *usual
    width = 2 * max(1, round(0.5 * _FLOOR_WINDOW_S * rate_hz)) + 1
    found, ankle, toe = find_floor(smoothed(filled(position, valid), width), height_m)
    floor = found if options.floor_m is None else options.floor_m
    why = "from the standing feet" if options.floor_m is None else "as given"
    notes.append(f"floor: at {floor:+.2f} m of the sensor's levelled axes, {why}")
    ankle, toe = ankle + found - floor, toe + found - floor
    return (
        floor,
        ankle if np.isfinite(ankle) and ankle > 0.0 else usual[0],
        toe if np.isfinite(toe) and toe > 0.0 else usual[1],
    )


def _count_gaps(valid: BoolArray, confidence: Array, roles: frozenset[str], notes: list[str]) -> None:
    index = [ROLE_INDEX[r] for r in roles]
    lost = float(1.0 - valid[:, index].mean())
    inferred = float((valid[:, index] & (confidence[:, index] < 1.0)).mean())
    notes.append(f"{100 * lost:.1f} % of the points are lost, {100 * inferred:.1f} % are inferred and used")
