"""Shapes of a robot's links as python-fcl objects, placed in the joints that carry them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from imitor.types import Array, IntArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


@dataclass(frozen=True)
class Shapes:
    """Shapes of a robot and the pairs of them to look at.

    Attributes:
        links: Name of the link of each shape.
        objects: One ``fcl.CollisionObject`` a shape.
        joint: Joint of the robot's model that carries each shape, (S,).
        rotation, translation: Placement in that joint's frame, (S, 3, 3) and (S, 3) [m].
        centre, radius: Bounding sphere in that joint's frame, (S, 3) and (S,) [m].
        pairs: Indices of the shapes of each pair, (P, 2).
        rule: How the pairs were chosen, for people.
    """

    links: list[str]
    objects: list[Any]
    joint: IntArray
    rotation: Array
    translation: Array
    centre: Array
    radius: Array
    pairs: IntArray
    rule: str


def robot_shapes(robot: RobotModel) -> Shapes:
    """Return the shapes of a robot: its primitives, and convex hulls of its meshes (kept on disk).

    Raises:
        ValueError: The model has no usable collision geometry; the message says why.
        UnknownLink: The card skips a pair with a link that is not in the model.
    """
    import fcl
    import pinocchio as pin

    from imitor.metrics.collision import full_configurations, robot_collision_model
    from imitor.metrics.kinematics import fresh_model

    full = fresh_model(robot.card, robot.files)
    found = robot_collision_model(robot, full)
    standing = full_configurations(full, robot.locked, robot.joint_names, robot.standing[None])[0]
    full_data, data = full.createData(), robot.model.createData()
    pin.forwardKinematics(full, full_data, standing)
    pin.forwardKinematics(robot.model, data, robot.standing)
    moved = {name: j for j, name in enumerate(robot.model.names)}
    links, objects, joints, placements, centres, radii = [], [], [], [], [], []
    for item in found.geometry.geometryObjects:
        at = item.parentJoint
        while at > 1 and full.names[at] not in moved:  # a locked joint moves with the one before it
            at = full.parents[at]
        joint = moved.get(full.names[at], 1)
        placement = data.oMi[joint].actInv(full_data.oMi[item.parentJoint] * item.placement)
        shape, centre, radius = _shape(item)
        links.append(full.frames[item.parentFrame].name)
        objects.append(fcl.CollisionObject(shape, fcl.Transform()))
        joints.append(joint)
        placements.append(placement)
        centres.append(placement.act(centre))
        radii.append(radius)
    return Shapes(
        links,
        objects,
        np.array(joints),
        np.array([p.rotation for p in placements]),
        np.array([p.translation for p in placements]),
        np.array(centres),
        np.array(radii),
        np.array([(p.first, p.second) for p in found.geometry.collisionPairs], dtype=int).reshape(-1, 2),
        found.rule,
    )


def _shape(item: Any) -> tuple[Any, Array, float]:
    """Return the python-fcl shape of a geometry and its bounding sphere in the shape's own frame."""
    import fcl

    shape, kind = item.geometry, type(item.geometry).__name__
    origin = np.zeros(3)
    if kind == "Box":
        sides = 2.0 * np.array(shape.halfSide)
        return fcl.Box(*sides), origin, 0.5 * float(np.linalg.norm(sides))
    if kind == "Sphere":
        return fcl.Sphere(shape.radius), origin, float(shape.radius)
    if kind == "Cylinder":
        half = float(shape.halfLength)
        return fcl.Cylinder(shape.radius, 2.0 * half), origin, float(np.hypot(shape.radius, half))
    if kind == "Capsule":
        half = float(shape.halfLength)
        return fcl.Capsule(shape.radius, 2.0 * half), origin, float(shape.radius + half)
    if not hasattr(shape, "num_points"):
        raise ValueError(f"the collision shape of '{item.name}' is a {kind}; use boxes, cylinders or meshes")
    points = np.array([shape.point(i) for i in range(shape.num_points)]).reshape(-1, 3)
    return hull(points)


def hull(points: Array) -> tuple[Any, Array, float]:
    """Return the convex hull of points (N, 3) [m] as a python-fcl shape, and a bounding sphere."""
    import fcl
    from scipy.spatial import ConvexHull

    found = ConvexHull(points)
    index = np.full(len(points), -1)
    index[found.vertices] = np.arange(len(found.vertices))
    corners = np.ascontiguousarray(points[found.vertices])
    faces = index[found.simplices]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    flat = np.hstack([np.full((len(faces), 1), 3), faces]).astype(np.int32).reshape(-1)
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    radius = float(np.linalg.norm(corners - centre, axis=1).max())
    return fcl.Convex(corners, len(faces), flat), centre, radius
