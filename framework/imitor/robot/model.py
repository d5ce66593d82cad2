"""The robot model: the one place that touches Pinocchio's model. One model, one Data, updated in place.

Configurations ``q`` are Pinocchio's, of the floating-base model: base position [m], base quaternion x y z w, then
the joint positions [rad or m] in the order of `RobotModel.joint_names`.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from typing import Final, TypeVar

import numpy as np

from imitor.errors import RobotError, UnknownJoint, UnknownLink
from imitor.registry import Registry
from imitor.robot.card import RobotCard, expand, expand_limits, load_card
from imitor.robot.files import ModelFiles, locate
from imitor.robot.growth import MIDDLES, Growth
from imitor.types import SEGMENTS, SIDES, Array

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    import pinocchio as pin

BASE_NQ: Final = 7
BASE_NV: Final = 6
DEFAULT_SPEED: Final = 10.0  # [rad/s], where neither model nor card says
_IDENTITY: Final = np.eye(4)
_ORIGIN: Final = np.zeros(3)
V = TypeVar("V")


class RobotModel:
    """A humanoid with a floating base: kinematics, roles, limits, soles.

    Attributes:
        card: The robot's card.
        files: The model's files.
        model: The Pinocchio model (read only for others).
        data: Its one Data, valid for the configuration of the last `update`.
        joint_names: The n moved joints, in configuration order.
        lower, upper: Joint limits, shape (n,) [rad].
        speed: Joint speed limits, shape (n,) [rad/s].
        acceleration: Joint acceleration limits, shape (n,) [rad/s^2]; inf where there is none.
        coupling: Matrix S of coupled joints, v = S u, shape (n, n_u), or ``None`` when every joint is independent.
        standing: The standing configuration, soles on the floor, shape (nq,).
        sole: Sole corners in the sole frame, shape (2, K, 3) [m], left then right.
    """

    def __init__(self, card: RobotCard, files: ModelFiles, model: pin.Model) -> None:
        self.card, self.files = card, files
        self.name = card.name
        self.full_model = model
        self.model, self.locked = _without_locked(card, model)
        _require_simple_joints(card, self.model)
        self.joint_names: Sequence[str] = [self.model.names[j] for j in range(2, self.model.njoints)]
        self.n = len(self.joint_names)
        self.nq, self.nv = self.model.nq, self.model.nv
        self._read_limits()
        self._add_role_frames()
        self.data = self.model.createData()
        self.sole = _sole_corners(card)
        self.coupling = self._coupling_matrix()
        self._frame_views()
        self.standing = self._standing_configuration()
        self._growth: Growth | None = None
        self.update(self.standing)

    @classmethod
    def load(cls, name_or_path: str, registry: Registry | None = None) -> RobotModel:
        """Load a robot by the name or path of its card.

        Raises:
            SpecError: The card is wrong. RobotError: The model is missing or does not fit the card.
        """
        card = load_card(name_or_path, registry or Registry(entry_points=False))
        return cls.from_card(card)

    @classmethod
    def from_card(cls, card: RobotCard) -> RobotModel:
        """Build the model of a card."""
        files = locate(card)
        return cls(card, files, _build(card, files))

    # ------------------------------------------------------------------ set-up

    def _read_limits(self) -> None:
        limits = self.card.limits
        self.lower = self.model.lowerPositionLimit[BASE_NQ:].copy()
        self.upper = self.model.upperPositionLimit[BASE_NQ:].copy()
        self.speed = self.model.velocityLimit[BASE_NV:].copy()
        self.speed[~np.isfinite(self.speed) | (self.speed <= 0) | (self.speed > 1e3)] = np.inf
        self.acceleration = np.full(self.n, np.inf)
        for name, (lo, hi) in self._per_joint(limits.position_rad, "limits.position_rad").items():
            i = self.joint_index(name)
            self.lower[i], self.upper[i] = max(self.lower[i], lo), min(self.upper[i], hi)
        for name, value in self._per_joint(limits.speed_rad_s, "limits.speed_rad_s").items():
            i = self.joint_index(name)
            self.speed[i] = min(self.speed[i], value)
        self.speed[np.isinf(self.speed)] = DEFAULT_SPEED
        for name, value in self._per_joint(limits.acceleration_rad_s2, "limits.acceleration_rad_s2").items():
            self.acceleration[self.joint_index(name)] = value
        bad = [n for n, lo, hi in zip(self.joint_names, self.lower, self.upper, strict=True) if not lo < hi]
        if bad:
            raise RobotError(
                f"robot '{self.name}': no range left between lower and upper limit of {', '.join(bad)}; "
                "correct limits.position_rad"
            )
        unlimited = ~(np.isfinite(self.lower) & np.isfinite(self.upper))
        self.lower[unlimited], self.upper[unlimited] = -2 * np.pi, 2 * np.pi

    def _per_joint(self, values: Mapping[str, V], where: str) -> dict[str, V]:
        out = expand_limits(values)
        default = out.pop("*", None)
        for name in out:
            self.joint_index(name, where)
        if default is not None:
            out = {**dict.fromkeys(self.joint_names, default), **out}
        return out

    def _add_role_frames(self) -> None:
        """Add one frame a role, aligned with the world when all joints are 0: an upright robot has identities."""
        model, data = self.model, self.model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        points = {role: self._frame_id(f, f"roles.{role}") for role, f in self.card.sided_roles().items()}
        self._role_frame: dict[str, int] = {}
        for role, fid in points.items():
            parent, placement = model.frames[fid].parentJoint, data.oMf[fid].translation
            self._role_frame[role] = self._new_frame(data, f"role/{role}", parent, placement)
        self._role_frame.setdefault("waist", self._new_frame(data, "role/waist", 1, data.oMi[1].translation))
        self._role_frame.setdefault("chest", self._role_frame["waist"])
        for i, side in enumerate(SIDES):
            frame = expand({self.card.soles.frame: (0.0, 0.0)})
            fid = self._frame_id(list(frame)[i] if len(frame) == 2 else self.card.soles.frame, "soles.frame")
            x, y, z = self.card.soles.translation_m
            offset = np.array([x, -y if side == "right" else y, z])
            parent, placement = model.frames[fid].parentJoint, data.oMf[fid]
            self._role_frame[f"{side}_foot"] = self._new_frame(
                data, f"role/{side}_foot", parent, placement.act(offset)
            )
        for middle, carrier, joint in MIDDLES:
            if {f"left_{joint}", f"right_{joint}"} <= points.keys():
                parent = model.frames[self._role_frame[carrier]].parentJoint
                at = 0.5 * (
                    data.oMf[points[f"left_{joint}"]].translation
                    + data.oMf[points[f"right_{joint}"]].translation
                )
                self._role_frame[middle] = self._new_frame(data, f"role/{middle}", parent, at)

    def _new_frame(self, data: pin.Data, name: str, parent: int, at: Array) -> int:
        placement = data.oMi[parent].actInv(pin.SE3(np.eye(3), np.asarray(at)))
        return int(self.model.addFrame(pin.Frame(name, parent, 0, placement, pin.FrameType.OP_FRAME), False))

    def _frame_id(self, name: str, where: str) -> int:
        for kind in (
            pin.FrameType.BODY,
            pin.FrameType.JOINT,
            pin.FrameType.FIXED_JOINT,
            pin.FrameType.OP_FRAME,
        ):
            if self.model.existFrame(name, kind):
                return int(self.model.getFrameId(name, kind))
        legal = [f.name for f in self.model.frames if f.name != "universe"]
        raise UnknownLink(self.name, name, legal, where)

    def _coupling_matrix(self) -> Array | None:
        if not self.card.coupled:
            return None
        follower: dict[int, tuple[int, float]] = {}
        for coupling in self.card.coupled:
            names = [n for j in coupling.joints for n in expand({j: 0.0})]
            indices = [self.joint_index(n, "coupled") for n in names]
            ratios = list(coupling.ratios) or [1.0] * len(indices)
            for i, ratio in zip(indices[1:], ratios[1:], strict=True):
                follower[i] = (indices[0], ratio)
                bounds = sorted((self.lower[i] / ratio, self.upper[i] / ratio))
                first = indices[0]
                self.lower[first] = max(self.lower[first], bounds[0])
                self.upper[first] = min(self.upper[first], bounds[1])
                self.speed[first] = min(self.speed[first], self.speed[i] / abs(ratio))
                self.acceleration[first] = min(self.acceleration[first], self.acceleration[i] / abs(ratio))
            if not self.lower[indices[0]] < self.upper[indices[0]]:
                raise RobotError(
                    f"robot '{self.name}': the coupled joints {', '.join(names)} have no common range; "
                    "correct `coupled`"
                )
            for i, ratio in zip(indices[1:], ratios[1:], strict=True):
                first = indices[0]
                self.lower[i], self.upper[i] = sorted((self.lower[first] * ratio, self.upper[first] * ratio))
                self.speed[i] = self.speed[first] * abs(ratio)
                self.acceleration[i] = self.acceleration[first] * abs(ratio)
        independent = [i for i in range(self.n) if i not in follower]
        S = np.zeros((self.n, len(independent)))
        S[independent, range(len(independent))] = 1.0
        for i, (first, ratio) in follower.items():
            S[i, independent.index(first)] = ratio
        return S

    def _standing_configuration(self) -> Array:
        q: Array = np.array(pin.neutral(self.model))
        q[BASE_NQ:] = self.joint_values(self.card.standing, "standing")
        pin.framesForwardKinematics(self.model, self.data, q)
        corners = self.sole_corners()
        q[2] -= float(corners[..., 2].min())
        return q

    def _frame_views(self) -> None:
        frames = self.data.oMf
        self._position: dict[str, Array] = {
            role: frames[i].translation for role, i in self._role_frame.items()
        }
        self._rotation: dict[str, Array] = {role: frames[i].rotation for role, i in self._role_frame.items()}
        self._feet = [(self._rotation[f"{side}_foot"].T, self._position[f"{side}_foot"]) for side in SIDES]
        self.com: Array = self.data.com[0]
        self.com_jacobian: Array = self.data.Jcom
        self.jacobian: Array = self.data.J
        self._base_position, self._base_rotation = self.data.oMi[1].translation, self.data.oMi[1].rotation
        self._ancestors = {role: self._ancestor_mask(i) for role, i in self._role_frame.items()}

    def _ancestor_mask(self, frame: int) -> Array:
        mask = np.zeros(self.nv)
        joint = self.model.frames[frame].parentJoint
        while joint > 0:
            first, width = self.model.joints[joint].idx_v, self.model.joints[joint].nv
            mask[first : first + width] = 1.0
            joint = self.model.parents[joint]
        return mask

    # ------------------------------------------------------------------ queries

    @property
    def roles(self) -> Sequence[str]:
        """Roles of the robot's frames."""
        return list(self._role_frame)

    def has(self, *roles: str) -> bool:
        """Tell whether the robot has frames for all these roles."""
        return all(r in self._role_frame for r in roles)

    def frame_id(self, role: str) -> int:
        """Return the Pinocchio frame of a role.

        Raises:
            RobotError: The robot has no such role.
        """
        try:
            return self._role_frame[role]
        except KeyError:
            raise RobotError(
                f"robot '{self.name}' has no frame for the role '{role}'; its card names: {', '.join(self._role_frame)}"
            ) from None

    def joint_index(self, name: str, where: str = "") -> int:
        """Return the place of a joint among `joint_names`.

        Raises:
            UnknownJoint: There is no such joint.
        """
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise UnknownJoint(self.name, name, self.joint_names, where) from None

    def joint_values(self, values: Mapping[str, float | tuple[float, float]], where: str = "") -> Array:
        """Return joint positions for a card's mapping, others 0, all brought within limits, shape (n,) [rad]."""
        q = np.zeros(self.n)
        for name, value in expand(values).items():
            q[self.joint_index(name, where)] = value
        if self.coupling is not None:
            independent = self.coupling.argmax(axis=0)
            q = self.coupling @ q[independent]
        return np.clip(q, self.lower, self.upper)

    def position(self, role: str) -> Array:
        """Return the view of a role's position in world at the last `update`, shape (3,) [m]."""
        self.frame_id(role)
        return self._position[role]

    def rotation(self, role: str) -> Array:
        """Return the view of a role's rotation, world from role, at the last `update`, shape (3, 3)."""
        self.frame_id(role)
        return self._rotation[role]

    def pose(self, role: str) -> Array:
        """Return a copy of a role's pose, world from role, shape (4, 4)."""
        T = _IDENTITY.copy()
        T[:3, :3], T[:3, 3] = self.rotation(role), self.position(role)
        return T

    def ancestors(self, role: str) -> Array:
        """Return 1.0 for each velocity coordinate that moves a role's frame, shape (nv,)."""
        self.frame_id(role)
        return self._ancestors[role]

    def sole_corners(self) -> Array:
        """Return the sole corners in world at the last `update`, shape (2, K, 3) [m]."""
        out = np.empty_like(self.sole)
        for corners, sole, (R_T, p) in zip(out, self.sole, self._feet, strict=True):
            np.dot(sole, R_T, out=corners)
            np.add(corners, p, out=corners)
        return out

    @property
    def mass_kg(self) -> float:
        """Total mass [kg]."""
        return float(pin.computeTotalMass(self.model))

    def segment_lengths(self) -> dict[str, float]:
        """Return the lengths of the main segments and of the foot, neck and head links in the standing posture [m].

        Keys are those of `imitor.types.SEGMENTS` that the robot has, ``hips`` and ``shoulders`` (widths),
        ``left_hand``/``right_hand`` (wrist to hand), ``head`` (mid-shoulder to head), ``ankle_height``.
        """
        self.update(self.standing)
        pairs = {
            **SEGMENTS,
            "hips": ("right_hip", "left_hip"),
            "shoulders": ("right_shoulder", "left_shoulder"),
            "left_hand": ("left_wrist", "left_hand"),
            "right_hand": ("right_wrist", "right_hand"),
            "head": ("mid_shoulder", "head"),
        }
        out = {
            name: float(np.linalg.norm(self._position[b] - self._position[a]))
            for name, (a, b) in pairs.items()
            if self.has(a, b)
        }
        if self.has("left_ankle"):
            out["ankle_height"] = float(self._position["left_ankle"][2] - self._position["left_foot"][2])
        return out

    # ------------------------------------------------------------------ kinematics

    def update(self, q: Array) -> None:
        """Bring frames, Jacobians, CoM and CoM Jacobian to a configuration, shape (nq,)."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        pin.jacobianCenterOfMass(model, data, False)

    def update_frames(self, q: Array, frames: Sequence[int]) -> None:
        """Bring the Jacobians and some frames alone to a configuration; an `update` must follow.

        Args:
            q: Configuration, shape (nq,).
            frames: Pinocchio frames, of `frame_id`.
        """
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        for frame in frames:
            pin.updateFramePlacement(model, data, frame)

    def is_at(self, role: str, pose: Array) -> bool:
        """Tell whether a role's frame has a pose, world from frame, to 1e-9 m and rad, at the last `update`."""
        shift = self._position[role] - pose[:3, 3]
        if shift.dot(shift) >= 1e-18:
            return False
        turn = (self._rotation[role] - pose[:3, :3]).reshape(-1)
        return bool(turn.dot(turn) < 1e-18)

    def place(self, q: Array, role: str, pose: Array) -> None:
        """Move the base of ``q`` in place so that a role's frame takes a pose, and update.

        Args:
            q: Configuration of the last `update`, shape (nq,); changed in place.
            role: Which frame, e.g. the anchor.
            pose: World from frame, shape (4, 4).
        """
        R, base = self._rotation[role], self._base_position
        turn = pose[:3, :3].dot(R.T)  # takes the frame where it is to where it shall be
        q[:3] = pose[:3, 3] + turn.dot(base - self._position[role])
        q[3:7] = quaternion_of(turn.dot(self._base_rotation))
        self.update(q)

    def integrate(self, q: Array, v: Array) -> Array:
        """Return ``q`` moved by a velocity for one unit of time, shape (nq,)."""
        return np.asarray(pin.integrate(self.model, q, v))

    def difference(self, q0: Array, q1: Array) -> Array:
        """Return the velocity that moves ``q0`` to ``q1`` in one unit of time, shape (nv,)."""
        return np.asarray(pin.difference(self.model, q0, q1))

    def interpolate(self, q0: Array, q1: Array, share: float) -> Array:
        """Return the configuration at ``share`` of the way from ``q0`` to ``q1``, shape (nq,)."""
        return np.asarray(pin.interpolate(self.model, q0, q1, share))

    def twin(self) -> RobotModel:
        """Return a robot with a Data of its own, for a stage that looks at other configurations than the state's."""
        other = copy.copy(self)
        other.data = other.model.createData()
        other._frame_views()
        other.update(other.standing)
        return other

    # ------------------------------------------------------------------ other sizes

    def scaled(self, factors: Mapping[str, float]) -> RobotModel:
        """Return a copy with other segment lengths, e.g. of a human's size [tomic2018].

        Args:
            factors: Segment (or ``hips``, ``shoulders``, ``head``) -> length factor [-]; ``*`` for the others.
        """
        other = copy.copy(self)
        other.model = self.model.copy()
        other.data = other.model.createData()
        other._growth = Growth(self.model, self._role_frame, factors, self.name)
        other.set_scale(1.0)
        other._frame_views()
        other.standing = other._standing_configuration()
        other.update(other.standing)
        return other

    def set_scale(self, share: float) -> None:
        """Set how far a model made by `scaled` has grown: 0 is the robot's size, 1 the scaled one.

        Moves joint and role placements only; masses and limits stay. Call `update` afterwards.
        """
        if self._growth is not None:
            self._growth.apply(self.model, share)


def quaternion_of(R: Array) -> Array:
    """Return the unit quaternion x y z w of a rotation matrix, shape (4,).

    By way of a pose, since Pinocchio 3.8 loses 80 bytes for every ``Quaternion`` made from a matrix. Its length is made
    one, or rounding errors would grow from frame to frame.
    """
    quaternion: Array = pin.SE3ToXYZQUAT(pin.SE3(R, _ORIGIN))[3:]
    return np.asarray(quaternion / np.sqrt(quaternion.dot(quaternion)))


def _build(card: RobotCard, files: ModelFiles) -> pin.Model:
    """Read URDF or MJCF into a model with a free base."""
    try:
        if files.is_mjcf:
            model = pin.buildModelFromMJCF(str(files.model))
            if model.njoints < 2 or model.joints[1].nq != BASE_NQ:
                model = pin.buildModelFromMJCF(str(files.model), pin.JointModelFreeFlyer())
            model.jointPlacements[1] = pin.SE3.Identity()  # q is the base in world, wherever the file puts it
            return model
        return pin.buildModelFromUrdf(str(files.model), pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"robot '{card.name}': {files.model} cannot be read as a robot: {error}") from None


def _without_locked(card: RobotCard, model: pin.Model) -> tuple[pin.Model, dict[str, float]]:
    locked = {k: float(v) for k, v in expand(card.locked).items()}
    if not locked:
        return model.copy(), locked
    q = pin.neutral(model)
    ids = []
    for name, value in locked.items():
        if not model.existJointName(name):
            raise UnknownJoint(card.name, name, list(model.names)[2:], "locked")
        joint = model.getJointId(name)
        ids.append(joint)
        first, width = model.joints[joint].idx_q, model.joints[joint].nq
        q[first : first + width] = (value,) if width == 1 else (np.cos(value), np.sin(value))
    try:
        return pin.buildReducedModel(model, ids, q), locked
    except ValueError as error:
        raise RobotError(f"robot '{card.name}': its joints cannot be locked: {error}") from None


def _require_simple_joints(card: RobotCard, model: pin.Model) -> None:
    odd = [model.names[j] for j in range(2, model.njoints) if model.joints[j].nq != 1]
    if odd:
        raise RobotError(
            f"robot '{card.name}': only revolute and prismatic joints with limits are moved, not {', '.join(odd)}; "
            "give them limits in the model, or list them in `locked`"
        )
    if model.njoints < 3:
        raise RobotError(f"robot '{card.name}': the model has no joints to move")


def _sole_corners(card: RobotCard) -> Array:
    left = np.array([(x, y, 0.0) for x, y in card.soles.polygon_m])
    return np.stack([left, left * [1.0, -1.0, 1.0]])


__all__ = ["BASE_NQ", "BASE_NV", "RobotModel"]
