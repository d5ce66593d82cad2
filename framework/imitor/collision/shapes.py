"""Shapes of a robot and of the objects around it as python-fcl objects, and the pairs of them to keep apart."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.collision import solids
from imitor.collision.simplify import simple_shape
from imitor.collision.solids import Capsule, Hull, Part, hull_of
from imitor.collision.store import digest, kept
from imitor.types import SIDES, Array, IntArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

TOLERANCE_M: Final = 0.002
"""How far a simple shape may stand out from the full hull [m]."""
_STANDING_SLACK_M: Final = 5e-4
"""How much nearer than in the standing posture a pair may come that is near there: some never leave it [m]."""


@dataclass(frozen=True)
class Shapes:
    """Shapes and the pairs of them to look at.

    Attributes:
        links: Name of the link, or of the object in the environment, of each shape.
        objects: One ``fcl.CollisionObject`` a shape.
        joint: Joint of the robot's model that carries each shape, 0 for the world, (S,).
        rotation, translation: Placement in that joint's frame, (S, 3, 3) and (S, 3) [m].
        centre, radius: Bounding sphere in that joint's frame, (S, 3) and (S,) [m].
        corners, thickness: What each shape is the thickened hull of, in its own frame, (K, 3) and [m].
        pairs: Indices of the shapes of each pair, (P, 2).
        margin: Distance that each pair keeps, (P,) [m].
        rule: How the pairs were chosen, for people.
        n_objects: How many shapes, the last ones, are objects of the environment.
    """

    links: list[str]
    objects: list[Any]
    joint: IntArray
    rotation: Array
    translation: Array
    centre: Array
    radius: Array
    corners: list[Array]
    thickness: list[float]
    pairs: IntArray
    margin: Array
    rule: str
    n_objects: int = 0


def robot_shapes(
    robot: RobotModel, margin_m: float, obstacles: Sequence[Part] = (), graspable: Collection[str] = ()
) -> Shapes:
    """Return the shapes of a robot and of objects around it, and the pairs that shall keep a margin.

    Boxes, spheres, cylinders and capsules are taken as they are; a mesh becomes a simple shape around its convex
    hull. A pair that would then be nearer than the margin in the standing posture keeps the full hulls, and where even
    these are nearer, the pair keeps the distance it has there, less half a millimetre. The robot is left in it.

    Args:
        robot: The robot.
        margin_m: Distance to keep [m].
        obstacles: Objects in the world; links with a sole are not kept off them, for they stand on some.
        graspable: Names of objects that hands are not kept off.

    Raises:
        ValueError: The model has no usable collision geometry; the message says why.
        UnknownLink: The card skips a pair with a link that is not in the model.
    """
    import pinocchio as pin

    from imitor.collision.distances import Distances
    from imitor.collision.pairs import meeting_pairs
    from imitor.metrics.collision import full_configurations, robot_collision_model
    from imitor.metrics.kinematics import fresh_model
    from imitor.robot.hands import hand_joints

    model = fresh_model(robot.card, robot.files)
    found = robot_collision_model(robot, model)
    standing = full_configurations(model, robot.locked, robot.joint_names, robot.standing[None])[0]
    data = model.createData()
    pin.forwardKinematics(model, data, standing)
    robot.update(robot.standing)
    items = list(found.geometry.geometryObjects)
    points = [_points(item) for item in items]
    facts: list[Any] = []
    for item, corners in zip(items, points, strict=True):
        facts += [item.parentJoint, item.placement.homogeneous, type(item.geometry).__name__]
        facts.append(_size(item.geometry) if corners is None else corners)
    key = digest(facts)
    pairs = np.array([(p.first, p.second) for p in found.geometry.collisionPairs], dtype=int).reshape(-1, 2)
    rule = found.rule
    if robot.files.srdf is None:
        pairs = pairs[meeting_pairs(robot, found, key, margin_m)]
        rule += ", and those that never or always touch"
    joints, placements = _carriers(robot, model, data, items)
    links = [model.frames[item.parentFrame].name for item in items]
    simple = _simplified(robot.name, points)
    parts = []
    for k, item in enumerate(items):
        place = links[k], joints[k], placements[k]
        parts.append(simple[k].part(*place) if k in simple else _primitive(item, *place))
    shapes = assemble(parts, pairs, np.full(len(pairs), margin_m), rule)
    close = Distances(robot, shapes).below(margin_m)[0]
    if close.size:
        fine: dict[int, int] = {}
        for k in np.unique(pairs[close]).tolist():
            corners = points[k]
            if corners is not None:
                fine[k] = len(parts)
                parts.append(hull_of(corners).part(links[k], joints[k], placements[k]))
        pairs[close] = [[fine.get(k, k) for k in pair] for pair in pairs[close].tolist()]
        shapes = assemble(parts, pairs, np.full(len(pairs), margin_m), rule)
        close, distance, _, _ = Distances(robot, shapes).below(margin_m)
        shapes.margin[close] = distance - _STANDING_SLACK_M
    if not obstacles:
        return shapes
    feet = {robot.model.frames[robot.frame_id(f"{side}_foot")].parentJoint for side in SIDES}
    free = [k for k in range(len(items)) if joints[k] not in feet]
    hands = hand_joints(robot)
    new = [
        (k, len(parts) + i)
        for i, part in enumerate(obstacles)
        for k in free
        if part.link not in graspable or joints[k] not in hands
    ]
    everything = assemble(
        [*parts, *obstacles],
        np.vstack([pairs, np.array(new, dtype=int).reshape(-1, 2)]),
        np.append(shapes.margin, np.full(len(new), margin_m)),
        rule,
    )
    return replace(everything, n_objects=len(obstacles))


def assemble(parts: Sequence[Part], pairs: IntArray, margin: Array, rule: str = "") -> Shapes:
    """Return parts and pairs as `Shapes`."""
    import fcl

    rotation = np.array([p.placement[:3, :3] for p in parts]).reshape(-1, 3, 3)
    translation = np.array([p.placement[:3, 3] for p in parts]).reshape(-1, 3)
    centre = np.array([p.centre for p in parts]).reshape(-1, 3)
    return Shapes(
        [p.link for p in parts],
        [fcl.CollisionObject(p.solid, fcl.Transform(p.placement[:3, :3], p.placement[:3, 3])) for p in parts],
        np.array([p.joint for p in parts], dtype=int),
        rotation,
        translation,
        (rotation @ centre[:, :, None])[:, :, 0] + translation,
        np.array([p.radius for p in parts]),
        [p.corners for p in parts],
        [p.thickness for p in parts],
        pairs,
        margin,
        rule,
    )


def _carriers(
    robot: RobotModel, model: Any, data: Any, items: Sequence[Any]
) -> tuple[list[int], list[Array]]:
    """Return the moved joint that carries each geometry, and the geometry's placement there."""
    moved = {name: j for j, name in enumerate(robot.model.names)}
    joints, placements = [], []
    for item in items:
        at = item.parentJoint
        while at > 1 and model.names[at] not in moved:  # a locked joint moves with the one before it
            at = model.parents[at]
        joints.append(moved.get(model.names[at], 1))
        place = robot.data.oMi[joints[-1]].actInv(data.oMi[item.parentJoint] * item.placement)
        placements.append(place.homogeneous)
    return joints, placements


def _points(item: Any) -> Array | None:
    """Return the corners of a mesh, (N, 3) [m]; ``None`` for other shapes."""
    shape = item.geometry
    if not hasattr(shape, "num_points"):
        return None
    return np.array([shape.point(i) for i in range(shape.num_points)]).reshape(-1, 3)


def _size(shape: Any) -> list[float]:
    """Return the numbers that define a shape other than a mesh."""
    names = ("radius", "halfLength", "halfSide")
    return [x for n in names for x in np.atleast_1d(getattr(shape, n, ())).tolist()]


def _simplified(name: str, points: Sequence[Array | None]) -> dict[int, Hull | Capsule]:
    """Return the simple shape of every mesh, by its number; kept on disk."""
    meshes = {k: p for k, p in enumerate(points) if p is not None}

    def make() -> dict[str, Any]:
        out: dict[str, Any] = {}
        for k, corners in meshes.items():
            shape, _ = simple_shape(corners, TOLERANCE_M)
            if isinstance(shape, Capsule):
                out |= {f"ends{k}": shape.ends, f"radius{k}": shape.radius}
            else:
                out |= {f"corners{k}": shape.corners, f"faces{k}": shape.faces}
        return out

    if not meshes:
        return {}
    key = digest([TOLERANCE_M, *meshes, *meshes.values()])
    about = f"robot '{name}': simplifying collision shapes"
    arrays = kept(f"{name}-shapes-{key}", make, about=about)
    return {
        k: Hull(arrays[f"corners{k}"], arrays[f"faces{k}"])
        if f"corners{k}" in arrays
        else Capsule(arrays[f"ends{k}"], float(arrays[f"radius{k}"]))
        for k in meshes
    }


def _primitive(item: Any, link: str, joint: int, placement: Array) -> Part:
    shape, kind = item.geometry, type(item.geometry).__name__
    if kind == "Box":
        return solids.box(link, joint, placement, 2.0 * np.array(shape.halfSide))
    if kind == "Sphere":
        return solids.sphere(link, joint, placement, float(shape.radius))
    if kind == "Cylinder":
        return solids.cylinder(link, joint, placement, float(shape.radius), 2.0 * float(shape.halfLength))
    if kind == "Capsule":
        ends = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]) * float(shape.halfLength)
        return Capsule(ends, float(shape.radius)).part(link, joint, placement)
    raise ValueError(f"the collision shape of '{item.name}' is a {kind}; use boxes, cylinders or meshes")
