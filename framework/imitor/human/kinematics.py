"""From a choreography to the poses of all segments, for the whole clip at once.

The pelvis carries the legs and the thorax, the thorax neck and arms. The legs are two-bone chains solved
from hip and ankle, the knee pointing where pelvis and foot point; the arms follow their angles, or a hand's
target the same way. The spine bends where it leaves the pelvis, so that the length of the torso is constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.human import rotations as rot
from imitor.human.body import Body
from imitor.human.choreography import SIGN, Arm, Choreography, Foot, Reach
from imitor.human.trajectories import lower_envelope
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array

KNEE_AT_REST: Final = np.radians(9.0)
"""The knees are never straighter than this: where the leg is straight its joint angle would jump [rad]."""
_FORESIGHT_S: Final = 0.18
"""How long before and after a leg asks for it the pelvis is lowered, in authored time [s]."""


@dataclass
class Poses:
    """Positions (T, R, 3) [m] and orientations (T, R, 3, 3) of all roles in world."""

    position: Array
    orientation: Array

    @classmethod
    def empty(cls, n: int) -> Poses:
        """Return unfilled arrays for ``n`` frames."""
        return cls(np.empty((n, N_ROLES, 3)), np.empty((n, N_ROLES, 3, 3)))

    def put(self, role: str, position: Array, orientation: Array) -> None:
        """Write one role."""
        self.position[:, ROLE_INDEX[role]] = position
        self.orientation[:, ROLE_INDEX[role]] = orientation

    def __getitem__(self, role: str) -> tuple[Array, Array]:
        return self.position[:, ROLE_INDEX[role]], self.orientation[:, ROLE_INDEX[role]]


class Figure:
    """The moving body of a choreography; what does not depend on the pelvis' place is computed once."""

    def __init__(self, score: Choreography) -> None:
        self.score = score
        self.body = score.body
        self.poses = Poses.empty(len(score.time))
        self.R_pelvis = rot.yaw_pitch_roll(score.pelvis)
        self.R_thorax = self.R_pelvis @ rot.yaw_pitch_roll(score.spine)
        self.R_neck = self.R_thorax @ rot.yaw_pitch_roll(0.4 * score.head)
        self.R_head = self.R_thorax @ rot.yaw_pitch_roll(score.head)
        dt = score.time[1] - score.time[0]
        self._window = round(_FORESIGHT_S / float(dt))
        self._arms = {side: _arm_rotations(score.arms[side], SIGN[side], self.R_thorax) for side in SIDES}
        for side in SIDES:
            _place_foot(self.poses, self.body, side, score.feet[side])
        self._hips = {s: rot.apply(self.R_pelvis, self.body.offset("pelvis", f"{s}_hip")) for s in SIDES}

    def place(self, pelvis_xy: Array) -> Poses:
        """Compute all poses with the pelvis over ``pelvis_xy`` (T, 2) [m]; the next call reuses arrays."""
        poses, body, score = self.poses, self.body, self.score
        pelvis = np.column_stack([pelvis_xy, self._pelvis_height(pelvis_xy)])
        poses.put("pelvis", pelvis, self.R_pelvis)
        for role, rotation in (("chest", self.R_thorax), ("neck", self.R_neck)):
            poses.put(role, pelvis + rot.apply(self.R_thorax, body.offset("pelvis", role)), rotation)
        neck = poses["neck"][0]
        head = neck + rot.apply(self.R_neck, body.offset("neck", "head"))
        poses.put("head", head, self.R_head)
        poses.put("head_top", head + rot.apply(self.R_head, body.offset("head", "head_top")), self.R_head)
        for side in SIDES:
            self._leg(side, pelvis + self._hips[side])
            shoulder = pelvis + rot.apply(self.R_thorax, body.offset("pelvis", f"{side}_shoulder"))
            self._arm(side, shoulder, score.reaches.get(side))
        return poses

    def _pelvis_height(self, xy: Array) -> Array:
        """Lower the pelvis as authored, and as far as the legs ask for where the feet are apart."""
        length = _longest(self.body.length("thigh"), self.body.length("shank"))
        ceiling = np.full(len(xy), np.inf)
        for side in SIDES:
            ankle = self.poses[f"{side}_ankle"][0]
            hip = self._hips[side]
            away = xy + hip[:, :2] - ankle[:, :2]
            # a foot far out of reach must show as a pelvis far too low, not as a NaN
            room = length**2 - np.einsum("ti,ti->t", away, away)
            ceiling = np.minimum(
                ceiling, ankle[:, 2] - hip[:, 2] + np.sqrt(np.maximum(room, (0.2 * length) ** 2))
            )
        return lower_envelope(ceiling, self._window) - self.score.drop

    def _leg(self, side: str, hip: Array) -> None:
        poses, body = self.poses, self.body
        ankle = poses[f"{side}_ankle"][0]
        turn = self.score.feet[side].yaw - self.score.pelvis[:, 0]
        along = rot.unit(ankle - hip)
        forward = _knee_forward(np.einsum("tji,tj->ti", self.R_pelvis, along), turn)
        forward = rot.apply(self.R_pelvis, forward)
        knee = _bend(hip, ankle, along, forward, (body.length("thigh"), body.length("shank")))
        hinge = np.asarray(np.cross(forward, along))
        poses.put(f"{side}_hip", hip, _hung(hip, knee, hinge))
        poses.put(f"{side}_knee", knee, _hung(knee, ankle, hinge))

    def _arm(self, side: str, shoulder: Array, reach: Reach | None) -> None:
        poses, body = self.poses, self.body
        R_upper, R_fore, R_hand = self._arms[side]
        upper, fore = (
            body.offset(f"{side}_shoulder", f"{side}_elbow"),
            body.offset(f"{side}_elbow", f"{side}_wrist"),
        )
        palm = body.offset(f"{side}_wrist", f"{side}_hand")
        elbow = shoulder + rot.apply(R_upper, upper)
        wrist = elbow + rot.apply(R_fore, fore)
        if reach is not None:
            share = reach.share
            R_target = rot.about_z(reach.yaw)
            goal = reach.hand - rot.apply(R_target, palm)
            target = _within_reach(
                shoulder,
                wrist + share[:, None] * (goal - wrist),
                body.length("upper_arm") + body.length("forearm"),
            )
            along = rot.unit(target - shoulder)
            own = rot.unit(_across(elbow - shoulder, rot.unit(wrist - shoulder)))
            pole = own + share[:, None] * (reach.pole - own)
            pole = rot.unit(_across(pole, along))
            elbow = _bend(shoulder, target, along, pole, (body.length("upper_arm"), body.length("forearm")))
            wrist = target
            hinge = np.asarray(np.cross(pole, along))
            R_upper = _outstretched(shoulder, elbow, hinge, SIGN[side])
            R_fore = _outstretched(elbow, wrist, hinge, SIGN[side])
            R_hand = rot.blend(R_hand, R_target, share)
        poses.put(f"{side}_shoulder", shoulder, R_upper)
        poses.put(f"{side}_elbow", elbow, R_fore)
        poses.put(f"{side}_wrist", wrist, R_hand)
        poses.put(f"{side}_hand", wrist + rot.apply(R_hand, palm), R_hand)


def _longest(first: float, second: float) -> float:
    """Return the distance of a two-bone chain's ends when it is as straight as it may be."""
    return float(np.sqrt(first**2 + second**2 + 2 * first * second * np.cos(KNEE_AT_REST)))


def _within_reach(start: Array, end: Array, length: float) -> Array:
    """Draw ``end`` in where it is farther from ``start`` than an arm that is nearly straight, smoothly."""
    free, room = 0.955 * length, 0.04 * length
    v = end - start
    distance = np.sqrt(np.einsum("ti,ti->t", v, v))
    excess = np.maximum(distance - free, 0.0)
    return np.asarray(
        start + v * (np.minimum(distance, free) + room * np.tanh(excess / room))[:, None] / distance[:, None]
    )


def _across(v: Array, axis: Array) -> Array:
    """Return the part of ``v`` that is orthogonal to the unit vectors ``axis``."""
    return np.asarray(v - np.einsum("ti,ti->t", v, axis)[:, None] * axis)


def _bend(start: Array, end: Array, along: Array, side: Array, bones: tuple[float, float]) -> Array:
    """Return the middle joint of a two-bone chain that bends towards the unit vectors ``side``."""
    first, second = bones
    distance = np.einsum("ti,ti->t", end - start, along)
    foot = (first**2 - second**2 + distance**2) / (2 * distance)
    height = np.sqrt(np.maximum(first**2 - foot**2, 0.0))
    return np.asarray(start + foot[:, None] * along + height[:, None] * side)


def _knee_forward(along: Array, turn: Array) -> Array:
    """Return the direction in which the knee points, in the pelvis' frame: +x turned with the leg.

    The leg's swing from straight down is the smallest rotation there is, so the knee follows without
    twisting; ``turn`` adds the foot's yaw against the pelvis.
    """
    v = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    w = np.column_stack([along[:, 1], -along[:, 0], np.zeros_like(turn)])  # (0, 0, -1) x along
    wv = np.cross(w, v)
    return np.asarray(v + wv + np.cross(w, wv) / (1.0 - along[:, 2])[:, None])


def _hung(start: Array, end: Array, hinge: Array) -> Array:
    """Return rotations of a leg segment: -z along the segment, y along the hinge."""
    z = rot.unit(start - end)
    return np.stack([np.cross(hinge, z), hinge, z], axis=2)


def _outstretched(start: Array, end: Array, hinge: Array, sign: float) -> Array:
    """Return rotations of an arm segment: y (left) or -y (right) along it, the elbow's axis along -z or z."""
    y = sign * rot.unit(end - start)
    z = -sign * hinge
    return np.stack([np.cross(y, z), y, z], axis=2)


def _arm_rotations(arm: Arm, sign: float, R_thorax: Array) -> tuple[Array, Array, Array]:
    """Return the rotations of upper arm, forearm and hand in world."""
    zero = np.zeros_like(arm.flexion)
    swing = rot.exponential(np.column_stack([sign * arm.abduction, -arm.flexion, zero]))
    hang = rot.about_x(np.array([-sign * np.pi / 2]))
    R_upper = R_thorax @ swing @ rot.about_z(-sign * arm.twist) @ hang
    R_fore = R_upper @ rot.about_z(-sign * arm.elbow)
    R_hand = R_fore @ rot.about_y(arm.pronation) @ rot.about_x(-sign * arm.wrist)
    return R_upper, R_fore, R_hand


def _place_foot(poses: Poses, body: Body, side: str, foot: Foot) -> None:
    """Write the roles of a foot: it pitches about the ball, and the toes stay level while the heel rises."""
    ankle_to = {part: body.offset(f"{side}_ankle", f"{side}_{part}") for part in ("heel", "toe")}
    R_yaw = rot.about_z(foot.yaw)
    R_foot = R_yaw @ rot.about_y(foot.heel_up - foot.toes_up)
    # the toes give way as far as their joint allows, then follow the foot
    give = np.radians(35.0) * np.tanh(foot.heel_up / np.radians(35.0))
    R_toe = R_foot @ rot.about_y(-give)
    ball = np.column_stack([foot.place, np.zeros(len(foot.yaw))]) + rot.apply(
        R_yaw, np.array([ankle_to["toe"][0], 0.0, 0.0])
    )
    heel_to_ball = ankle_to["toe"][0] - ankle_to["heel"][0]
    ball[:, 2] = ankle_to["toe"][2] - ankle_to["heel"][2] + foot.lift + heel_to_ball * np.sin(foot.toes_up)
    ankle = ball - rot.apply(R_foot, ankle_to["toe"])
    # a foot in contact stands exactly, to the last bit
    flat = foot.contact
    ankle[flat, 2] = body.rest[ROLE_INDEX[f"{side}_ankle"], 2]
    poses.put(f"{side}_ankle", ankle, R_foot)
    poses.put(f"{side}_heel", ankle + rot.apply(R_foot, ankle_to["heel"]), R_foot)
    poses.put(f"{side}_toe", ball, R_toe)
    tip = ball + rot.apply(R_toe, body.offset(f"{side}_toe", f"{side}_toe_tip"))
    poses.put(f"{side}_toe_tip", tip, R_toe)
