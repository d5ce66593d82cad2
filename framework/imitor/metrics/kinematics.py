"""Forward kinematics of a whole motion at once, for measuring only.

Nothing here is shared with the solvers: the model file is read afresh, its constants are taken out, and every
joint is moved for all frames together by numpy. So the measured quality of a motion does not rest on the code
that made it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imitor.errors import RobotError, UnknownJoint, UnknownLink
from imitor.record import Motion
from imitor.robot.card import RobotCard, expand
from imitor.robot.files import ModelFiles
from imitor.types import SIDES, Array

BASE = 1
"""Index of the floating base among the joints; 0 is the world."""


def fresh_model(card: RobotCard, files: ModelFiles) -> Any:
    """Read the robot's file into a new Pinocchio model with a floating base and every joint in it.

    Raises:
        RobotError: The file cannot be read.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import pinocchio as pin

    try:
        if not files.is_mjcf:
            return pin.buildModelFromUrdf(str(files.model), pin.JointModelFreeFlyer())
        model = pin.buildModelFromMJCF(str(files.model))
        if model.njoints < 2 or model.joints[BASE].nq != 7:
            model = pin.buildModelFromMJCF(str(files.model), pin.JointModelFreeFlyer())
        model.jointPlacements[BASE] = pin.SE3.Identity()  # q is the base in world, wherever the file puts it
        return model
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"robot '{card.name}': {files.model} cannot be read as a robot: {error}") from None


@dataclass(frozen=True)
class Trajectory:
    """Where the robot's points are, T frames, world frame.

    Attributes:
        point: Role -> position, shape (T, 3) [m]; ``mid_hip`` and ``mid_shoulder`` are middles.
        sole: Corners of the left and of the right sole, shape (T, 2, K, 3) [m].
        com: Centre of mass, shape (T, 3) [m].
    """

    point: Mapping[str, Array]
    sole: Array
    com: Array

    @property
    def sole_centre(self) -> Array:
        """Mean of each sole's corners, shape (T, 2, 3) [m]."""
        return np.asarray(self.sole.mean(axis=2))


class Kinematics:
    """The constants of a robot's model and what moves its points.

    Args:
        card: The robot's card: roles, soles, locked joints.
        model: A model from `fresh_model`.
    """

    def __init__(self, card: RobotCard, model: Any) -> None:
        self.card = card
        self.joint_names: list[str] = list(model.names)
        self._parent = [int(p) for p in model.parents]
        self._offset = [_split(p) for p in model.jointPlacements]
        self._axis = [_axis(joint) for joint in model.joints]
        self._mass = np.array([i.mass for i in model.inertias])
        self._mass[0] = 0.0  # what is fixed to the world does not move with the robot
        self._lever = np.array([i.lever for i in model.inertias])
        self._anchor = {
            f.name: (int(f.parentJoint), *_split(f.placement)) for f in reversed(list(model.frames))
        }
        self.locked = {name: float(value) for name, value in expand(card.locked).items()}
        self._zero = self._poses(1, np.zeros((1, 3)), np.eye(3)[None], {})

    def follow(self, motion: Motion) -> Trajectory:
        """Return the points of the robot in every frame of a motion.

        Raises:
            UnknownJoint: The motion names a joint that the robot does not have.
            RobotError: It leaves out a joint that the card does not lock.
        """
        for name in motion.joint_names:
            if name not in self.joint_names[BASE + 1 :]:
                raise UnknownJoint(self.card.name, name, self.joint_names[BASE + 1 :], "motion.joint_names")
        angle: dict[str, Array] = {n: np.full(len(motion), v) for n, v in self.locked.items()}
        angle.update(
            zip(motion.joint_names, np.asarray(motion.joint_position_rad, dtype=float).T, strict=True)
        )
        missing = [n for n in self.joint_names[BASE + 1 :] if n not in angle]
        if missing:
            raise RobotError(
                f"the motion has no positions for {', '.join(missing)} of robot '{self.card.name}'"
            )
        rotation = rotations_of(motion.root_quaternion_wxyz)
        poses = self._poses(len(motion), np.asarray(motion.root_position_m, dtype=float), rotation, angle)
        return Trajectory(self._points(poses), self._soles(poses), self._com(poses))

    def _poses(
        self, n: int, position: Array, rotation: Array, angle: Mapping[str, Array]
    ) -> list[tuple[Array, Array]]:
        """Return world from joint, rotation (T, 3, 3) and translation (T, 3), for every joint."""
        poses = [(np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3)))]
        for j in range(BASE, len(self._parent)):
            R_parent, p_parent = poses[self._parent[j]]
            R_offset, p_offset = self._offset[j]
            R, p = R_parent @ R_offset, R_parent @ p_offset + p_parent
            if j == BASE:
                p, R = p + np.einsum("tij,tj->ti", R, position), R @ rotation
            else:
                R, p = _moved(R, p, self._axis[j], angle.get(self.joint_names[j]))
            poses.append((R, p))
        return poses

    def _attached(self, frame: str, poses: list[tuple[Array, Array]], where: str) -> tuple[Array, Array]:
        """Return a frame's rotation (T, 3, 3) and position (T, 3)."""
        if frame not in self._anchor:
            raise UnknownLink(self.card.name, frame, list(self._anchor), where)
        joint, R_local, p_local = self._anchor[frame]
        R, p = poses[joint]
        return R @ R_local, R @ p_local + p

    def _points(self, poses: list[tuple[Array, Array]]) -> dict[str, Array]:
        roles = self.card.sided_roles()
        point = {role: self._attached(frame, poses, f"roles.{role}")[1] for role, frame in roles.items()}
        point.setdefault("waist", poses[BASE][1])
        for part in ("hip", "shoulder"):
            if {f"left_{part}", f"right_{part}"} <= point.keys():
                point[f"mid_{part}"] = 0.5 * (point[f"left_{part}"] + point[f"right_{part}"])
        return point

    def _soles(self, poses: list[tuple[Array, Array]]) -> Array:
        """Return the sole corners; a sole's axes are the world's while all joints are 0, base upright."""
        card = self.card.soles
        corners = np.array([(x, y, 0.0) for x, y in card.polygon_m])
        frames = list(expand({card.frame: 0.0}))
        out = []
        for side, mirror in zip(SIDES, (1.0, -1.0), strict=True):
            frame = frames[-1] if side == "right" else frames[0]
            R_zero = self._attached(frame, self._zero, "soles.frame")[0][0]
            R, p = self._attached(frame, poses, "soles.frame")
            flip = np.array([1.0, mirror, 1.0])
            local = np.array(card.translation_m) * flip + (corners * flip) @ R_zero
            out.append(np.einsum("tij,kj->tki", R, local) + p[:, None])
        return np.stack(out, axis=1)

    def _com(self, poses: list[tuple[Array, Array]]) -> Array:
        moment = np.zeros_like(poses[BASE][1])
        for (R, p), mass, lever in zip(poses, self._mass, self._lever, strict=True):
            if mass > 0:
                moment = moment + mass * (R @ lever + p)
        return np.asarray(moment / max(float(self._mass.sum()), 1e-12))


def _moved(R: Array, p: Array, axis: tuple[Array, Array] | None, q: Array | None) -> tuple[Array, Array]:
    """Return the pose behind a joint at positions (T,) [rad or m]; a joint without position is at 0."""
    if axis is None or q is None:
        return R, p
    linear, angular = axis
    p = p + (R @ linear) * q[:, None]
    return (R @ rodrigues(angular, q) if angular.any() else R), p


def rodrigues(axis: Array, angle: Array) -> Array:
    """Return the rotations about a unit axis by angles (T,) [rad], shape (T, 3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * K + versine * (K @ K))


def rotations_of(quaternion_wxyz: Array) -> Array:
    """Return rotation matrices of quaternions w x y z (normalised first), shape (T, 3, 3)."""
    q = np.asarray(quaternion_wxyz, dtype=float)
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _split(placement: Any) -> tuple[Array, Array]:
    return np.array(placement.rotation), np.array(placement.translation)


def _axis(joint: Any) -> tuple[Array, Array] | None:
    """Return a joint's motion (linear, angular) per unit of position; ``None`` for no simple joint."""
    if joint.nv != 1:
        return None
    data = joint.createData()
    q = np.zeros(joint.nq)
    if joint.nq == 2:
        q[0] = 1.0  # a joint without limits keeps cosine and sine
    if joint.idx_q >= 0:
        q = np.concatenate([np.zeros(joint.idx_q), q])
    joint.calc(data, q)
    S = np.asarray(data.S).reshape(6)
    return S[:3].copy(), S[3:].copy()
