"""From rigid targets to the human in our world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imitor.errors import SourceError, did_you_mean
from imitor.human.markers import TARGETS
from imitor.motion.body_lengths import rest_pose
from imitor.motion.clip import Clip, window
from imitor.motion.marker_file import find_gaps
from imitor.motion.marker_recording import find_stance_with_gaps, stature
from imitor.motion.normalise import DEFAULT_HEIGHT_M, UNITS, UP_AXES, choose_floor, foot_heights
from imitor.motion.sitting import sitting_note
from imitor.motion.target_joints import TargetFit, fit_targets, place_joints, target_joints
from imitor.types import ROLE_INDEX, ROLES, Array, BoolArray, Skeleton


@dataclass(frozen=True)
class TargetOptions:
    """What the user may say; see the options of the source."""

    rate_hz: float = 60.0
    unit: str = "mm"
    up: str = "z"
    floor: str | float = "auto"
    height_m: float | None = None
    start_s: float = 0.0
    stop_s: float | None = None
    mass_kg: float = 70.0
    sex: str = "male"
    rate_note: str = "as given: the file has no time stamps"


@dataclass(frozen=True)
class TargetLearning:
    """What a recording showed of a person and a room, good for every other frame.

    Attributes:
        clip: The recording in our world.
        scale: Metres per unit of the recording.
        world: Our world from the recording's axes, shape (3, 3).
        floor_m: Height of the floor in the recording, after turning and scaling [m].
        joints: Where the joints lie in the targets.
    """

    clip: Clip
    scale: float
    world: Array
    floor_m: float
    joints: TargetFit


def check_names(path: str | Path, names: Sequence[str]) -> None:
    """Refuse names of targets that are none, or missing ones.

    Raises:
        SourceError: With the legal names.
    """
    for name in names:
        if name not in TARGETS:
            hint = did_you_mean(name, TARGETS)
            raise SourceError(
                path,
                f"targets: none is called '{name}'"
                + (f"; {hint}" if hint else f"; legal: {', '.join(TARGETS)}"),
            )
    missing = [n for n in TARGETS if n not in names]
    if missing or len(set(names)) < len(names):
        raise SourceError(
            path, f"targets: {', '.join(missing)} missing" if missing else "targets: a name is given twice"
        )


def make_target_recording(
    path: str | Path, pose: Array, names: Sequence[str], options: TargetOptions
) -> Clip:
    """Bring a recording into our world.

    Args:
        path: The file, for messages.
        pose: World from target, shape (T, K, 4, 4) [file units]; NaN where lost.
        names: Names of the targets in the order of the file.
        options: What the user says about it.

    Raises:
        SourceError: There is no body in it, or no frame is left.
    """
    clip = learn_targets(path, pose, names, options).clip
    return clip.part(*window(path, len(clip), options.rate_hz, options.start_s, options.stop_s))


def learn_targets(
    path: str | Path, pose: Array, names: Sequence[str], options: TargetOptions
) -> TargetLearning:
    """Bring a recording into our world whole, and return what was learned on the way.

    Args:
        path: The file, for messages.
        pose: World from target, shape (T, K, 4, 4) [file units]; NaN where lost.
        names: Names of the targets in the order of the file.
        options: What the user says about it.

    Raises:
        SourceError: There is no body in it.
    """
    gaps = find_gaps(np.asarray(np.isfinite(pose).all(axis=(2, 3))))
    notes = [
        "17 rigid targets of unknown mounting: joint centres from their motion, or near a guess where they rest"
    ]
    notes.append(gaps.told(len(names)).replace("markers", "targets").replace("marker-", "target-"))
    world = np.eye(4)
    world[:3, :3] = UP_AXES[options.up]
    scaled = pose.copy()
    scaled[..., :3, 3] *= UNITS[options.unit]
    scaled = world @ scaled
    by_name = {name: scaled[:, i] for i, name in enumerate(names)}
    position = target_joints(by_name, options.height_m or DEFAULT_HEIGHT_M)
    height_m = options.height_m or stature(position)
    if not 0.4 < height_m < 3.0:
        raise SourceError(
            path, f"the body would be {height_m:.3g} m tall: set unit, or correct the order of targets"
        )
    joints = fit_targets(by_name, height_m)
    position = place_joints(np.stack([by_name[name] for name in TARGETS], axis=1), joints)
    stance = find_stance_with_gaps(position, options.rate_hz, height_m)
    floor, why = choose_floor(stance, options.floor)
    notes += [why, f"stature {height_m:.2f} m" + (" as given" if options.height_m else "")]
    notes.append(f"rate: {options.rate_hz:g} Hz, {options.rate_note}")
    notes += sitting_note(position, options.rate_hz)
    position[..., 2] -= floor
    scaled[..., 2, 3] -= floor
    ankle_m, toe_m = foot_heights(stance, floor, height_m)
    valid: BoolArray = np.asarray(np.isfinite(position).all(axis=-1))
    seen: BoolArray = np.asarray(np.isfinite(scaled).all(axis=(2, 3)))
    roles = frozenset(name for name in ROLES if valid[:, ROLE_INDEX[name]].any())
    skeleton = Skeleton(
        name="art_targets",
        roles=roles,
        rest_position=rest_pose(position, height_m, ankle_m, toe_m, roles),
        height_m=height_m,
        ankle_height_m=ankle_m,
        toe_height_m=toe_m,
        mass_kg=options.mass_kg,
        sex=options.sex,
        target_names=tuple(names),
        notes=tuple(notes),
    )
    facts: dict[str, str | float | bool] = {
        "unit": options.unit, "up": options.up, "height_m": height_m, "floor_m": floor, "rate_hz": options.rate_hz,
        "gaps": gaps.count, "gap_frames": gaps.frames,
    }  # fmt: skip
    clip = Clip(skeleton, options.rate_hz, position, valid, facts, target=scaled, target_valid=seen)
    return TargetLearning(clip, UNITS[options.unit], world[:3, :3], floor, joints)
