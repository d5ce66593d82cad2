"""The human as a stick figure: which points are joined, how thick, in which colour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.types import ROLE_INDEX, Array, BoolArray

Colour = tuple[float, float, float]

MIDDLE: Final[Colour] = (0.55, 0.61, 0.69)
LEFT: Final[Colour] = (0.38, 0.59, 0.79)
RIGHT: Final[Colour] = (0.86, 0.60, 0.52)
"""Blue-grey trunk; the left limbs cooler, the right limbs warmer. Red, green, blue in 0 to 1."""

_CHAINS: Final[tuple[tuple[str, ...], ...]] = (
    ("pelvis", "chest", "neck", "head"),
    ("neck|chest|head", "left_shoulder", "left_elbow", "left_wrist", "left_hand"),
    ("neck|chest|head", "right_shoulder", "right_elbow", "right_wrist", "right_hand"),
    ("pelvis", "left_hip", "left_knee", "left_ankle", "left_toe", "left_toe_tip"),
    ("pelvis", "right_hip", "right_knee", "right_ankle", "right_toe", "right_toe_tip"),
    ("left_ankle", "left_heel", "left_toe"),
    ("right_ankle", "right_heel", "right_toe"),
)
"""Points joined one after the other; a point that is not known is left out, ``a|b`` is the first one known."""

_THICK: Final = {"hip": 0.056, "knee": 0.052, "ankle": 0.042, "shoulder": 0.050, "elbow": 0.043, "wrist": 0.035}
_MIDDLE_RADIUS: Final = 0.058
_THIN_RADIUS: Final = 0.028
HEAD_RADIUS: Final = 0.095  # [m]


@dataclass(frozen=True)
class Stick:
    """The stick figure of one recording.

    Attributes:
        bones: Pairs of role indices, shape (B, 2).
        bone_radius: shape (B,) [m]; ``bone_colour`` (B, 3) in 0 to 1.
        joints: Role indices of the drawn joints, shape (J,).
        joint_radius: shape (J,) [m]; ``joint_colour`` (J, 3) in 0 to 1.
    """

    bones: np.ndarray
    bone_radius: Array
    bone_colour: Array
    joints: np.ndarray
    joint_radius: Array
    joint_colour: Array


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
        for a, b in zip(present, present[1:], strict=False):
            bones.append((ROLE_INDEX[a], ROLE_INDEX[b]))
            names.append(b)
    joints = list(dict.fromkeys(i for bone in bones for i in bone if i != ROLE_INDEX["head"]))
    roles = list(ROLE_INDEX)
    return Stick(
        bones=np.array(bones, dtype=np.int32).reshape(-1, 2),
        bone_radius=np.array([0.72 * _radius(n) for n in names]),
        bone_colour=np.array([_colour(n) for n in names]).reshape(-1, 3),
        joints=np.array(joints, dtype=np.int32),
        joint_radius=np.array([_radius(roles[j]) for j in joints]),
        joint_colour=0.80 * np.array([_colour(roles[j]) for j in joints]).reshape(-1, 3),
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


def _colour(role: str) -> Colour:
    return LEFT if role.startswith("left_") else RIGHT if role.startswith("right_") else MIDDLE


def _radius(role: str) -> float:
    side, _, part = role.partition("_")
    return _THICK.get(part, _THIN_RADIUS) if side in ("left", "right") else _MIDDLE_RADIUS
