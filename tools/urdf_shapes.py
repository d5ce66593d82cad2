"""Simple shapes for robot models: balls, boxes, cylinders, capsules in a link's frame [m], and their mirror images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

Point = tuple[float, float, float]
UPRIGHT: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Sphere:
    """A ball."""

    centre: Point
    radius: float
    colour: str = ""
    rpy: Point = UPRIGHT

    def mirrored(self) -> Sphere:
        """Return it on the other side."""
        return replace(self, centre=_across(self.centre))

    def parts(self) -> Sequence[Sphere]:
        """Return what URDF has a word for."""
        return (self,)


@dataclass(frozen=True)
class Box:
    """A box with edge lengths ``size``, turned by roll, pitch, yaw [rad]."""

    centre: Point
    size: Point
    colour: str = ""
    rpy: Point = UPRIGHT

    def mirrored(self) -> Box:
        """Return it on the other side."""
        roll, pitch, yaw = self.rpy
        return replace(self, centre=_across(self.centre), rpy=(-roll, pitch, -yaw))

    def parts(self) -> Sequence[Box]:
        """Return what URDF has a word for."""
        return (self,)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder from one point to another."""

    start: Point
    end: Point
    radius: float
    colour: str = ""

    @property
    def centre(self) -> Point:
        """Its middle."""
        (a, b, c), (d, e, f) = self.start, self.end
        return (0.5 * (a + d), 0.5 * (b + e), 0.5 * (c + f))

    @property
    def length(self) -> float:
        """From end to end."""
        return math.dist(self.start, self.end)

    @property
    def rpy(self) -> Point:
        """The turn that takes z to its axis."""
        x, y, z = (e - s for s, e in zip(self.start, self.end, strict=True))
        across = math.hypot(x, y)
        return (0.0, math.atan2(across, z), math.atan2(y, x) if across > 0 else 0.0)

    def mirrored(self) -> Cylinder:
        """Return it on the other side."""
        return replace(self, start=_across(self.start), end=_across(self.end))

    def parts(self) -> Sequence[Cylinder]:
        """Return what URDF has a word for."""
        return (self,)


@dataclass(frozen=True)
class Capsule:
    """A cylinder from one point to another with a half ball on each end."""

    start: Point
    end: Point
    radius: float
    colour: str = ""

    def mirrored(self) -> Capsule:
        """Return it on the other side."""
        return replace(self, start=_across(self.start), end=_across(self.end))

    def parts(self) -> Sequence[Cylinder | Sphere]:
        """Return what URDF has a word for; the cylinder first."""
        return (
            Cylinder(self.start, self.end, self.radius, self.colour),
            Sphere(self.start, self.radius, self.colour),
            Sphere(self.end, self.radius, self.colour),
        )


Shape = Sphere | Box | Cylinder | Capsule


def _across(p: Point) -> Point:
    return (p[0], -p[1], p[2])


def pair(shape: Shape) -> tuple[Shape, Shape]:
    """Return a shape and its mirror image."""
    return (shape, shape.mirrored())
