"""The human as a stick figure: which points are joined, how thick, in which colour."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.types import ROLE_INDEX, ROLES, SIDES, Array, BoolArray

Colour = tuple[float, float, float]

HEAD_COLOUR: Final[Colour] = (0.55, 0.61, 0.69)
SIDE_COLOUR: Final[Mapping[str, Colour]] = {
    "middle": HEAD_COLOUR,
    "left": (0.38, 0.59, 0.79),
    "right": (0.86, 0.60, 0.52),
}
"""Blue-grey trunk; the left limbs cooler, the right limbs warmer. Red, green, blue in 0 to 1."""
_JOINT_SHADE: Final = 0.80
"""Joints are this much darker than bones [-]."""

_CHAINS: Final[tuple[tuple[str, ...], ...]] = (
    ("pelvis", "chest", "neck", "head"),
    ("neck|chest|head", "left_shoulder", "left_elbow", "left_wrist", "left_hand"),
    ("neck|chest|head", "right_shoulder", "right_elbow", "right_wrist", "right_hand"),
    ("pelvis", "left_hip", "left_knee", "left_ankle", "left_toe", "left_toe_tip"),
    ("pelvis", "right_hip", "right_knee", "right_ankle", "right_toe", "right_toe_tip"),
    ("left_ankle", "left_heel", "left_toe"),
    ("right_ankle", "right_heel", "right_toe"),
)
"""Points joined one after the other; an unknown one is left out, ``a|b`` is the first one known."""

_LIMB_RADIUS: Final = {
    "hip": 0.056,
    "knee": 0.052,
    "ankle": 0.042,
    "shoulder": 0.050,
    "elbow": 0.043,
    "wrist": 0.035,
}
_MIDDLE_RADIUS: Final = 0.058
_THIN_RADIUS: Final = 0.028
HEAD_RADIUS: Final = 0.095  # [m]


@dataclass(frozen=True)
class Stick:
    """The stick figure of one recording.

    Attributes:
        bones: Pairs of role indices, shape (B, 2).
        bone_radius: shape (B,) [m]; ``bone_colour`` (B, 3) in 0 to 1; ``bone_side``: keys of `SIDE_COLOUR`.
        joints: Role indices of the drawn joints, shape (J,).
        joint_radius: shape (J,) [m]; ``joint_colour`` (J, 3) in 0 to 1; ``joint_side``.
    """

    bones: np.ndarray
    bone_radius: Array
    bone_colour: Array
    bone_side: Sequence[str]
    joints: np.ndarray
    joint_radius: Array
    joint_colour: Array
    joint_side: Sequence[str]


def stick_figure(known: BoolArray) -> Stick:
    """Return the stick figure that joins the known roles.

    Args:
        known: Which roles are ever known, shape (R,), in the order of `imitor.types.ROLES`.
    """
    bones: list[tuple[int, int]] = []
    names: list[str] = []
    for chain in _CHAINS:
        alternatives = [next((r for r in link.split("|") if known[ROLE_INDEX[r]]), "") for link in chain]
        present = [r for r in alternatives if r]
        for a, b in itertools.pairwise(present):
            bones.append((ROLE_INDEX[a], ROLE_INDEX[b]))
            names.append(b)
    joints = list(dict.fromkeys(i for bone in bones for i in bone if i != ROLE_INDEX["head"]))
    drawn = [ROLES[j] for j in joints]
    return Stick(
        bones=np.array(bones, dtype=np.int32).reshape(-1, 2),
        bone_radius=np.array([0.72 * _radius(n) for n in names]),
        bone_colour=np.array([SIDE_COLOUR[_side(n)] for n in names]).reshape(-1, 3),
        bone_side=[_side(n) for n in names],
        joints=np.array(joints, dtype=np.int32),
        joint_radius=np.array([_radius(r) for r in drawn]),
        joint_colour=_JOINT_SHADE * np.array([SIDE_COLOUR[_side(r)] for r in drawn]).reshape(-1, 3),
        joint_side=[_side(r) for r in drawn],
    )


def head_centre(position: Array, valid: BoolArray) -> Array | None:
    """Return the middle of the skull in one frame, shape (3,) [m], or ``None`` when the head is not known.

    Args:
        position: Role positions, shape (R, 3) [m].
        valid: shape (R,).
    """
    head, top = ROLE_INDEX["head"], ROLE_INDEX["head_top"]
    if not valid[head]:
        return None
    if valid[top] and np.linalg.norm(position[top] - position[head]) > HEAD_RADIUS:
        up = position[top] - position[head]
        return np.asarray(position[top] - HEAD_RADIUS * up / np.linalg.norm(up))
    return np.asarray(position[head])


def _side(role: str) -> str:
    side = role.partition("_")[0]
    return side if side in SIDES else "middle"


def _radius(role: str) -> float:
    return (
        _MIDDLE_RADIUS if _side(role) == "middle" else _LIMB_RADIUS.get(role.partition("_")[2], _THIN_RADIUS)
    )
