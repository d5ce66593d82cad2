"""The robot as MuJoCo sees it, built from the kinematic model: masses, joints, servos, soles, a floor, objects.

It is built from the model that imitor moves, not from its file: URDF and MJCF, locked and coupled joints come out
alike, a body a joint, and a configuration means the same on both sides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from imitor.errors import RobotError
from imitor.robot.hands import hand_joints
from imitor.robot.model import BASE_NQ, BASE_NV, RobotModel
from imitor.simulation.drives import GRAVITY, Drives, coupled_groups
from imitor.simulation.things import FLOOR_BIT, GRASPABLE_BIT, PREFIX, ROBOT_BIT, Things
from imitor.types import SIDES, Array, IntArray
from imitor.visual.offscreen import import_mujoco

OBJECT, FLOOR, LEFT, RIGHT, OTHER = -2, -1, 0, 1, 2
"""What a geom is: an object, the floor, a sole, or a part of the robot that should not touch the floor."""

_BASE: Final = 1
_CORNER_RADIUS_M: Final = 0.005
_POINT_RADIUS: Final = 0.025
"""Radius of the points that feel the floor, by the standing height of the base [-]."""
_LEAST_MASS_KG: Final = 1e-6
_LEAST_INERTIA: Final = 1e-9
"""Links without mass get so little that nothing changes [kg m^2]."""
_HOLDER: Final = "holder"
_STIFF: Final = (0.999, 0.9999, 0.001, 0.5, 2.0)
"""Impedance of the hold on the base: it hardly gives."""

Touch = Literal["points", "hulls"]


@dataclass(frozen=True)
class Surroundings:
    """What the robot is put into, and how finely time passes.

    Attributes:
        step_s: Time step [s].
        friction: Coefficient between robot and floor [-].
        armature_per_effort: Inertia of motor and gear of joints whose model has none, by torque limit [kg m^2/(N m)].
        touch: What feels the floor beside the soles: ``points`` at the joints, or the ``hulls`` of the visible parts.
    """

    step_s: float = 0.002
    friction: float = 0.8
    armature_per_effort: float = 2e-4
    touch: Touch = "points"


class Body:
    """A robot in MuJoCo; `qpos` and `configuration` translate positions.

    Args:
        robot: The robot.
        drives: Its servos.
        around: Floor and time step.
        visible: Whether the robot's visible surface is put on, for a window.
        environment: Objects around the robot, as a pipeline gives them; of a mesh its convex hull is felt.
        held: Whether the base is held where the motion has it, as on a stand; else the robot is free.

    Attributes:
        things: The objects.
        model: MuJoCo's model.
        kind: What each geom is: `OBJECT`, `FLOOR`, `LEFT`, `RIGHT` or `OTHER`, shape (ngeom,).
        geom_names: Names of the geoms; of a part the role or the joint it sits at.

    Raises:
        RobotError: MuJoCo refuses the robot.
        ValueError: An object's mesh cannot be read.
    """

    def __init__(
        self,
        robot: RobotModel,
        drives: Drives,
        around: Surroundings,
        *,
        visible: bool = False,
        environment: Sequence[Mapping[str, Any]] = (),
        held: bool = False,
    ) -> None:
        self._mujoco = mujoco = import_mujoco()
        self.robot, self.drives, self.around, self.held = robot, drives, around, held
        self._hands = hand_joints(robot)
        spec = mujoco.MjSpec()
        _set_options(mujoco, spec, around)
        bodies = self._add_bodies(spec)
        _add_floor(mujoco, spec, around.friction)
        self.things = Things(mujoco, spec, robot, environment, _touching(around.friction))
        if held:
            _add_holder(mujoco, spec, robot.model.names[_BASE], around.step_s)
        self._add_soles(bodies)
        if around.touch == "hulls":
            self._add_surface(spec, bodies, "hull", felt=True)
        else:
            self._add_points(bodies)
        if visible:
            self._add_surface(spec, bodies, "visible", felt=False)
            _add_light(mujoco, spec)
        self._add_servos(spec)
        try:
            self.model = spec.compile()
        except ValueError as error:
            raise RobotError(f"robot '{robot.name}': MuJoCo cannot simulate it: {error}") from None
        self.things.compiled(self.model)
        joints = [self.model.joint(name).qposadr[0] for name in robot.joint_names]
        self._places = np.array([0, 1, 2, 4, 5, 6, 3, *joints])
        self._speeds = np.array([self.model.joint(name).dofadr[0] for name in robot.joint_names])
        self._sole_bodies = [self.model.body(robot.model.names[joint]).id for joint, _, _ in self._soles]
        self.geom_names = [self.model.geom(g).name for g in range(self.model.ngeom)]
        self.kind: IntArray = np.array([_kind(name) for name in self.geom_names], dtype=np.int_)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.robot.n

    @property
    def weight_n(self) -> float:
        """Weight of the robot [N]."""
        return (float(self.model.body_mass.sum()) - self.things.mass_kg) * GRAVITY

    def qpos(self, q: Array) -> Array:
        """Return MuJoCo's positions of Pinocchio configurations, objects where they are written, shape (..., nq)."""
        out = np.zeros((*q.shape[:-1], self.model.nq))
        out[..., self._places] = q
        return out

    def configuration(self, qpos: Array) -> Array:
        """Return Pinocchio configurations, shape (..., 7 + n), of MuJoCo's positions."""
        return np.asarray(qpos[..., self._places])

    def velocity(self, qpos: Array, qvel: Array) -> Array:
        """Return Pinocchio's velocity (6 + n,) of MuJoCo's positions and velocities: the base's in its own axes."""
        import pinocchio as pin

        out = np.empty(BASE_NV + len(self._speeds))  # objects that move come behind the robot
        R = pin.Quaternion(qpos[[4, 5, 6, 3]]).toRotationMatrix()
        out[:3], out[3:6] = R.T @ qvel[:3], qvel[3:6]
        out[BASE_NV:] = qvel[self._speeds]
        return out

    def sole_corners(self, data: Any) -> Array:
        """Return the sole corners in world, shape (2, K, 3) [m]."""
        out = np.empty_like(self.robot.sole)
        for side, ((_, R, p), body) in enumerate(zip(self._soles, self._sole_bodies, strict=True)):
            corners = self.robot.sole[side] @ R.T + p
            out[side] = corners @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
        return out

    # ------------------------------------------------------------------ parts

    def _add_bodies(self, spec: Any) -> list[Any]:
        import pinocchio as pin

        mujoco, robot, model = self._mujoco, self.robot, self.robot.model
        data = model.createData()
        pin.computeJointJacobians(model, data, pin.neutral(model))
        bodies = [spec.worldbody]
        for j in range(1, model.njoints):
            M = model.jointPlacements[j]
            quaternion = pin.Quaternion(M.rotation).coeffs()[[3, 0, 1, 2]]
            body = bodies[model.parents[j]].add_body(name=model.names[j], pos=M.translation, quat=quaternion)
            bodies.append(body)
            _set_inertia(body, model.inertias[j])
            if j == _BASE:
                body.add_freejoint(name="base")
                continue
            v, i = model.joints[j].idx_v, j - 2
            motion = pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL)[:, v]
            slides = np.linalg.norm(motion[:3]) > 0.5
            limits = np.array([model.lowerPositionLimit[BASE_NQ + i], model.upperPositionLimit[BASE_NQ + i]])
            limited = bool(np.isfinite(limits).all() and limits[0] < limits[1])
            body.add_joint(
                name=model.names[j],
                type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
                axis=motion[:3] if slides else motion[3:],
                limited=limited,
                range=limits if limited else np.zeros(2),
                damping=float(model.damping[v]),
                frictionloss=float(model.friction[v]),
                armature=float(model.armature[v])
                or self.around.armature_per_effort * float(self.drives.limit[i]),
            )
        self._soles = []
        for side in SIDES:
            frame = robot.model.frames[robot.frame_id(f"{side}_foot")]
            self._soles.append(
                (int(frame.parentJoint), frame.placement.rotation, frame.placement.translation)
            )
        return bodies

    def _add_soles(self, bodies: list[Any]) -> None:
        """Put a small ball into each sole corner: its lowest point is the corner."""
        up = np.array([0.0, 0.0, _CORNER_RADIUS_M])
        for side, (joint, R, p) in zip(SIDES, self._soles, strict=True):
            for k, corner in enumerate(self.robot.sole[SIDES.index(side)]):
                self._ball(bodies, joint, f"sole/{side}/{k}", R @ (corner + up) + p, _CORNER_RADIUS_M)

    def _add_points(self, bodies: list[Any]) -> None:
        """Put a ball at every role's point, except on the feet."""
        robot = self.robot
        radius = _POINT_RADIUS * float(robot.standing[2])
        feet = {joint for joint, _, _ in self._soles}
        for role in robot.roles:
            frame = robot.model.frames[robot.frame_id(role)]
            ankle = role.endswith(("_foot", "_ankle"))
            if not ankle and not role.startswith("mid_") and frame.parentJoint not in feet:
                self._ball(bodies, frame.parentJoint, f"part/{role}", frame.placement.translation, radius)

    def _ball(self, bodies: list[Any], joint: int, name: str, at: Array, radius: float) -> None:
        bodies[joint].add_geom(
            name=name, type=self._mujoco.mjtGeom.mjGEOM_SPHERE, size=(radius, 0.0, 0.0), pos=at, mass=0.0,
            contype=ROBOT_BIT, conaffinity=self._feels(joint), group=3, **_touching(self.around.friction),
        )  # fmt: skip

    def _feels(self, joint: int) -> int:
        """Return what the parts at a joint collide with, as contact bits."""
        return FLOOR_BIT if joint in self._hands else FLOOR_BIT | GRASPABLE_BIT

    def _add_surface(self, spec: Any, bodies: list[Any], prefix: str, *, felt: bool) -> None:
        """Put the visible parts on; MuJoCo lets their convex hulls touch."""
        from imitor.visual.geometry import robot_parts

        mujoco = self._mujoco
        feet = {joint for joint, _, _ in self._soles}
        for k, part in enumerate(robot_parts(self.robot)):
            if felt and part.joint in feet:
                continue
            joint = self.robot.model.names[part.joint]
            name = f"part/{joint}/{k}" if felt else f"visible/{joint}/{k}"
            mesh = spec.add_mesh(name=f"{prefix}{k}", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
            mesh.uservert = part.surface.vertices.ravel().tolist()
            mesh.userface = part.surface.faces.ravel().tolist()
            bodies[part.joint].add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{prefix}{k}", mass=0.0,
                rgba=part.surface.rgba, contype=ROBOT_BIT if felt else 0,
                conaffinity=self._feels(part.joint) if felt else 0, group=3 if felt else 1,
                **_touching(self.around.friction),
            )  # fmt: skip

    def _add_servos(self, spec: Any) -> None:
        mujoco, drives = self._mujoco, self.drives
        for i, name in enumerate(self.robot.joint_names):
            bias = np.zeros(10)
            bias[1:3] = -drives.kp[i], -drives.kv[i]
            gain = np.zeros(10)
            gain[0] = drives.kp[i]
            spec.add_actuator(
                name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
                gaintype=mujoco.mjtGain.mjGAIN_FIXED, gainprm=gain,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE, biasprm=bias,
                forcelimited=True, forcerange=(-drives.limit[i], drives.limit[i]),
            )  # fmt: skip
        names = self.robot.joint_names
        for first, followers in coupled_groups(self.robot):
            for follower, ratio in followers.items():
                line = np.zeros(mujoco.mjNEQDATA)
                line[1] = ratio
                spec.add_equality(
                    name=f"coupled/{names[follower]}", type=mujoco.mjtEq.mjEQ_JOINT,
                    objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=names[follower], name2=names[first], data=line,
                )  # fmt: skip


def _set_options(mujoco: Any, spec: Any, around: Surroundings) -> None:
    spec.compiler.degree = False
    spec.compiler.balanceinertia = True
    spec.compiler.autolimits = False
    spec.option.timestep = around.step_s
    spec.option.gravity = (0.0, 0.0, -GRAVITY)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # the first force of a contact is then the normal one
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # what diverges is told, not begun anew


def _set_inertia(body: Any, inertia: Any) -> None:
    """Give a body mass and principal inertias; what is not positive is mended."""
    import pinocchio as pin

    moments, axes = np.linalg.eigh(np.asarray(inertia.inertia))
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    body.explicitinertial = True
    body.mass = max(float(inertia.mass), _LEAST_MASS_KG)
    body.ipos = inertia.lever
    body.iquat = pin.Quaternion(axes).coeffs()[[3, 0, 1, 2]]
    body.inertia = np.maximum(moments, _LEAST_INERTIA)


def _add_floor(mujoco: Any, spec: Any, friction: float) -> None:
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.0, 0.0, 1.0), contype=FLOOR_BIT,
        conaffinity=ROBOT_BIT, rgba=(0.9, 0.91, 0.93, 1.0), **_touching(friction),
    )  # fmt: skip


def _touching(friction: float) -> dict[str, Any]:
    """Return how a geom touches another."""
    return {"condim": 3, "friction": (friction, 0.005, 0.0001)}


def _add_holder(mujoco: Any, spec: Any, base: str, step_s: float) -> None:
    """Weld the base to a body that goes where it is told."""
    spec.worldbody.add_body(name=_HOLDER, mocap=True)
    pose = np.zeros(mujoco.mjNEQDATA)
    pose[[6, 10]] = 1.0  # no rotation between the two, and full torque
    spec.add_equality(
        name=_HOLDER, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1=_HOLDER, name2=base,
        data=pose, solref=(2.0 * step_s, 1.0), solimp=_STIFF,
    )  # fmt: skip


def _add_light(mujoco: Any, spec: Any) -> None:
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=(0.0, 0.0, 4.0), dir=(0.3, 0.3, -1.0)
    )


def _kind(name: str) -> int:
    if name.startswith("sole/"):
        return LEFT if "/left/" in name else RIGHT
    if name.startswith(PREFIX):
        return OBJECT
    return FLOOR if name == "floor" else OTHER


__all__ = ["FLOOR", "LEFT", "OBJECT", "OTHER", "RIGHT", "Body", "Surroundings", "Touch"]
