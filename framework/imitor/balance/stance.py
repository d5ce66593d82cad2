"""How the robot stands in a configuration: measured on its own feet and CoM, not on what it was told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from imitor.metrics.polygon import Point, convex_hull, margin
from imitor.types import SIDES, Array

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

DOWN_M: Final = 0.003
"""A sole with every corner this near to the floor is down [m]."""


@dataclass(slots=True)
class Stance:
    """Feet and CoM of a configuration.

    Attributes:
        feet: Poses of the left and the right foot, world from foot, shape (4, 4) each.
        soles: Corners of both soles in world, shape (2, K, 3) [m].
        com: The CoM over the floor [m].
        down: Whether each sole lies on the floor.
    """

    feet: Sequence[Array]
    soles: Array
    com: Point
    down: Sequence[bool]

    @classmethod
    def of(cls, robot: RobotModel) -> Stance:
        """Measure the robot at its last `update`."""
        soles = robot.sole_corners()
        down = [low >= -DOWN_M and high <= DOWN_M for low, high in heights(soles)]
        feet = [robot.pose(f"{side}_foot") for side in SIDES]
        return cls(feet, soles, floor_point(robot.com), down)

    @classmethod
    def at(cls, twin: RobotModel, q: Array) -> Stance:
        """Measure a configuration (nq,) on a twin of the robot, which itself stays where it is."""
        twin.update(q)
        return cls.of(twin)

    def margin_m(self, foot: int) -> float:
        """Return how far inside a sole the CoM projects, negative outside [m]."""
        return margin(self.com, footprint([self.soles[foot]]))


def heights(soles: Array) -> list[tuple[float, float]]:
    """Return the lowest and the highest corner's height of both soles, shape (2, K, 3) [m]."""
    return [(min(z), max(z)) for z in soles[:, :, 2].tolist()]


def footprint(soles: Sequence[Array]) -> list[Point]:
    """Return the support polygon of soles, each of shape (K, 3) [m], on the floor."""
    return convex_hull([(x, y) for sole in soles for x, y, _ in sole.tolist()])


def floor_point(p: Array) -> Point:
    """Return the point on the floor under a point, shape (3,) [m]."""
    return float(p[0]), float(p[1])


def moved_inside(point: Point, hull: Sequence[Point], margin_m: float) -> Point:
    """Return the point on the way to the middle of a hull that first is a margin inside it.

    The middle itself where the hull is too small for the margin.

    Args:
        point: Where [m].
        hull: Corners, counter-clockwise, from `convex_hull`.
        margin_m: Wanted distance to every side [m].
    """
    n = len(hull)
    middle = (sum(x for x, _ in hull) / n, sum(y for _, y in hull) / n)
    share = 0.0
    for (ax, ay), (bx, by) in zip(hull, [*hull[1:], hull[0]], strict=True):
        dx, dy = bx - ax, by - ay
        length = (dx * dx + dy * dy) ** 0.5
        if length == 0.0:
            continue
        here = (dx * (point[1] - ay) - dy * (point[0] - ax)) / length
        there = (dx * (middle[1] - ay) - dy * (middle[0] - ax)) / length
        if here < margin_m:
            share = max(share, (margin_m - here) / (there - here) if there > margin_m else 1.0)
    return (
        point[0] + share * (middle[0] - point[0]),
        point[1] + share * (middle[1] - point[1]),
    )
