"""Perform a choreography: find the pelvis' course that carries the CoM along its path; the ground truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from imitor.errors import ImitorError
from imitor.human import masses
from imitor.human.body import Body
from imitor.human.choreography import Choreography
from imitor.human.kinematics import Figure
from imitor.types import ROLE_INDEX, ROLES, SIDES, Array, BoolArray, read_only

_ROUNDS: Final = 6
_GAIN: Final = 1.15
"""Fixed-point rounds: the CoM follows the pelvis by about 0.85; each leaves a few per cent of the error."""


@dataclass(frozen=True)
class Truth:
    """Exact ground truth of a performance; all arrays are read-only.

    Attributes:
        time_s: Times (T,) [s].
        position: Role positions in world (T, R, 3) [m].
        orientation: Segment orientations in world (T, R, 3, 3); the identity in the rest pose.
        support: Feet in contact (T, 2), left and right.
        com: Centre of mass (T, 3) [m], by [deleva1996].
        joint_angle: Anatomical angles by name, each (T,) [rad].
        marker: Marker positions (T, M, 3) [m], when asked for.
        target: Poses of rigid targets (T, K, 4, 4), when asked for.
        handle: Pose of the handle that the hands hold (T, 4, 4), and ``grasped`` (T,); scenarios with a
            handle.
    """

    time_s: Array
    position: Array
    orientation: Array
    support: BoolArray
    com: Array
    joint_angle: Mapping[str, Array]
    marker: Array | None = None
    target: Array | None = None
    handle: Array | None = None
    grasped: BoolArray | None = None

    def frozen(self) -> Truth:
        """Switch the write flag of every array off."""
        for value in (*vars(self).values(), *self.joint_angle.values()):
            if isinstance(value, np.ndarray):
                read_only(value)
        return self


def perform(score: Choreography, time_s: Array) -> Truth:
    """Build the motion of a choreography.

    Args:
        score: The channels.
        time_s: Times of the frames as published (T,) [s].

    Raises:
        ImitorError: A foot or hand is led where legs and arms of these lengths cannot reach.
    """
    figure = Figure(score)
    weights = masses.full_weights(score.body.sex)
    pelvis = score.com.copy()
    for _ in range(_ROUNDS):
        poses = figure.place(pelvis)
        com = np.tensordot(poses.position, weights, axes=(1, 0))
        pelvis = pelvis + _GAIN * (score.com - com[:, :2])
    poses = figure.place(pelvis)
    _check_reach(poses.position, score.body, time_s)
    return Truth(
        time_s=time_s,
        position=poses.position,
        orientation=poses.orientation,
        support=np.column_stack([score.feet[side].contact for side in SIDES]),
        com=np.asarray(np.tensordot(poses.position, weights, axes=(1, 0))),
        joint_angle=joint_angles(poses.orientation),
        handle=score.handle,
        grasped=score.grasped,
    )


def _check_reach(position: Array, body: Body, time_s: Array) -> None:
    longest = body.length("thigh") + body.length("shank")
    for side in SIDES:
        leg = position[:, ROLE_INDEX[f"{side}_ankle"]] - position[:, ROLE_INDEX[f"{side}_hip"]]
        reach = np.sqrt(np.einsum("ti,ti->t", leg, leg))
        if reach.max() > longest:
            i = int(reach.argmax())
            raise ImitorError(
                f"performer: at t={time_s[i]:.2f} s the {side} foot would be {reach[i]:.2f} m from the hip, "
                f"but the leg is {longest:.2f} m long; ask for shorter steps (step_length_m) or a taller "
                f"performer (height_m)"
            )
        upper, fore = body.length("upper_arm"), body.length("forearm")
        arm = position[:, ROLE_INDEX[f"{side}_wrist"]] - position[:, ROLE_INDEX[f"{side}_shoulder"]]
        reach = np.sqrt(np.einsum("ti,ti->t", arm, arm))
        if reach.min() < abs(upper - fore) - 1e-9:
            i = int(reach.argmin())
            raise ImitorError(
                f"performer: at t={time_s[i]:.2f} s the {side} wrist would be {reach[i]:.2f} m from the "
                f"shoulder, but upper arm {upper:.2f} m and forearm {fore:.2f} m cannot fold that far; "
                "make them more alike (segment_ratios)"
            )


_MIRROR: Final = np.array([1.0, -1.0, 1.0])


def _swapped(role: str) -> str:
    side, _, part = role.partition("_")
    return {"left": f"right_{part}", "right": f"left_{part}"}.get(side, role)


_SWAP: Final = np.array([ROLE_INDEX[_swapped(role)] for role in ROLES])


def mirrored(truth: Truth) -> Truth:
    """Return the motion as a mirror in the x-z plane shows it: left and right change places."""
    flip = np.outer(_MIRROR, _MIRROR)
    handle = truth.handle
    if handle is not None:
        handle = handle.copy()
        handle[:, :3, :3] *= flip
        handle[:, :3, 3] *= _MIRROR
    orientation = truth.orientation[:, _SWAP] * flip
    return replace(
        truth,
        position=truth.position[:, _SWAP] * _MIRROR,
        orientation=orientation,
        support=truth.support[:, ::-1].copy(),
        com=truth.com * _MIRROR,
        joint_angle=joint_angles(orientation),
        handle=handle,
    )


def joint_angles(orientation: Array) -> dict[str, Array]:
    """Return anatomical angles from segment orientations (T, R, 3, 3), each (T,) [rad].

    Hinges are exact; a hip gives the elevation of the thigh forwards and sideways in the pelvis' frame; a
    shoulder the angle between upper arm and the trunk's downward axis.
    """

    def between(parent: str, child: str) -> Array:
        P, C = orientation[:, ROLE_INDEX[parent]], orientation[:, ROLE_INDEX[child]]
        return np.asarray(P.transpose(0, 2, 1) @ C)

    angles: dict[str, Array] = {}
    trunk = between("pelvis", "chest")
    angles["trunk_yaw"] = np.arctan2(trunk[:, 1, 0], trunk[:, 0, 0])
    angles["trunk_pitch"] = np.arcsin(np.clip(-trunk[:, 2, 0], -1, 1))
    angles["trunk_roll"] = np.arctan2(trunk[:, 2, 1], trunk[:, 2, 2])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        thigh = between("pelvis", f"{side}_hip")
        angles[f"{side}_hip_flexion"] = np.arctan2(-thigh[:, 0, 2], thigh[:, 2, 2])
        angles[f"{side}_hip_abduction"] = np.arcsin(np.clip(-sign * thigh[:, 1, 2], -1, 1))
        knee = between(f"{side}_hip", f"{side}_knee")
        angles[f"{side}_knee"] = np.arctan2(knee[:, 0, 2], knee[:, 0, 0])
        ankle = between(f"{side}_knee", f"{side}_ankle")
        angles[f"{side}_ankle_dorsiflexion"] = np.arctan2(ankle[:, 2, 0], ankle[:, 0, 0])
        upper = between("chest", f"{side}_shoulder")
        angles[f"{side}_shoulder_elevation"] = np.arccos(np.clip(-sign * upper[:, 2, 1], -1, 1))
        elbow = between(f"{side}_shoulder", f"{side}_elbow")
        angles[f"{side}_elbow"] = np.arctan2(-sign * elbow[:, 1, 0], elbow[:, 0, 0])
    return angles
