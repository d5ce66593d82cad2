"""From a motion file's tree and channels to the human in our world, for the whole clip at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.bvh_file import Bvh
from imitor.motion.clip import Clip, window
from imitor.motion.kinematics import Poses, ancestry
from imitor.motion.normalise import (
    ANKLE_FRACTION,
    UNITS,
    UP_AXES,
    Scale,
    choose_floor,
    find_scale,
    find_stance,
    find_up,
    foot_heights,
    handedness,
    known_roles,
    lateral_axes,
    role,
    snap_rate,
)
from imitor.motion.rest_pose import (
    Motion,
    Reference,
    has_added_t_pose,
    is_t_pose,
    is_upright,
    rest_positions,
    rest_rotations,
    uprightness,
)
from imitor.motion.rig import Rig
from imitor.motion.skeletons import SkeletonFit
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, Array, BoolArray, Skeleton

HEAD_HEIGHT_FRACTION: Final = 0.91
"""Height of the skull's base as a fraction of stature [-], for skeletons without a head top."""


@dataclass(frozen=True)
class ReadOptions:
    """What the user may say about a file instead of letting it be found.

    Attributes:
        unit: ``auto``, a name out of `UNITS`, or metres per unit.
        up: ``auto`` or the axis that points up.
        height_m: Stature, when known [m].
        floor: ``auto``, ``file`` or the floor's height in the recording [m].
        drop_tpose: Whether the first frame is an added T-pose; None: find out.
        start_s: Where to begin, from the first frame of the motion [s].
        stop_s: Where to end, from the first frame of the motion [s]; None: at its end.
        mass_kg: Body mass [kg].
        sex: ``male`` or ``female``.
    """

    unit: str | float = "auto"
    up: str = "auto"
    height_m: float | None = None
    floor: str | float = "auto"
    drop_tpose: bool | None = None
    start_s: float = 0.0
    stop_s: float | None = None
    mass_kg: float = 70.0
    sex: str = "male"


def make_recording(path: str | Path, bvh: Bvh, fit: SkeletonFit, options: ReadOptions) -> Clip:
    """Bring a clip into our world.

    Args:
        path: The file, for messages.
        bvh: What the file says.
        fit: Its skeleton.
        options: What the user says about it.

    Raises:
        SourceError: The body is mirrored or has no size, or no frame is left.
    """
    rate_hz = snap_rate(bvh.frame_time_s)
    notes = [f"skeleton: {fit.name} ({fit.card.title})"]
    notes += [fit.card.notes] if fit.card.notes else []
    rig = Rig(bvh.nodes, fit.points)
    up = _up(rig, bvh, options, notes)
    world = np.array(UP_AXES[up], dtype=np.float64)
    poses, zero = rig.poses(bvh.motion, world), rig.poses(_zero_angles(bvh), world)
    position = rig.roles(poses.position)

    added = has_added_t_pose(position)
    drop = added if options.drop_tpose is None else options.drop_tpose and len(position) > 1
    reference = _reference(rig, poses, zero, added or drop or len(position) == 1)
    if drop:
        notes.append("frame 1 is an added T-pose and no motion: dropped")
        poses, position = Poses(poses.node, poses.position[1:], poses.rotation[1:]), position[1:]
    if reference.kind == "motion":
        notes.append("the zero angles are no human pose; the rest pose is built from the most upright frame")

    def rest(flat: BoolArray) -> tuple[Array, Array]:
        rotations = rest_rotations(rig, reference, Motion(poses.rotation, position, flat))
        return rotations, rest_positions(rig, reference, rotations)

    displaced = _displacement(rig, bvh)

    size = stature(rest(np.zeros((len(position), 2), dtype=np.bool_))[1])
    if not 0.0 < size < np.inf:
        raise SourceError(path, "the skeleton has no height: are the OFFSETs zero?")
    scale = _scale(size, fit, options)
    stance = find_stance(position * scale.factor, rate_hz, size * scale.factor)
    rotations, rest_position = rest(stance.flat)
    rest_position = rest_position * scale.factor
    position = position * scale.factor
    height_m = size * scale.factor
    notes.append(_unit_note(scale, height_m, options))
    if displaced * scale.factor > 0.01:
        notes.append(
            f"joints are displaced in their parents by up to {displaced * scale.factor:.2f} m: bones stretch"
        )

    floor, why = choose_floor(stance, options.floor)
    notes.append(why)
    position[..., 2] -= floor
    ankle_m, toe_m = foot_heights(stance, floor, height_m)
    rest_position[:, 2] += ankle_m - np.mean(
        [role(rest_position, f"{s}_ankle")[2] for s in ("left", "right")]
    )
    _check_sides(path, position, notes)
    raw_hz = 1.0 / bvh.frame_time_s
    notes.append(f"rate: {rate_hz:g} Hz" + (f" (written {raw_hz:.4f} Hz)" if rate_hz != raw_hz else ""))
    first, last = window(path, len(position), rate_hz, options.start_s, options.stop_s)
    valid = known_roles(position)
    skeleton = Skeleton(
        name=fit.name,
        roles=frozenset(name for name in ROLES if valid[ROLE_INDEX[name]]),
        rest_position=rest_position,
        height_m=height_m,
        ankle_height_m=ankle_m,
        toe_height_m=toe_m,
        mass_kg=options.mass_kg,
        sex=options.sex,
        notes=tuple(notes),
    )
    facts: dict[str, str | float | bool] = {
        "skeleton": fit.name,
        "unit": scale.name,
        "metres_per_unit": scale.factor,
        "up": up,
        "height_m": height_m,
        "floor_m": floor,
        "rate_hz": rate_hz,
        "dropped_tpose": bool(drop),
        "reference": reference.kind,
    }
    clip = Clip(
        skeleton,
        rate_hz,
        position,
        np.tile(valid, (len(position), 1)),
        facts,
        _orientations(rig, poses.rotation, rotations),
    )
    return clip.part(first, last)


def _up(rig: Rig, bvh: Bvh, options: ReadOptions, notes: list[str]) -> str:
    up, clear = options.up, True
    if up == "auto":
        as_is = np.eye(3)
        sample = bvh.motion[:: max(1, len(bvh.motion) // 500)]
        up, clear = find_up(
            rig.roles(rig.poses(sample, as_is).position),
            rig.roles(rig.poses(_zero_angles(bvh), as_is).position)[0],
        )
    notes.append(
        f"up axis of the file: {up}" + ("" if clear else " (uncertain: the body is never upright; set up)")
    )
    return up


def _zero_angles(bvh: Bvh) -> Array:
    """Return the first frame with all angles zero: position channels may hold the bones, so they stay."""
    names = [c for node in bvh.nodes for c in node.channels]
    return np.where([c.endswith("rotation") for c in names], 0.0, bvh.motion[:1])


def _displacement(rig: Rig, bvh: Bvh) -> float:
    """Return how far position channels of joints other than the pelvis move over time [file units]."""
    first = np.cumsum([0, *(len(n.channels) for n in bvh.nodes)])
    carriers = set(ancestry(bvh.nodes, [rig.points["pelvis"].turns_with]))
    columns = [
        [first[i] + k for k, c in enumerate(bvh.nodes[i].channels) if c.endswith("position")]
        for i in rig.chain
        if i not in carriers
    ]
    return max((float(np.linalg.norm(np.ptp(bvh.motion[:, c], axis=0))) for c in columns), default=0.0)


def _reference(rig: Rig, poses: Poses, zero: Poses, first_may_be: bool) -> Reference:
    roles, at_zero = rig.roles(poses.position), rig.roles(zero.position)[0]
    if is_upright(at_zero):  # before a T-pose frame, which bends necks and spines as the converter saw fit
        return Reference("zero", zero.position[0], zero.rotation[0], at_zero)
    if first_may_be and is_t_pose(roles[0]):
        return Reference("tpose", poses.position[0], poses.rotation[0], roles[0])
    best = int(np.argmax(uprightness(roles)))
    return Reference("motion", poses.position[best], poses.rotation[best], roles[best])


def stature(rest: Array) -> float:
    """Return the stature in the units of the rest pose: from the ankles up, and the ankles' height added."""
    ankle = 0.5 * (role(rest, "left_ankle") + role(rest, "right_ankle"))[2]
    top = role(rest, "head_top")[2]
    if not np.isnan(top):
        return float(top - ankle) / (1.0 - ANKLE_FRACTION)
    return float(role(rest, "head")[2] - ankle) / (HEAD_HEIGHT_FRACTION - ANKLE_FRACTION)


def _scale(size: float, fit: SkeletonFit, options: ReadOptions) -> Scale:
    if options.unit == "auto":
        return find_scale(size, fit.card.unit, options.height_m)
    if isinstance(options.unit, str):
        return Scale(UNITS[options.unit], options.unit)
    return Scale(options.unit, f"{options.unit:g} m")


def _unit_note(scale: Scale, height_m: float, options: ReadOptions) -> str:
    if scale.known:
        return f"length unit: {scale.name} ({scale.factor:.6g} m), stature {height_m:.2f} m"
    known = "the given" if options.height_m is not None else "an assumed"
    return (
        f"no known length unit fits: scaled to {known} stature of {height_m:.2f} m "
        f"(1 unit = {scale.factor:.6g} m); set unit or height_m if you know better"
    )


def _check_sides(path: str | Path, position: Array, notes: list[str]) -> None:
    cosine = handedness(position)
    if cosine < -0.3:
        raise SourceError(
            path,
            "left and right are swapped: the feet point backwards if the names are right. "
            "Write a skeleton card with the sides exchanged and give it with --set source.skeleton=CARD.yaml",
        )
    if cosine < 0.3:
        notes.append("left and right could not be checked: the feet do not point across the body")
    hips, shoulders = lateral_axes(position)
    twist = np.degrees(np.arccos(np.clip((hips * shoulders).sum(axis=-1), -1.0, 1.0)))
    if np.median(twist) > 75.0:
        notes.append(
            f"hips and shoulders face {np.median(twist):.0f} degrees apart: is the pelvis sensor calibrated?"
        )


def _orientations(rig: Rig, rotation: Array, rest: Array) -> Array:
    """Return the rotations from the rest pose to each frame, shape (T, R, 3, 3)."""
    out = np.full((len(rotation), N_ROLES, 3, 3), np.nan)
    for name, i in rig.turn.items():
        out[:, ROLE_INDEX[name]] = rotation[:, i] @ rest[i].T
    return out
