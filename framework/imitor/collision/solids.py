"""Convex solids as python-fcl shapes, each with a ball around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from imitor.types import Array

_EDGES: Final = 32
"""Edges of the prism around a cylinder: it stands out by 0.5 % of the radius."""


@dataclass(frozen=True)
class Part:
    """A solid fixed to a joint.

    Attributes:
        link: Name of the link, or of the object in the environment.
        joint: The joint that carries it; 0 is the world.
        placement: The solid's frame in the joint's, (4, 4).
        solid: A python-fcl shape.
        centre: Centre of a ball around the solid, in its frame, (3,) [m].
        radius: Radius of that ball [m].
        corners: Points in its frame whose convex hull, made thicker by `thickness`, is the solid, (K, 3) [m].
        thickness: See above [m].
    """

    link: str
    joint: int
    placement: Array
    solid: Any
    centre: Array
    radius: float
    corners: Array
    thickness: float = 0.0


@dataclass(frozen=True)
class Hull:
    """A convex polytope.

    Attributes:
        corners: Its corners, (V, 3) [m].
        faces: Its triangles, counter-clockwise seen from outside, (F, 3).
    """

    corners: Array
    faces: Any

    def solid(self) -> Any:
        """Return it as a python-fcl shape."""
        import fcl

        faces = np.hstack([np.full((len(self.faces), 1), 3), self.faces]).astype(np.int32)
        return fcl.Convex(self.corners, len(self.faces), faces.reshape(-1))

    def part(self, link: str, joint: int, placement: Array) -> Part:
        """Return it fixed to a joint."""
        centre = 0.5 * (self.corners.min(axis=0) + self.corners.max(axis=0))
        radius = float(np.linalg.norm(self.corners - centre, axis=1).max())
        return Part(link, joint, placement, self.solid(), centre, radius, self.corners)


@dataclass(frozen=True)
class Capsule:
    """All points within a radius of a segment.

    Attributes:
        ends: Ends of the segment, (2, 3) [m].
        radius: Its radius [m].
    """

    ends: Array
    radius: float

    def part(self, link: str, joint: int, placement: Array) -> Part:
        """Return it fixed to a joint."""
        import fcl

        axis = self.ends[1] - self.ends[0]
        length = float(np.linalg.norm(axis))
        across = np.linalg.svd(axis[None])[2][1:]  # two directions at right angles to the axis
        z = axis / length if length > 0.0 else np.cross(across[0], across[1])
        frame = np.eye(4)
        frame[:3, :3] = np.column_stack([across[0], np.cross(z, across[0]), z])
        frame[:3, 3] = self.ends.mean(axis=0)
        ends = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]) * length
        return Part(
            link, joint, placement @ frame, fcl.Capsule(self.radius, length), np.zeros(3),
            self.radius + 0.5 * length, ends, self.radius,
        )  # fmt: skip


def hull_of(points: Array) -> Hull:
    """Return the convex hull of points, (N, 3) [m].

    Raises:
        ValueError: The points lie in a plane, or are too few.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        raise ValueError("it has no volume") from None
    index = np.full(len(points), -1)
    index[found.vertices] = np.arange(len(found.vertices))
    corners = np.ascontiguousarray(points[found.vertices])
    faces = index[found.simplices]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return Hull(corners, faces)


def box(link: str, joint: int, placement: Array, sides: Array) -> Part:
    """Return a box with its centre at a placement; sides along x, y, z, (3,) [m]."""
    import fcl

    signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    radius = 0.5 * float(np.linalg.norm(sides))
    return Part(link, joint, placement, fcl.Box(*sides), np.zeros(3), radius, signs * sides)


def cylinder(link: str, joint: int, placement: Array, radius: float, length: float) -> Part:
    """Return a cylinder along z with its centre at a placement; radius and length [m]."""
    import fcl

    turn = np.linspace(0.0, 2.0 * np.pi, _EDGES, endpoint=False)
    rim = radius / np.cos(np.pi / _EDGES) * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    corners = np.concatenate([rim + np.array([0.0, 0.0, z * length]) for z in (-0.5, 0.5)])
    ball = float(np.hypot(radius, 0.5 * length))
    return Part(link, joint, placement, fcl.Cylinder(radius, length), np.zeros(3), ball, corners)


def sphere(link: str, joint: int, placement: Array, radius: float) -> Part:
    """Return a ball with its centre at a placement; radius [m]."""
    import fcl

    return Part(link, joint, placement, fcl.Sphere(radius), np.zeros(3), radius, np.zeros((1, 3)), radius)
