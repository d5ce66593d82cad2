"""The visible geoms of an MJCF model, as MuJoCo itself compiles them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from imitor.errors import RobotError
from imitor.robot.files import ModelFiles
from imitor.types import Array
from imitor.visual import shapes
from imitor.visual.shapes import Colour4, Surface

_VISIBLE_GROUPS: Final = (0, 1, 2)
"""Geom groups that MuJoCo shows by default; models put collision shapes into higher ones."""


def read_geoms(files: ModelFiles) -> list[tuple[str, Surface]]:
    """Return (body name, surface in the body's frame) of every visible geom of the robot.

    Raises:
        RobotError: MuJoCo cannot read the file.
    """
    from imitor.visual.offscreen import import_mujoco

    mujoco = import_mujoco()
    try:
        model = mujoco.MjModel.from_xml_path(str(files.model))
    except ValueError as error:
        raise RobotError(f"{files.model}: MuJoCo cannot read it: {error}") from None
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] > 0]  # body 0 is the world with its floor
    shown = [g for g in geoms if model.geom_group[g] in _VISIBLE_GROUPS] or geoms
    out = []
    for g in shown:
        surface = _surface(mujoco, model, g)
        if surface is not None:
            out.append((model.body(model.geom_bodyid[g]).name, surface.moved(_placement(mujoco, model, g))))
    return out


def _surface(mujoco: Any, model: Any, g: int) -> Surface | None:
    kinds = mujoco.mjtGeom
    kind, size = int(model.geom_type[g]), model.geom_size[g]
    if kind == kinds.mjGEOM_MESH:
        m = model.geom_dataid[g]
        v, f = model.mesh_vertadr[m], model.mesh_faceadr[m]
        made = Surface(
            np.array(model.mesh_vert[v : v + model.mesh_vertnum[m]], dtype=np.float32),
            np.array(model.mesh_face[f : f + model.mesh_facenum[m]], dtype=np.int32),
        )
    elif kind == kinds.mjGEOM_BOX:
        made = shapes.box(2.0 * size)
    elif kind == kinds.mjGEOM_SPHERE:
        made = shapes.sphere(float(size[0]))
    elif kind == kinds.mjGEOM_ELLIPSOID:
        made = shapes.sphere(1.0).moved(np.diag([*size, 1.0]))
    elif kind == kinds.mjGEOM_CAPSULE:
        made = shapes.capsule(float(size[0]), 2.0 * float(size[1]))
    elif kind == kinds.mjGEOM_CYLINDER:
        made = shapes.cylinder(float(size[0]), 2.0 * float(size[1]))
    else:  # planes, height fields and distance fields are no part of a robot's surface
        return None
    return Surface(made.vertices, made.faces, _colour(model, g))


def _colour(model: Any, g: int) -> Colour4:
    material = model.geom_matid[g]
    r, g_, b, a = model.mat_rgba[material] if material >= 0 else model.geom_rgba[g]
    return (float(r), float(g_), float(b), float(a))


def _placement(mujoco: Any, model: Any, g: int) -> Array:
    """Return body from geom, shape (4, 4)."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[g])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.reshape(3, 3), model.geom_pos[g]
    return T
