"""The rest pose: an upright T-pose that every recording gets, whatever the zero angles of its file mean.

Zero angles are a T-pose in one file, legs spread or arms hanging in the next, and no human pose at all
in a third. The rest pose is built from a reference (the zero angles if they are an upright human, else
an added T-pose frame, else the most upright frame of the motion) and straightened: the body faces +x,
legs point down, arms point sideways, feet point ahead with level soles. Every orientation is relative to
this pose, so that it means the same for all files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.motion.normalise import lateral_axes, middle, role, toe_direction, unit_vector
from imitor.motion.rig import Rig
from imitor.types import SIDES, Array, BoolArray

MIN_FLAT_FRAMES: Final = 5

_LIMBS: Final = (
    ("hip", "knee", (0.0, 0.0, -1.0)),
    ("knee", "ankle", (0.0, 0.0, -1.0)),
    ("shoulder", "elbow", (0.0, 1.0, 0.0)),
    ("elbow", "wrist", (0.0, 1.0, 0.0)),
    ("wrist", "hand", (0.0, 1.0, 0.0)),
)
"""Limb segments and where they point in the rest pose, for the left side; proximal before distal."""


@dataclass(frozen=True)
class Motion:
    """A clip in a world with z up.

    Attributes:
        rotation: World from node axes, shape (T, W, 3, 3).
        roles: Role positions, shape (T, R, 3).
        flat: Frames in which the feet stand flat, shape (T, 2); left, right.
    """

    rotation: Array
    roles: Array
    flat: BoolArray


@dataclass(frozen=True)
class Reference:
    """One pose of the chain in a world with z up.

    Attributes:
        kind: ``zero`` (zero angles), ``tpose`` (an added frame) or ``motion`` (the most upright frame).
        position: Shape (W, 3).
        rotation: World from node axes, shape (W, 3, 3).
        roles: Role positions, shape (R, 3).
    """

    kind: str
    position: Array
    rotation: Array
    roles: Array


_FOOT_AIM: Final = np.array([np.sqrt(1.0 - 0.33**2), 0.0, -0.33])
"""Usual direction from ankle to toe joint of a foot that stands flat: a slope of about 19 degrees."""


def uprightness(position: Array) -> Array:
    """Return how upright bodies stand, shape (...): least cosine of trunk and legs with the vertical."""
    trunk = unit_vector(role(position, "neck") - middle(position, "hip"))[..., 2]
    legs = [
        unit_vector(role(position, f"{side}_{a}") - role(position, f"{side}_{b}"))[..., 2]
        for side in SIDES
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    return np.asarray(np.min([trunk, *legs], axis=0))


def is_upright(position: Array) -> bool:
    """Tell whether one pose, shape (R, 3), is a human who stands upright."""
    hips = unit_vector(role(position, "left_hip") - role(position, "right_hip"))
    shoulders = unit_vector(role(position, "left_shoulder") - role(position, "right_shoulder"))
    head = role(position, "head") - role(position, "neck")
    return bool(
        float(uprightness(position)) > 0.85
        and hips @ shoulders > 0.85
        and abs(hips[2]) < 0.3
        and unit_vector(head)[2] > 0.6
    )


def is_t_pose(position: Array) -> bool:
    """Tell whether one pose, shape (R, 3), is an upright human with both arms straight out to the sides."""
    lateral = unit_vector(role(position, "left_hip") - role(position, "right_hip"))
    arms = [
        sign * unit_vector(role(position, f"{side}_{b}") - role(position, f"{side}_{a}")) @ lateral
        for side, sign in (("left", 1.0), ("right", -1.0))
        for a, b in (("shoulder", "elbow"), ("elbow", "wrist"))
    ]
    return is_upright(position) and bool(min(arms) > 0.85)


def has_added_t_pose(position: Array) -> bool:
    """Tell whether the first frame is a T-pose that is no part of the motion: a T-pose and then a jump.

    A jump is a step of some joint three times as long as the fastest of the motion, and longer than an eighth
    of the leg.
    """
    if len(position) < 3 or not is_t_pose(position[0]):
        return False
    step = np.nanmax(np.linalg.norm(np.diff(position, axis=0), axis=-1), axis=1)
    leg = np.linalg.norm(role(position[0], "left_hip") - role(position[0], "left_knee")) + np.linalg.norm(
        role(position[0], "left_knee") - role(position[0], "left_ankle")
    )
    return bool(step[0] > max(leg / 8.0, 3.0 * np.quantile(step[1:], 0.99)))


def rest_rotations(rig: Rig, reference: Reference, motion: Motion) -> Array:
    """Return the rotations of the chain in the rest pose, world from node axes, shape (W, 3, 3).

    Args:
        rig: The tree with its roles.
        reference: The pose to straighten.
        motion: The motion; its flat feet level the soles.
    """
    facing = _facing(reference.roles)
    correction: dict[int, Array] = {0: facing}
    if reference.kind == "motion":
        _straighten_trunk(correction, rig, reference, motion.rotation)
    for side, y in zip(SIDES, (1.0, -1.0), strict=True):
        for start, end, aim in _LIMBS:
            direction = role(reference.roles, f"{side}_{end}") - role(reference.roles, f"{side}_{start}")
            if f"{side}_{start}" in rig.turn and direction @ direction > 0.0:  # false for NaN
                i = rig.turn[f"{side}_{start}"]
                base = _inherited(correction, rig, i)
                correction[i] = _shortest(base @ unit_vector(direction), np.array(aim) * (1.0, y, 1.0)) @ base
    for i, side in enumerate(SIDES):
        ankle = rig.turn[f"{side}_ankle"]
        correction[ankle] = _foot(reference, facing, side)
        level = _level_foot(motion, ankle, i)
        if level is not None:
            correction[ankle] = level @ reference.rotation[ankle].T
    return np.stack(
        [_inherited(correction, rig, i) @ rotation for i, rotation in enumerate(reference.rotation)]
    )


def rest_positions(rig: Rig, reference: Reference, rest: Array) -> Array:
    """Return the role positions in the rest pose, shape (R, 3): the middle of the hips at the origin.

    Args:
        rig: The tree with its roles.
        reference: Any pose of the same body.
        rest: Rotations of the chain in the rest pose, shape (W, 3, 3).
    """
    place = np.zeros_like(reference.position)
    for i, parent in enumerate(rig.parent):
        if parent >= 0:
            local = reference.rotation[parent].T @ (reference.position[i] - reference.position[parent])
            place[i] = place[parent] + rest[parent] @ local
    roles = rig.roles(place[None])[0]
    return np.asarray(roles - middle(roles, "hip"))


def mean_rotation(rotations: Array) -> Array:
    """Return the mean of rotations, shape (N, 3, 3): the rotation nearest to their arithmetic mean."""
    u, _, vt = np.linalg.svd(rotations.mean(axis=0))
    u[:, -1] *= np.sign(np.linalg.det(u @ vt))
    return np.asarray(u @ vt)


def _facing(roles: Array) -> Array:
    """Return the rotation about the vertical that turns a pose, shape (R, 3), to face +x."""
    hips, shoulders = lateral_axes(roles)
    lateral = hips + shoulders
    return _yaw(-np.arctan2(-lateral[0], lateral[1]))


def _inherited(correction: Mapping[int, Array], rig: Rig, i: int) -> Array:
    """Return the correction of a row, or of its nearest ancestor that has one; the root always has."""
    while i not in correction:
        i = rig.parent[i]
    return correction[i]


def _straighten_trunk(correction: dict[int, Array], rig: Rig, reference: Reference, rotation: Array) -> None:
    """Set pelvis, chest, neck and head upright for a reference that is a frame of the motion."""
    roles = reference.roles
    trunk = unit_vector(role(roles, "neck") - middle(roles, "hip"))
    pelvis = rig.turn["pelvis"]
    chest = rig.turn.get("chest", pelvis)
    for i, joint in ((pelvis, "hip"), (chest, "shoulder")):
        lateral = role(roles, f"left_{joint}") - role(roles, f"right_{joint}")
        y = unit_vector(lateral - trunk * (trunk @ lateral))
        correction[i] = np.array([np.cross(y, trunk), y, trunk])
    correction[0] = correction[pelvis]
    upright = correction[chest] @ reference.rotation[chest]
    for name in ("neck", "head"):
        i = rig.turn[name]
        if i != chest:  # nothing tells how a head is turned but that it looks ahead on the whole
            relative = mean_rotation(np.swapaxes(rotation[:, chest], 1, 2) @ rotation[:, i])
            correction[i] = upright @ relative @ reference.rotation[i].T


def _foot(reference: Reference, facing: Array, side: str) -> Array:
    """Return the correction of a foot whose level is unknown: it points ahead and keeps its slope."""
    ahead = toe_direction(reference.roles, side)
    if ahead is None:
        return facing
    turn = _yaw(-np.arctan2(ahead[1], ahead[0]))
    if reference.kind == "motion":  # in that frame the foot may stand on its toes
        turn = _shortest(turn @ unit_vector(ahead), _FOOT_AIM) @ turn
    return turn


def _level_foot(motion: Motion, ankle: int, side: int) -> Array | None:
    """Return the mean rotation of a flat foot, turned to point along +x; None with too few frames."""
    flat = motion.flat[:, side]
    ahead = toe_direction(motion.roles[flat], SIDES[side])
    if ahead is None or len(ahead) < MIN_FLAT_FRAMES:
        return None
    return mean_rotation(_yaw(-np.arctan2(ahead[:, 1], ahead[:, 0])) @ motion.rotation[flat, ankle])


def _yaw(angle: Array | float) -> Array:
    """Return rotations about the vertical, shape (..., 3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.stack(
        [np.stack([c, -s, zero], -1), np.stack([s, c, zero], -1), np.stack([zero, zero, one], -1)], axis=-2
    )


def _shortest(start: Array, end: Array) -> Array:
    """Return the shortest rotation that turns one unit vector, shape (3,), onto another."""
    axis, cosine = np.cross(start, end), float(start @ end)
    if cosine < -1.0 + 1e-9:  # opposite: half a turn about any axis across
        across = np.eye(3)[np.argmin(np.abs(start))]
        across = unit_vector(across - start * (start @ across))
        return 2.0 * np.outer(across, across) - np.eye(3)
    x = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + x + x @ x / (1.0 + cosine))
