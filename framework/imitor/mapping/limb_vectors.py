"""Limb vectors: hands from the shoulders, feet from the hips, in axes fixed to chest and waist [koenemann2014] eq. 1.

Order of every four-sided array: left hand, right hand, left foot, right foot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Final

import numpy as np

from imitor.errors import RobotError, SourceError
from imitor.ik.vectors import cross3
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SIDES, Array, HumanFrame, Skeleton

_T_POSE: Final = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
_NEEDED: Final = tuple(
    f"{s}_{r}" for s in SIDES for r in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)


class HumanLimbs:
    """The human's limb vectors, frame by frame.

    The axes of the chest are left: from the right to the left shoulder, up: from mid-hip to mid-shoulder; those of the
    waist the same with the line of the hips. Points alone are used, so every source will do.

    Attributes:
        vectors: Shoulder to hand and hip to ankle, in axes of chest and waist, shape (4, 3) [m].
        seen: Whether each was seen in this frame, shape (4,).
        waist: Rotation of the waist's axes, world from waist, shape (3, 3), and whether it was seen.
        mid_hip: Middle of the hips in world, shape (3,) [m].
    """

    def __init__(self, skeleton: Skeleton) -> None:
        missing = [r for r in _NEEDED if r not in skeleton.roles]
        if missing:
            raise SourceError(
                skeleton.name,
                f"the skeleton has no {', '.join(missing)}; offsets from the T-pose need shoulders, elbows, wrists, "
                "hips, knees and ankles. Map them in the skeleton's card.",
            )
        self._skeleton = skeleton
        self._hand = "hand" if skeleton.has("left_hand", "right_hand") else "wrist"
        index = ROLE_INDEX
        starts = [index[f"{s}_{r}"] for r in ("shoulder", "hip") for s in SIDES]
        ends = [index[f"{s}_{r}"] for r in (self._hand, "ankle") for s in SIDES]
        self._roles = np.array(starts + ends)
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self.vectors = 0.5 * _T_POSE
        self.seen = np.zeros(4, dtype=bool)
        self.waist: Array = np.eye(3)
        self.waist_seen = False
        self.mid_hip: Array = np.zeros(3)

    def take(self, frame: HumanFrame) -> None:
        """Read a human frame."""
        known = frame.valid.take(self._roles)
        starts_known = all(known[:4].tolist())
        self.waist_seen = False
        self.seen = np.zeros(4, dtype=bool)
        if not starts_known:
            return
        points = frame.position.take(self._roles, axis=0)
        trunk = points[:4].reshape(2, 2, 3)  # shoulders and hips, left and right
        middles = 0.5 * (trunk[:, 0] + trunk[:, 1])
        across_chest, across_waist = (trunk[:, 0] - trunk[:, 1]).tolist()
        up = (middles[0] - middles[1]).tolist()
        chest, waist = _axes(across_chest, up), _axes(across_waist, up)
        if chest is None or waist is None:
            return
        axes = np.array(chest + waist).reshape(2, 3, 3)
        self.waist, self.waist_seen, self.mid_hip = axes[1], True, middles[1]
        self.seen = known[4:]
        limbs = points[4:] - points[:4]
        if self.seen.all():
            self.vectors = (limbs.reshape(2, 2, 3) @ axes).reshape(4, 3)
        else:
            limbs[~self.seen] = 0.0
            seen = (limbs.reshape(2, 2, 3) @ axes).reshape(4, 3)
            self.vectors = np.where(self.seen[:, None], seen, self.vectors)

    def t_pose_of_lengths(self) -> Array:
        """Return the T-pose that the segments of the rest pose make: arms sideways, legs straight, shape (4, 3) [m]."""
        at = self._skeleton.rest_position
        lengths = []
        for chain in (
            ("shoulder", "elbow", "wrist", "hand")[: 4 if self._hand == "hand" else 3],
            ("hip", "knee", "ankle"),
        ):
            for side in SIDES:
                points = np.array([at[ROLE_INDEX[f"{side}_{r}"]] for r in chain])
                lengths.append(float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
        if not np.isfinite(lengths).all():
            raise SourceError(
                self._skeleton.name,
                "the skeleton's rest pose lacks limbs, so their lengths are not known; set calibration to `given`",
            )
        return np.asarray(_T_POSE * np.array(lengths)[:, None])


def looks_like_t_pose(vectors: Array, angle: float) -> bool:
    """Tell whether arms point sideways and legs down, within an angle [rad]."""
    length = np.linalg.norm(vectors, axis=1)
    return bool((np.einsum("ij,ij->i", vectors, _T_POSE) >= np.cos(angle) * length).all()) and bool(
        (length > 0).all()
    )


def _axes(left: Sequence[float], up: Sequence[float]) -> tuple[float, ...] | None:
    """Return the rotation with y along a line and z as near as can be to ``up``, its nine entries row by row."""
    forward = cross3(left, up)
    y_norm, x_norm = hypot(*left), hypot(*forward)
    if not (y_norm > 1e-6 and x_norm > 1e-3 * y_norm):
        return None
    y = y0, y1, y2 = left[0] / y_norm, left[1] / y_norm, left[2] / y_norm
    x = x0, x1, x2 = forward[0] / x_norm, forward[1] / x_norm, forward[2] / x_norm
    z0, z1, z2 = cross3(x, y)
    return x0, y0, z0, x1, y1, z1, x2, y2, z2


@dataclass(frozen=True)
class Limb:
    """One limb of the robot: its task's name, its end, and the link that carries it."""

    name: str
    start: str
    end: str
    carrier: str


class RobotLimbs:
    """The robot's limb vectors in its T-pose.

    Attributes:
        limbs: Left hand, right hand, left foot, right foot.
        origin: Shoulders and hips in axes of chest and waist, shape (4, 3) [m].
        reference: Limb vectors in the T-pose, shape (4, 3) [m]: from the card's reference vectors where the robot
            cannot reach one, else from its T-pose; legs straight down to the sole.
        standing: Limb vectors when standing, shape (4, 3) [m].
        mid_hip: Middle of the hips relative to the waist, shape (3,) [m].
    """

    def __init__(self, robot: RobotModel, reach: float, leg_reach: float) -> None:
        hand = "hand" if robot.has("left_hand", "right_hand") else "wrist"
        self.limbs = [Limb(f"{s}_hand", f"{s}_shoulder", f"{s}_{hand}", "chest") for s in SIDES]
        self.limbs += [Limb(f"{s}_foot", f"{s}_hip", f"{s}_foot", "waist") for s in SIDES]
        lacking = [r for limb in self.limbs for r in (limb.start, limb.end, limb.carrier) if not robot.has(r)]
        if lacking:
            raise RobotError(
                f"robot '{robot.name}' has no {', '.join(lacking)}: name them in its card's roles"
            )
        lengths = robot.segment_lengths()  # leaves the robot standing
        self.origin = np.array([_seen_from(robot, limb.carrier, limb.start) for limb in self.limbs])
        self.standing = (
            np.array([_seen_from(robot, limb.carrier, limb.end) for limb in self.limbs]) - self.origin
        )
        self.mid_hip = self.origin[2:].mean(axis=0)
        q = robot.standing.copy()
        q[7:] = robot.joint_values(robot.card.t_pose)
        robot.update(q)
        self.reference = (
            np.array([_seen_from(robot, limb.carrier, limb.end) for limb in self.limbs]) - self.origin
        )
        robot.update(robot.standing)
        self._use_card_vectors(robot, lengths)
        arm, leg = [], []
        for side in SIDES:
            arm.append(sum(lengths.get(f"{side}_{s}", 0.0) for s in ("upper_arm", "forearm", "hand")))
            leg.append(
                sum(lengths.get(f"{side}_{s}", 0.0) for s in ("thigh", "shank")) + lengths["ankle_height"]
            )
        self.reference[2:] = _T_POSE[2:] * np.array(leg)[:, None]
        self._most = [*(reach * a for a in arm), *(leg_reach * length for length in leg)]

    def _use_card_vectors(self, robot: RobotModel, lengths: dict[str, float]) -> None:
        vectors = robot.card.reference_vectors
        if {"upper_arm", "forearm"} - vectors.keys():
            return
        for i, side in enumerate(SIDES):
            mirror = np.array([1.0, 1.0 - 2.0 * i, 1.0])
            fore = lengths[f"{side}_forearm"] + lengths.get(f"{side}_hand", 0.0)
            upper_arm, forearm = np.array(vectors["upper_arm"]), np.array(vectors["forearm"])
            self.reference[i] = mirror * (lengths[f"{side}_upper_arm"] * upper_arm + fore * forearm)

    def within_reach(self, vectors: Array) -> Array:
        """Return limb vectors no longer than the robot's limbs are used, shape (4, 3) [m]."""
        lengths = [hypot(*v) for v in vectors.tolist()]
        shares = [
            min(1.0, most / max(length, 1e-9)) for length, most in zip(lengths, self._most, strict=True)
        ]
        return np.asarray(vectors * np.array(shares)[:, None])


def _seen_from(robot: RobotModel, carrier: str, role: str) -> Array:
    """Return a role's place in the axes of another at the last update, shape (3,) [m]."""
    return np.asarray((robot.position(role) - robot.position(carrier)) @ robot.rotation(carrier))
