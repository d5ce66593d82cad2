"""From labelled markers to the human in our world."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.body_lengths import LENGTHS, both_sides, median, rest_pose
from imitor.motion.clip import Clip, window
from imitor.motion.joint_centres import CentreFit, fit_centres, joint_centres
from imitor.motion.kinect_body import side_evidence
from imitor.motion.marker_file import MarkerFile, find_gaps
from imitor.motion.marker_sets import BACKS, NEEDED, TOPS, MarkerSetFit
from imitor.motion.normalise import (
    DEFAULT_HEIGHT_M,
    UNITS,
    UP_AXES,
    Stance,
    choose_floor,
    direction,
    find_stance,
    find_up,
    foot_heights,
    middle,
    role,
)
from imitor.motion.sitting import sitting_note
from imitor.types import ROLE_INDEX, ROLES, SIDES, Array, BoolArray, Skeleton

TRUNK: Final = ("pelvis", "neck")
"""Roles without which there is no body."""
STANCE: Final = tuple(f"{s}_{j}" for j in ("shoulder", "ankle") for s in SIDES)
"""Roles that the first frame shows too, where there is such a frame: without them a robot has no first pose."""
NECK_SHARE: Final = 0.315
"""Mid-hip to the neck joint as a fraction of stature."""
TRUNK_SHARE: Final = 0.288
"""Mid-hip to mid-shoulder as a fraction of stature [winter2009]."""
_SPREAD_M: Final = 1.5
"""About how far the markers of a whole body lie apart [m]: tells the unit."""
_MIRRORED: Final = -0.3
_LEAST_FRAMES: Final = 2


@dataclass(frozen=True)
class MarkerOptions:
    """What the user may say; see the options of the source."""

    unit: str = "auto"
    up: str = "auto"
    floor: str | float = "auto"
    height_m: float | None = None
    start_s: float = 0.0
    stop_s: float | None = None
    mass_kg: float = 70.0
    sex: str = "male"


@dataclass(frozen=True)
class MarkerLearning:
    """What a recording showed of a person and a room, good for every other frame.

    Attributes:
        clip: The recording in our world.
        scale: Metres per unit of the recording.
        world: Our world from the recording's axes, shape (3, 3).
        floor_m: Height of the floor in the recording, after turning and scaling [m].
        centres: The constants of the joint centres.
        landmarks: The landmarks that were seen.
        heels: The way from the marker of each heel down to the sole, in the axes of the foot, shape (3,) [m]; none
            where the foot was never seen flat.
    """

    clip: Clip
    scale: float
    world: Array
    floor_m: float
    centres: CentreFit
    landmarks: tuple[str, ...]
    heels: tuple[Array | None, Array | None]


def make_marker_recording(
    path: str | Path, file: MarkerFile, fit: MarkerSetFit, options: MarkerOptions
) -> Clip:
    """Bring a recording into our world.

    Args:
        path: The file, for messages.
        file: What it says.
        fit: Its marker set.
        options: What the user says about it.

    Raises:
        SourceError: There is no body in it, it is mirrored, or no frame is left.
    """
    clip = learn_markers(path, file, fit, options).clip
    return clip.part(*window(path, len(clip), file.rate_hz, options.start_s, options.stop_s))


def learn_markers(
    path: str | Path, file: MarkerFile, fit: MarkerSetFit, options: MarkerOptions
) -> MarkerLearning:
    """Bring a recording into our world whole, and return what was learned on the way.

    Args:
        path: The file, for messages.
        file: What it says.
        fit: Its marker set.
        options: What the user says about it.

    Raises:
        SourceError: There is no body in it, it is mirrored, or no frame is left.
    """
    notes = [f"marker set: {fit.name} ({fit.card.title})"]
    notes += [fit.card.notes] if fit.card.notes else []
    gaps = find_gaps(file.seen, fit.columns)
    notes.append(gaps.told(len(fit.columns)))
    others = len(file.labels) - len(fit.columns)
    notes += [f"{others} other points are no markers of the set: left out"] if others else []
    unit = _unit(path, file, fit, options, notes)
    points = {
        name: UNITS[unit] * file.position[:, list(columns)].mean(axis=1)
        for name, columns in fit.landmarks.items()
        if file.seen[:, list(columns)].all(axis=1).any()
    }
    _check_needs(path, fit, points)
    position, height_m = _centres(path, points, options)
    marker = UNITS[unit] * file.position[:, list(fit.columns)]
    first, last = _in_view(path, position, notes)
    position, marker = position[first:last], marker[first:last]

    up = _up(position, file, options, notes)
    world = np.array(UP_AXES[up], dtype=np.float64)
    position, marker = position @ world.T, marker @ world.T
    stance = find_stance_with_gaps(position, file.rate_hz, height_m)
    floor, why = choose_floor(stance, options.floor)
    notes.append(why)
    position[..., 2] -= floor
    marker[..., 2] -= floor
    ankle_m, toe_m = foot_heights(stance, floor, height_m)
    heels = find_heels(position, stance.flat)
    _put_heels_down(position, heels)
    _check_sides(path, position, notes)
    notes.append(f"stature {height_m:.2f} m" + (" as given" if options.height_m else ""))
    notes.append(f"rate: {file.rate_hz:g} Hz")
    notes += sitting_note(position, file.rate_hz)
    notes += file.notes

    valid: BoolArray = np.asarray(np.isfinite(position).all(axis=-1))
    roles = frozenset(name for name in ROLES if valid[:, ROLE_INDEX[name]].any())
    if "head" not in points:
        notes.append("head: no marker tells it, it is put over the neck")
    skeleton = Skeleton(
        name=fit.name,
        roles=roles,
        rest_position=rest_pose(position, height_m, ankle_m, toe_m, roles),
        height_m=height_m,
        ankle_height_m=ankle_m,
        toe_height_m=toe_m,
        mass_kg=options.mass_kg,
        sex=options.sex,
        marker_names=fit.labels,
        marker_segments=fit.segments,
        notes=tuple(notes),
    )
    facts: dict[str, str | float | bool] = {
        "marker_set": fit.name, "unit": unit, "up": up, "height_m": height_m, "floor_m": floor,
        "rate_hz": file.rate_hz, "left_out_before": first,
        "gaps": gaps.count, "gap_markers": gaps.markers, "gap_frames": gaps.frames, "longest_gap": gaps.longest,
    }  # fmt: skip
    seen: BoolArray = np.asarray(np.isfinite(marker).all(axis=-1))
    clip = Clip(skeleton, file.rate_hz, position, valid, facts, marker=marker, marker_valid=seen)
    centres = fit_centres(points, height_m)
    return MarkerLearning(clip, UNITS[unit], world, floor, centres, tuple(points), heels)


def _unit(
    path: str | Path, file: MarkerFile, fit: MarkerSetFit, options: MarkerOptions, notes: list[str]
) -> str:
    if options.unit != "auto":
        notes.append(f"length unit: {options.unit}, as given")
        return options.unit
    if file.unit or fit.card.unit:
        notes.append(f"length unit: {file.unit or fit.card.unit}")
        return file.unit or fit.card.unit
    part = file.position[:, list(fit.columns)]
    part = part[np.isfinite(part).all(axis=(1, 2))] if np.isfinite(part).all(axis=(1, 2)).any() else part
    spread = median((np.nanmax(part, axis=1) - np.nanmin(part, axis=1)).max(axis=-1))
    if not spread > 0.0:
        raise SourceError(path, "the markers have no size: they all lie in one place")
    unit = min(("m", "dm", "cm", "mm", "inch"), key=lambda u: abs(np.log(UNITS[u] * spread / _SPREAD_M)))
    notes.append(f"length unit: the file names none; taken as {unit} by the body's size")
    return unit


def _centres(path: str | Path, points: dict[str, Array], options: MarkerOptions) -> tuple[Array, float]:
    """Return role positions and the stature [m]."""
    position = joint_centres(points, options.height_m or DEFAULT_HEIGHT_M)
    height_m = options.height_m or stature(position)
    if not np.isfinite(height_m):
        raise SourceError(path, "the markers of pelvis and legs are never seen together: there is no body")
    if not 0.4 < height_m < 3.0:
        raise SourceError(
            path, f"the body would be {height_m:.3g} m tall: set unit, or correct the marker set's landmarks"
        )
    return joint_centres(points, height_m), height_m


def stature(position: Array) -> float:
    """Estimate the stature from legs and trunk [winter2009]; NaN without them [m]."""
    trunk = median(np.linalg.norm(middle(position, "shoulder") - role(position, "pelvis"), axis=-1))
    share = TRUNK_SHARE
    if not np.isfinite(trunk):
        trunk = median(np.linalg.norm(role(position, "neck") - role(position, "pelvis"), axis=-1))
        share = NECK_SHARE
    legs = [LENGTHS[name] for name in ("thigh", "shank")]
    length = trunk + sum(both_sides(position, a, b) for a, b, _ in legs)
    return length / (share + sum(s for _, _, s in legs))


def _in_view(path: str | Path, position: Array, notes: list[str]) -> tuple[int, int]:
    """Return the first frame in which the body is seen and the one after the last that shows the trunk."""
    known = np.isfinite(position).sum(axis=-1) == 3
    ever = [r for r in STANCE if known[:, ROLE_INDEX[r]].any()]
    trunk = np.flatnonzero(known[:, [ROLE_INDEX[r] for r in TRUNK]].all(axis=1))
    whole = np.flatnonzero(known[:, [ROLE_INDEX[r] for r in (*TRUNK, *ever)]].all(axis=1))
    if len(trunk) < _LEAST_FRAMES:
        raise SourceError(path, "no two frames show pelvis and neck: there is no body to imitate")
    first, last = int(trunk[0]), int(trunk[-1]) + 1
    if len(whole) and last - whole[0] > (last - first) // 2:
        first = int(whole[0])
    if last - first < len(position):
        notes.append(
            f"{first} frames before and {len(position) - last} after the body is in view are left out"
        )
    return first, last


def _up(position: Array, file: MarkerFile, options: MarkerOptions, notes: list[str]) -> str:
    if options.up != "auto":
        notes.append(f"up axis of the file: {options.up}, as given")
        return options.up
    if file.up:
        notes.append(f"up axis of the file: {file.up}, as written in it")
        return file.up
    known = np.isfinite(role(position, "neck") + middle(position, "ankle")).all(axis=-1)
    part = position[known] if known.any() else position
    up, clear = find_up(part, part[0])
    notes.append(
        f"up axis of the file: {up}" + ("" if clear else " (uncertain: the body is never upright; set up)")
    )
    return up


def find_stance_with_gaps(position: Array, rate_hz: float, height_m: float) -> Stance:
    """Find the floor and the flat feet from the frames in which both feet are seen.

    Args:
        position: Role positions, z up, shape (T, R, 3) [m].
        rate_hz: Frames per second [Hz].
        height_m: Stature [m].
    """
    flat = np.zeros((len(position), 2), dtype=np.bool_)
    ankles = [ROLE_INDEX[f"{s}_ankle"] for s in SIDES]
    toes = [ROLE_INDEX[f"{s}_toe"] for s in SIDES]
    with_toes = np.isfinite(position[:, [*ankles, *toes]]).all(axis=(1, 2))
    seen = (
        with_toes if with_toes.sum() >= _LEAST_FRAMES else np.isfinite(position[:, ankles]).all(axis=(1, 2))
    )
    if seen.sum() < _LEAST_FRAMES:
        return Stance(float(np.nanmin(position[..., 2])), (np.nan, np.nan, np.nan), flat)
    part = position[seen]
    if seen is not with_toes:
        part[:, toes] = np.nan
    stance = find_stance(part, rate_hz, height_m)
    flat[seen] = stance.flat
    return Stance(stance.floor_m, stance.height_m, flat)


def find_heels(position: Array, flat: BoolArray) -> tuple[Array | None, Array | None]:
    """Find the way from the back of the shoe, where the markers of the heels are, down to the sole.

    What leads down to the floor when the foot stands flat is fixed in the foot: in the axes of heel, toe and ankle.

    Args:
        position: Role positions, the floor at z = 0, shape (T, R, 3) [m].
        flat: When each foot stands flat, shape (T, 2).

    Returns:
        The way for each side, in the axes of the foot, shape (3,) [m]; none for a foot that is never flat.
    """
    found: list[Array | None] = []
    for i, side in enumerate(SIDES):
        heel, axes = _foot_axes(position, side)
        down = (np.swapaxes(axes, 1, 2) @ (heel * (0.0, 0.0, -1.0))[..., None])[..., 0]
        down = down[flat[:, i] & np.isfinite(down).all(axis=-1)]
        found.append(np.asarray(np.median(down, axis=0)) if len(down) else None)
    return found[0], found[1]


def _foot_axes(position: Array, side: str) -> tuple[Array, Array]:
    """Return the heel, shape (T, 3), and the foot's axes: ahead, towards the ankle, across, shape (T, 3, 3)."""
    ankle, heel, toe = (role(position, f"{side}_{name}") for name in ("ankle", "heel", "toe"))
    ahead = direction(toe - heel)
    rise = ankle - heel
    second = direction(rise - ahead * (rise * ahead).sum(-1, keepdims=True))
    return heel, np.stack([ahead, second, np.cross(ahead, second)], axis=-1)  # world from foot


def _put_heels_down(position: Array, heels: tuple[Array | None, Array | None]) -> None:
    """Move the heels down to the sole."""
    for side, down in zip(SIDES, heels, strict=True):
        if down is not None:
            heel, axes = _foot_axes(position, side)
            position[:, ROLE_INDEX[f"{side}_heel"]] = heel + axes @ down


def _check_needs(path: str | Path, fit: MarkerSetFit, points: dict[str, Array]) -> None:
    missing = [n for n in NEEDED if n not in points]
    missing += [
        " or ".join(group)
        for group, ends in ((("sacrum", "psis"), BACKS), (("c7", "clavicle", "shoulder"), TOPS))
        if not any(n in points for n in ends)
    ]
    if missing:
        raise SourceError(
            path, f"marker set '{fit.name}': these are never seen: {', '.join(missing)}; a body needs them"
        )


def _check_sides(path: str | Path, position: Array, notes: list[str]) -> None:
    anatomy, _ = side_evidence(position)
    if anatomy < _MIRRORED:
        raise SourceError(
            path,
            "left and right are swapped: the feet point backwards if the labels are right. Write a marker set with "
            "the sides exchanged and give it with --set source.marker_set=CARD.yaml",
        )
    if anatomy < -_MIRRORED:
        notes.append("left and right could not be checked: the feet do not point across the body")
