"""The rest pose: an upright T-pose that every recording gets, whatever the zero angles of its file mean.

Zero angles are a T-pose in one file, legs spread or arms hanging in the next, and no human pose at all in a third.
The rest pose is built from a reference (an added T-pose frame, else the zero angles if they are an upright human, else
the most upright frame of the motion) and straightened: the body faces +x, legs point down, arms point sideways, the
feet point ahead. Every joint's orientation is then relative to this pose, so that it means the same for all files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.motion.bvh_file import Node
from imitor.motion.normalise import lateral_axes, middle, role, toe_direction, unit_vector
from imitor.motion.skeletons import RolePoint
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, BoolArray

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
class Reference:
    """One pose of the nodes in a world with z up.

    Attributes:
        kind: ``tpose`` (an added frame), ``zero`` (zero angles) or ``motion`` (the most upright frame).
        position: Shape (W, 3).
        rotation: World from node axes, shape (W, 3, 3).
        roles: Role positions, shape (R, 3).
    """

    kind: str
    position: Array
    rotation: Array
    roles: Array


_FOOT_AIM: Final = np.array([np.sqrt(1.0 - 0.33**2), 0.0, -0.33])
"""Direction from ankle to toe joint of a foot that stands flat, pointing ahead: a slope of about 19 degrees."""


def uprightness(position: Array) -> Array:
    """Return how upright bodies stand: the least cosine of trunk, thighs and shanks with the vertical, shape (...)."""
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
        uprightness(position) > 0.85
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
    return is_upright(position) and min(arms) > 0.85


def has_added_t_pose(position: Array) -> bool:
    """Tell whether the first frame is a T-pose that is no part of the motion: a T-pose and then a jump.

    A jump is a step of some joint three times as long as the fastest of the motion, and longer than an eighth of the
    leg.
    """
    if len(position) < 3 or not is_t_pose(position[0]):
        return False
    step = np.nanmax(np.linalg.norm(np.diff(position, axis=0), axis=-1), axis=1)
    leg = np.linalg.norm(role(position[0], "left_hip") - role(position[0], "left_knee")) + np.linalg.norm(
        role(position[0], "left_knee") - role(position[0], "left_ankle")
    )
    return bool(step[0] > max(leg / 8.0, 3.0 * np.quantile(step[1:], 0.99)))


def rest_rotations(
    nodes: Sequence[Node],
    chain: Sequence[int],
    points: Mapping[str, RolePoint],
    reference: Reference,
    rotation: Array,
    flat: BoolArray | None = None,
    position: Array | None = None,
) -> Array:
    """Return the nodes' rotations in the rest pose, world from node axes, shape (W, 3, 3).

    Args:
        nodes: The file's tree.
        chain: The nodes computed, parents before children, shape (W,).
        points: Role to place in the tree.
        reference: The pose to straighten.
        rotation: Rotations of the motion, z up, shape (T, W, 3, 3).
        flat: Frames in which the feet stand flat, shape (T, 2); their mean levels the soles. Optional.
        position: Role positions of the motion, shape (T, R, 3), with ``flat``.
    """
    row = {node: i for i, node in enumerate(chain)}
    turn = {name: row[point.turns_with] for name, point in points.items()}
    facing = _facing(reference.roles)
    correction: dict[int, Array] = {0: facing}
    if reference.kind == "motion":
        _straighten_trunk(correction, turn, reference, rotation)

    def inherited(i: int) -> Array:
        while i not in correction:
            i = row[nodes[chain[i]].parent]
        return correction[i]

    for side, y in zip(SIDES, (1.0, -1.0), strict=True):
        for start, end, aim in _LIMBS:
            direction = role(reference.roles, f"{side}_{end}") - role(reference.roles, f"{side}_{start}")
            if f"{side}_{start}" in turn and direction @ direction > 0.0:  # false for NaN
                i = turn[f"{side}_{start}"]
                base = inherited(i)
                correction[i] = _shortest(base @ unit_vector(direction), np.array(aim) * (1.0, y, 1.0)) @ base
    for i, side in enumerate(SIDES):
        ankle = f"{side}_ankle"
        if ankle not in turn:
            continue
        level = None
        if flat is not None and position is not None:
            level = _level_foot(rotation[:, turn[ankle]], position, side, flat[:, i])
        ahead = toe_direction(reference.roles, side)
        if level is not None:
            correction[turn[ankle]] = level @ reference.rotation[turn[ankle]].T
        elif ahead is not None:
            correction[turn[ankle]] = _yaw(-np.arctan2(ahead[1], ahead[0]))
            if reference.kind == "motion":  # the foot may stand on its toes in that frame
                now = unit_vector(correction[turn[ankle]] @ ahead)
                correction[turn[ankle]] = _shortest(now, _FOOT_AIM) @ correction[turn[ankle]]
        else:
            correction[turn[ankle]] = facing
    rest = np.empty_like(reference.rotation)
    applied = np.empty_like(reference.rotation)
    for i, node in enumerate(chain):
        parent = row.get(nodes[node].parent)
        applied[i] = correction.get(i, facing if parent is None else applied[parent])
        rest[i] = applied[i] @ reference.rotation[i]
    return rest


def rest_positions(
    nodes: Sequence[Node],
    chain: Sequence[int],
    points: Mapping[str, RolePoint],
    reference: Reference,
    rest: Array,
) -> Array:
    """Return the role positions in the rest pose, shape (R, 3): the middle of the hips at the origin."""
    row = {node: i for i, node in enumerate(chain)}
    place = np.zeros((len(chain), 3))
    for i, node in enumerate(chain):
        parent = row.get(nodes[node].parent)
        if parent is not None:
            local = reference.rotation[parent].T @ (reference.position[i] - reference.position[parent])
            place[i] = place[parent] + rest[parent] @ local
    roles = role_positions(place[None], row, points)[0]
    return roles - middle(roles, "hip")


def role_positions(position: Array, row: Mapping[int, int], points: Mapping[str, RolePoint]) -> Array:
    """Return role positions, shape (T, R, 3), from node positions, shape (T, W, 3).

    The pelvis is the middle of the hips, unless its place is a line of its own.
    """
    out = np.full((len(position), N_ROLES, 3), np.nan)
    for name, point in points.items():
        start = position[:, row[point.start]]
        if point.end != point.start:
            start = start + point.at * (position[:, row[point.end]] - start)
        out[:, ROLE_INDEX[name]] = start
    pelvis = points.get("pelvis")
    if pelvis is None or pelvis.end == pelvis.start:
        out[:, ROLE_INDEX["pelvis"]] = middle(out, "hip")
    return out


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


def _straighten_trunk(
    correction: dict[int, Array], turn: Mapping[str, int], reference: Reference, rotation: Array
) -> None:
    """Set pelvis, chest, neck and head upright for a reference that is a frame of the motion."""
    roles = reference.roles
    trunk = unit_vector(role(roles, "neck") - middle(roles, "hip"))
    for name, joint in (("pelvis", "hip"), ("chest", "shoulder")):
        lateral = role(roles, f"left_{joint}") - role(roles, f"right_{joint}")
        y = unit_vector(lateral - trunk * (trunk @ lateral))
        correction[turn.get(name, 0)] = np.array([np.cross(y, trunk), y, trunk])
    correction[0] = correction[turn["pelvis"]]
    chest = turn.get("chest", turn["pelvis"])
    upright = correction[chest] @ reference.rotation[chest]
    for name in ("neck", "head"):
        relative = mean_rotation(np.swapaxes(rotation[:, chest], 1, 2) @ rotation[:, turn[name]])
        if turn[name] != chest:
            correction[turn[name]] = upright @ relative @ reference.rotation[turn[name]].T


def _level_foot(rotation: Array, position: Array, side: str, flat: BoolArray) -> Array | None:
    """Return the mean rotation of a foot that stands flat, turned to point along +x; None with too few frames."""
    ahead = toe_direction(position[flat], side)
    if ahead is None or len(ahead) < MIN_FLAT_FRAMES:
        return None
    return mean_rotation(_yaw(-np.arctan2(ahead[:, 1], ahead[:, 0])) @ rotation[flat])


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
