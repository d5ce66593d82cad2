"""Objects around the simulated robot: what slides has a joint, and hands that hold it are welded to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from imitor.environment import OBJECT_COLOUR, carriers, read_environment, triangles
from imitor.robot.model import RobotModel
from imitor.types import SIDES, Array, IntArray

ROBOT_BIT, FLOOR_BIT, GRASPABLE_BIT = 1, 2, 4
"""Contact bits: of the robot, of what all of it touches, and of what all but its hands touches."""
PREFIX: Final = "object/"
"""Of the names of objects' bodies and geoms."""
_HELD: Final = "grasp"
_POINT_M: Final = 1e-4
"""Radius of the point in a hand from which distances are measured [m]."""


class Things:
    """The objects of a pipeline's environment in a MuJoCo model under construction, then in a compiled one.

    Args:
        mujoco: The package.
        spec: The model; bodies of the robot are in it.
        robot: The robot.
        environment: The objects, as a pipeline gives them; of a mesh its convex hull is felt.
        geom: Further properties of every object's geom, such as friction.

    Attributes:
        names: Names of the K objects.
        mass_kg: Mass of all that slides.

    Raises:
        ValueError: An object's mesh cannot be read.
    """

    def __init__(
        self,
        mujoco: Any,
        spec: Any,
        robot: RobotModel,
        environment: Sequence[Mapping[str, Any]],
        geom: Mapping[str, Any],
    ) -> None:
        self._mujoco, self._robot = mujoco, robot
        self.items = read_environment(environment)
        self.carrier = carriers(self.items)
        self.names = [item.name for item in self.items]
        self.mass_kg = sum(item.slide.mass_kg for item in self.items if item.slide is not None)
        bodies = [self._add_body(spec, k) for k in range(len(self.items))]
        for k, item in enumerate(self.items):
            body = bodies[self.carrier[k]] if item.part_of is not None else bodies[k]
            self._add_geom(spec, body, k, geom)
        self._let_hands_hold(spec)

    def _add_body(self, spec: Any, k: int) -> Any:
        """Add the body of an object that is part of no other, at the world's origin, with a joint where it slides."""
        item = self.items[k]
        if item.part_of is not None:
            return None
        body = spec.worldbody.add_body(name=f"{PREFIX}{item.name}")
        if item.slide is not None:
            slide = item.slide
            body.explicitinertial = True
            body.mass, body.inertia, body.ipos = slide.mass_kg, np.full(3, slide.mass_kg), item.position_m
            body.add_joint(
                name=f"{PREFIX}{item.name}", type=self._mujoco.mjtJoint.mjJNT_SLIDE, axis=slide.direction(),
                limited=True, range=(0.0, slide.range_m), damping=slide.damping_n_s_m,
                frictionloss=slide.friction_n,
            )  # fmt: skip
        return body

    def _add_geom(self, spec: Any, body: Any, k: int, geom: Mapping[str, Any]) -> None:
        vertices, faces = triangles(self.items[k])
        mesh = spec.add_mesh(name=f"object{k}", inertia=self._mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        mesh.uservert = vertices.ravel().tolist()
        mesh.userface = faces.ravel().tolist()
        bit = GRASPABLE_BIT if self.items[k].graspable else FLOOR_BIT
        body.add_geom(
            name=f"{PREFIX}{self.names[k]}", type=self._mujoco.mjtGeom.mjGEOM_MESH, meshname=f"object{k}", mass=0.0,
            rgba=OBJECT_COLOUR, contype=bit, conaffinity=0, **geom,
        )  # fmt: skip

    def _let_hands_hold(self, spec: Any) -> None:
        """Prepare a weld of each hand to each thing that can be grasped, and a point in each hand to measure from."""
        mujoco, robot = self._mujoco, self._robot
        self._hands: dict[int, str] = {}
        for i, side in enumerate(SIDES):
            if not robot.has(f"{side}_hand") or not any(item.graspable for item in self.items):
                continue
            frame = robot.model.frames[robot.frame_id(f"{side}_hand")]
            self._hands[i] = hand = robot.model.names[frame.parentJoint]
            spec.body(hand).add_geom(
                name=f"{_HELD}/{side}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(_POINT_M, 0.0, 0.0), mass=0.0,
                pos=frame.placement.translation, contype=0, conaffinity=0, group=3,
            )  # fmt: skip
            for item in self.items:
                if item.graspable:
                    spec.add_equality(
                        name=f"{_HELD}/{side}/{item.name}", type=mujoco.mjtEq.mjEQ_WELD, active=False,
                        objtype=mujoco.mjtObj.mjOBJ_BODY, name1=f"{PREFIX}{item.part_of or item.name}", name2=hand,
                    )  # fmt: skip

    # ------------------------------------------------------------------ compiled

    def compiled(self, model: Any) -> None:
        """Look up joints, welds and geoms in the compiled model."""
        self._slides = [
            (k, int(model.joint(f"{PREFIX}{self.names[c]}").qposadr[0]), self._direction(c))
            for k, c in enumerate(self.carrier)
            if c >= 0
        ]
        self._welds: dict[tuple[int, int], int] = {}
        for i in self._hands:
            for k, item in enumerate(self.items):
                if item.graspable:
                    self._welds[i, k] = int(model.equality(f"{_HELD}/{SIDES[i]}/{item.name}").id)
        self._geoms = [int(model.geom(f"{PREFIX}{name}").id) for name in self.names]
        self._points = {i: int(model.geom(f"{_HELD}/{SIDES[i]}").id) for i in self._hands}

    def _direction(self, k: int) -> Array:
        slide = self.items[k].slide
        assert slide is not None
        return slide.direction()

    def shift(self, qpos: Array) -> Array:
        """Return how far each object is from where it is written, in world, shape (K, 3) [m]."""
        out = np.zeros((len(self.items), 3))
        for k, address, direction in self._slides:
            out[k] = qpos[address] * direction
        return out

    def hold(self, model: Any, data: Any, wanted: IntArray, reach_m: float) -> None:
        """Weld hands to what they are to hold and are near enough to, and let go of the rest.

        A weld keeps the pose that hand and object have at that moment.

        Args:
            model, data: MuJoCo's, after a step.
            wanted: Number of the object that each hand is to hold, -1 for none, shape (2,).
            reach_m: How near to an object's surface a hand can take it [m].
        """
        for (i, k), weld in self._welds.items():
            if wanted[i] != k:
                data.eq_active[weld] = 0
            elif not data.eq_active[weld]:
                ends = self._points[i], self._geoms[k]
                self._mujoco.mj_kinematics(model, data)
                if self._mujoco.mj_geomDistance(model, data, *ends, reach_m + 1.0, None) <= reach_m:
                    self._fasten(model, data, weld)

    def holding(self, data: Any) -> IntArray:
        """Return the number of the object that each hand holds, -1 for none, shape (2,)."""
        out = np.full(2, -1)
        for (i, k), weld in self._welds.items():
            if data.eq_active[weld]:
                out[i] = k
        return out

    def _fasten(self, model: Any, data: Any, weld: int) -> None:
        mujoco = self._mujoco
        one, two = int(model.eq_obj1id[weld]), int(model.eq_obj2id[weld])
        back, turn, place = np.zeros(4), np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(back, data.xquat[one])
        mujoco.mju_mulQuat(turn, back, data.xquat[two])
        mujoco.mju_rotVecQuat(place, data.xpos[two] - data.xpos[one], back)
        model.eq_data[weld, :3] = 0.0
        model.eq_data[weld, 3:6], model.eq_data[weld, 6:10] = place, turn
        data.eq_active[weld] = 1


__all__ = ["FLOOR_BIT", "GRASPABLE_BIT", "PREFIX", "ROBOT_BIT", "Things"]
