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
        down: Whether each sole lies on the floor.
        margin_m: How far inside each sole the CoM projects, negative outside [m].
    """

    feet: Sequence[Array]
    down: Sequence[bool]
    margin_m: Sequence[float]

    @classmethod
    def of(cls, robot: RobotModel) -> Stance:
        """Measure the robot at its last `update`."""
        soles = robot.sole_corners()
        com = floor_point(robot.com)
        return cls(
            [robot.pose(f"{side}_foot") for side in SIDES],
            [bool(abs(sole[:, 2]).max() <= DOWN_M) for sole in soles],
            [margin(com, footprint([sole])) for sole in soles],
        )

    @classmethod
    def at(cls, robot: RobotModel, q: Array, back: Array) -> Stance:
        """Measure the robot at a configuration (nq,), and leave it updated at another one."""
        robot.update(q)
        stance = cls.of(robot)
        robot.update(back)
        return stance


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
