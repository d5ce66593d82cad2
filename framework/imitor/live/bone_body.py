"""The person in a stream of bones, a tree of named joints whose rest pose is that of an avatar or of a calibration.

A skeleton card says which bone is which part of the body. The rest pose is where every rotation is the identity, or a
T-pose that the person takes at the start; it is straightened as that of a recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.errors import ImitorError
from imitor.live.body_options import BodyConfig, as_received
from imitor.live.segment_body import SegmentBody
from imitor.motion.bvh_hierarchy import Node
from imitor.motion.kinematics import ancestry
from imitor.motion.normalise import choose_floor, find_stance, foot_heights, handedness, role
from imitor.motion.recording import stature
from imitor.motion.rest_pose import (
    Motion,
    Reference,
    is_t_pose,
    is_upright,
    mean_rotation,
    rest_positions,
    rest_rotations,
)
from imitor.motion.rig import Rig
from imitor.motion.skeletons import RolePoint, SkeletonFit
from imitor.types import ROLE_INDEX, ROLES, SIDES, Array, BoolArray, Skeleton

_LEAST_FRAMES: Final = 3
_MIRRORED: Final = -0.3


@dataclass(frozen=True)
class Bones:
    """What was seen of a tree of bones, in a world with z up and x where an avatar at rest faces.

    Attributes:
        nodes: The tree, parents before children; offsets in the parent's axes [m].
        position: Origins of the bones, shape (T, S, 3) [m]; NaN where lost.
        rotation: World from bone, shape (T, S, 3, 3).
    """

    nodes: Sequence[Node]
    position: Array
    rotation: Array


def learn_bones(
    seen: Bones, fit: SkeletonFit, rate_hz: float, options: BodyConfig, *, t_pose: bool, scaled: bool
) -> tuple[SegmentBody, Skeleton]:
    """Return the body that some bones show.

    Args:
        seen: The tree and its first instants.
        fit: Which bone is which role.
        rate_hz: Instants a second [Hz].
        options: What the user says about the person.
        t_pose: Whether the rest pose is a T-pose in those instants; else where every rotation is the identity.
        scaled: Whether the bones are an avatar's, to be brought to ``options.height_m``.

    Raises:
        ImitorError: The body is never whole, or there is no rest pose; says what to do.
    """
    rig = Rig(seen.nodes, fit.points)
    position, rotation = _whole(seen, rig)
    roles = rig.roles(position)
    reference = _t_pose(position, rotation, roles) if t_pose else _identity(seen.nodes, rig)
    notes = [f"skeleton: {fit.name} ({fit.card.title})"] + ([fit.card.notes] if fit.card.notes else [])
    notes.append("rest pose: " + ("the T-pose at the start" if t_pose else "where no bone is turned"))

    def rest(flat: BoolArray) -> tuple[Array, Array]:
        turns = rest_rotations(rig, reference, Motion(rotation, roles, flat))
        return turns, rest_positions(rig, reference, turns)

    size = stature(rest(np.zeros((len(roles), 2), dtype=np.bool_))[1])
    if not 0.0 < size < np.inf:
        raise ImitorError("the bones have no length: are all their positions zero?")
    scale = options.height_m / size if scaled and options.height_m else 1.0
    height_m = options.height_m or size
    notes.append(f"stature {height_m:.2f} m" + (f", scaled by {scale:.3f}" if scale != 1.0 else ""))
    roles = roles * scale
    stance = find_stance(roles, rate_hz, height_m)
    turns, rest_position = rest(stance.flat)
    rest_position = rest_position * scale
    floor, why = choose_floor(stance, options.recorded_floor)
    notes.append(why)
    ankle_m, toe_m = foot_heights(stance, floor, height_m)
    rest_position[:, 2] += ankle_m - np.mean([role(rest_position, f"{s}_ankle")[2] for s in SIDES])
    if handedness(rest_position) < _MIRRORED:
        raise ImitorError(
            "left and right are swapped: the feet point backwards if the names of the bones are right"
        )

    whole = np.tile(np.eye(3), (len(seen.nodes), 1, 1))
    whole[rig.chain] = turns
    body = SegmentBody(_places(fit), whole, scale=scale)
    body.floor_m = floor
    known: BoolArray = np.asarray(np.isfinite(rest_position).all(axis=-1))
    skeleton = Skeleton(
        name=fit.name,
        roles=frozenset(name for name in ROLES if known[ROLE_INDEX[name]]),
        rest_position=rest_position,
        height_m=height_m,
        ankle_height_m=ankle_m,
        toe_height_m=toe_m,
        mass_kg=options.mass_kg,
        sex=options.sex,
        notes=tuple(notes),
    )
    return body, as_received(skeleton)


def _whole(seen: Bones, rig: Rig) -> tuple[Array, Array]:
    """Return position (T, W, 3) and rotation (T, W, 3, 3) of the rig's bones in the instants that show them all."""
    position, rotation = seen.position[:, rig.chain], seen.rotation[:, rig.chain]
    there: BoolArray = np.asarray(np.isfinite(position).all(axis=2) & np.isfinite(rotation).all(axis=(2, 3)))
    whole: BoolArray = np.asarray(there.all(axis=1))
    if whole.sum() < _LEAST_FRAMES:
        worst = [seen.nodes[rig.chain[i]].name for i in np.argsort(there.mean(axis=0), kind="stable")[:3]]
        raise ImitorError(
            f"the whole body was seen in {whole.sum()} of {len(whole)} instants at the start; most seldom seen: "
            f"{', '.join(worst)}. Step into view, or set learn_s higher"
        )
    return position[whole], rotation[whole]


def _identity(nodes: Sequence[Node], rig: Rig) -> Reference:
    """Return the pose in which no bone is turned."""
    place = np.zeros((len(nodes), 3))
    for i in ancestry(nodes, range(len(nodes))):
        if nodes[i].parent >= 0:
            place[i] = place[nodes[i].parent] + nodes[i].offset
    position = place[rig.chain]
    roles = rig.roles(position[None])[0]
    if not is_upright(roles):
        raise ImitorError(
            "where no bone is turned, the bones are no upright human: set rest: t_pose, and stand in a T-pose while "
            "the person is learned (learn_s)"
        )
    return Reference("zero", position, np.tile(np.eye(3), (len(position), 1, 1)), roles)


def _t_pose(position: Array, rotation: Array, roles: Array) -> Reference:
    """Return the T-pose in some instants: the mean of those that are one."""
    posed = np.flatnonzero([is_t_pose(r) for r in roles])
    if not len(posed):
        raise ImitorError(
            f"none of {len(roles)} instants at the start is a T-pose; stand upright with both arms straight out to the "
            "sides when the run starts, or set learn_s higher"
        )
    middle = posed[len(posed) // 2]
    turns = np.stack([mean_rotation(rotation[posed, i]) for i in range(rotation.shape[1])])
    return Reference("tpose", position[middle], turns, roles[middle])


def _places(fit: SkeletonFit) -> dict[str, RolePoint]:
    """Return role to place; the pelvis is the middle of the hips, unless its place is a line of its own."""
    points = dict(fit.points)
    pelvis, left, right = (points[r] for r in ("pelvis", "left_hip", "right_hip"))
    if pelvis.start == pelvis.end:
        points["pelvis"] = RolePoint(left.start, right.start, 0.5, pelvis.turns_with)
    return points


__all__ = ["Bones", "learn_bones"]
