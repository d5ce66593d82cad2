"""A MuJoCo model that only shows a robot: its parts, put where kinematics says, on a floor, in a soft light.

Any robot can be shown, whatever its model file: masses, joints and contacts play no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from imitor.types import Array
from imitor.visual.geometry import Part
from imitor.visual.offscreen import import_mujoco
from imitor.visual.stick import HEAD_COLOUR, HEAD_RADIUS, Stick

_BACKGROUND: Final = (0.955, 0.965, 0.975)
_FLOOR: Final = (0.955, 0.965, 0.975)
_GRID: Final = (0.70, 0.73, 0.77)
_SUN: Final = (0.62, 0.40, -1.0)
"""Direction of the light that casts shadows, in the axes of the picture: away, to the left, up."""


class Scene:
    """The robot's parts on a floor with a grid of one metre squares.

    Args:
        parts: From `imitor.visual.geometry.robot_parts`.
        objects: From `imitor.visual.geometry.object_parts`.
        size: Largest picture, width and height [px].
        field_of_view: Vertical opening angle of the camera [rad].
        azimuth: Direction of view [rad]; the light comes from over the camera's shoulder.
        reach: Distance from the point looked at within which shadows are cast [m].

    Attributes:
        model, data: MuJoCo's.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        objects: Sequence[Part],
        size: tuple[int, int],
        field_of_view: float,
        azimuth: float,
        reach: float,
    ) -> None:
        self._mujoco = mujoco = import_mujoco()
        spec = mujoco.MjSpec()
        _style(mujoco, spec, size, field_of_view, reach)
        _add_floor(mujoco, spec)
        _add_lamps(mujoco, spec, azimuth)
        self._joints = sorted({p.joint for p in parts})
        for joint in self._joints:
            body = spec.worldbody.add_body(name=f"joint{joint}", mocap=True)
            for k, part in enumerate(p for p in parts if p.joint == joint):
                _add_part(mujoco, spec, body, f"part{joint}_{k}", part)
        for k, part in enumerate(objects):
            body = spec.worldbody.add_body(name=f"object{k}", mocap=True)
            _add_part(mujoco, spec, body, f"object{k}", part)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        bodies = [self.model.body(f"joint{j}").id for j in self._joints]
        self._rows = self.model.body_mocapid[bodies]
        things = [self.model.body(f"object{k}").id for k in range(len(objects))]
        self._things = self.model.body_mocapid[np.array(things, dtype=int)]
        self._lamp = self.model.body_mocapid[self.model.body("lamp").id]

    def allow(self, size: tuple[int, int]) -> None:
        """Make room for pictures of this size in renderers made from now on [px]."""
        settings = self.model.vis.global_
        settings.offwidth, settings.offheight = size

    def pose(self, position: Array, quaternion: Array, target: Array, shift: Array) -> None:
        """Put the parts in place and the light over the point looked at.

        Args:
            position: Origins of all joints, shape (J, 3) [m].
            quaternion: Their rotations x y z w, shape (J, 4).
            target: Point looked at, shape (3,) [m].
            shift: How far each object was moved, shape (K, 3) [m].
        """
        data = self.data
        data.mocap_pos[self._rows] = position[self._joints]
        data.mocap_quat[self._rows] = quaternion[self._joints][:, [3, 0, 1, 2]]
        data.mocap_pos[self._things] = shift
        data.mocap_pos[self._lamp, :2] = target[:2]
        self._mujoco.mj_kinematics(self.model, data)
        self._mujoco.mj_camlight(self.model, data)


class Pencil:
    """Draws shapes into a filled scene; they last until it is filled again."""

    def __init__(self, scene: Any) -> None:
        self._mujoco, self._scene = import_mujoco(), scene

    def sphere(self, at: Array, radius: float, rgb: Sequence[float], alpha: float = 1.0) -> None:
        """Draw a ball."""
        kind = self._mujoco.mjtGeom.mjGEOM_SPHERE
        self._add(kind, np.full(3, radius), at, (*rgb, alpha))

    def disc(self, at: Array, radius: float, rgb: Sequence[float], alpha: float = 1.0) -> None:
        """Draw a thin round plate that lies flat."""
        kind = self._mujoco.mjtGeom.mjGEOM_CYLINDER
        self._add(kind, np.array([radius, 0.002, 0.0]), at, (*rgb, alpha))

    def projection(self, point: Array, rgb: Sequence[float], alpha: float = 1.0) -> None:
        """Mark a point's projection on the floor by a disc, joined to the point by a thin line."""
        foot = np.array([point[0], point[1], 0.006])
        self.disc(foot, 0.028, rgb, alpha)
        self.capsule(foot, point, 0.0035, rgb, alpha)

    def capsule(self, a: Array, b: Array, radius: float, rgb: Sequence[float], alpha: float = 1.0) -> None:
        """Draw a capsule from one point to another."""
        kind = self._mujoco.mjtGeom.mjGEOM_CAPSULE
        geom = self._add(kind, np.zeros(3), np.zeros(3), (*rgb, alpha))
        if geom is not None:
            self._mujoco.mjv_connector(geom, kind, radius, a, b)

    def human(
        self, stick: Stick, position: Array, valid: np.ndarray, head: Array | None, alpha: float
    ) -> None:
        """Draw the stick figure of one frame; bones with an end that is not known are left out."""
        for (a, b), radius, rgb in zip(stick.bones, stick.bone_radius, stick.bone_colour, strict=True):
            if valid[a] and valid[b]:
                self.capsule(position[a], position[b], float(radius), rgb, alpha)
        for joint, radius, rgb in zip(stick.joints, stick.joint_radius, stick.joint_colour, strict=True):
            if valid[joint]:
                self.sphere(position[joint], float(radius), rgb, alpha)
        if head is not None:
            self.sphere(head, HEAD_RADIUS, HEAD_COLOUR, alpha)

    def _add(self, kind: Any, size: Array, at: Array, rgba: Sequence[float]) -> Any | None:
        scene = self._scene
        if scene.ngeom >= scene.maxgeom:
            return None
        geom = scene.geoms[scene.ngeom]
        colour = np.array(rgba, dtype=np.float32)
        self._mujoco.mjv_initGeom(geom, kind, size, np.asarray(at, dtype=float), np.eye(3).ravel(), colour)
        geom.category = self._mujoco.mjtCatBit.mjCAT_DYNAMIC  # decoration would cast no shadow
        geom.specular, geom.shininess = 0.25, 0.4
        scene.ngeom += 1
        return geom


def _style(mujoco: Any, spec: Any, size: tuple[int, int], field_of_view: float, reach: float) -> None:
    visual = spec.visual
    width, height = size
    visual.global_.offwidth, visual.global_.offheight = width, height
    visual.global_.fovy = float(np.degrees(field_of_view))
    visual.quality.shadowsize, visual.quality.offsamples = 2048, 4
    visual.headlight.active = 1
    visual.headlight.ambient = (0.45, 0.45, 0.46)
    visual.headlight.diffuse = (0.26, 0.26, 0.26)
    visual.headlight.specular = (0.0, 0.0, 0.0)
    visual.map.znear, visual.map.zfar = 0.05 / reach, 100.0 / reach
    visual.map.shadowclip, visual.map.haze = 1.0, 0.4
    visual.rgba.haze = (*_BACKGROUND, 1.0)
    spec.stat.extent, spec.stat.center = reach, (0.0, 0.0, 0.8)
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=_BACKGROUND, rgb2=_BACKGROUND, width=32, height=192,
    )  # fmt: skip


def _add_floor(mujoco: Any, spec: Any) -> None:
    spec.add_texture(
        name="grid", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE, rgb1=_FLOOR, rgb2=_FLOOR, markrgb=_GRID, width=256, height=256,
    )  # fmt: skip
    material = spec.add_material(
        name="floor", texuniform=True, texrepeat=(2.0, 2.0), specular=0.0, shininess=0.0
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.0, 0.0, 1.0), material="floor", contype=0, conaffinity=0
    )


def _add_lamps(mujoco: Any, spec: Any, azimuth: float) -> None:
    """Hang the lamps on a body that goes along with the camera: shadows stay sharp far from the origin."""
    lamp = spec.worldbody.add_body(name="lamp", mocap=True)
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    away, left, up = _SUN
    kind = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    direction = (ca * away - sa * left, sa * away + ca * left, up)
    lamp.add_light(
        type=kind, pos=tuple(-4.0 * np.array(direction)), dir=direction, castshadow=True,
        diffuse=(0.50, 0.49, 0.47), specular=(0.25, 0.25, 0.25), ambient=(0.0, 0.0, 0.0),
    )  # fmt: skip
    back = (-ca * 0.5 + sa * 0.8, -sa * 0.5 - ca * 0.8, -0.6)
    lamp.add_light(
        type=kind, pos=(0.0, 0.0, 4.0), dir=back, castshadow=False,
        diffuse=(0.14, 0.15, 0.17), specular=(0.0, 0.0, 0.0), ambient=(0.0, 0.0, 0.0),
    )  # fmt: skip


def _add_part(mujoco: Any, spec: Any, body: Any, name: str, part: Part) -> None:
    surface = part.surface
    mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = surface.vertices.ravel().tolist()
    mesh.userface = surface.faces.ravel().tolist()
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=surface.rgba, contype=0, conaffinity=0, mass=0.0
    )
