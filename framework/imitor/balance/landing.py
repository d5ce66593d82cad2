"""Where a robot can set one foot flat while it stands on the other: found once a robot, then kept [pennapoubel2014] P5.

The region is that of the left sole seen from the right one, flat on the same floor, the soles' headings alike (or free
where the hips share a motor). At each of its points the robot can have its CoM over the foot that stands, between both
and over the one that landed: from there it can go on. Links of the two legs do not touch, and legs do not cross.
"""

from __future__ import annotations

from math import cos, pi, sin
from typing import Final

import numpy as np

from imitor.cache import cache_folder, fingerprint, kept
from imitor.collision.distances import Distances
from imitor.collision.shapes import robot_shapes
from imitor.ik.pose import PoseFinder
from imitor.robot.model import RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.types import Array

RAYS: Final = 32
STEP: Final = 0.03
"""Step outward along a ray, as a share of the leg's length [-]."""
FINE: Final = 3
"""How often the last step is halved."""
TOLERANCE: Final = 2e-3  # [m or rad]
APART_M: Final = 0.004
"""Least distance between links of the two legs, and between the soles sideways [m]."""
_ITERATIONS: Final = 30
_FORMAT: Final = "landing 2"


class LandingRegion:
    """The polygon in which the left sole can land, in the frame of the right one; mirrored for the other.

    Attributes:
        polygon: Its corners, counter-clockwise, shape (RAYS, 2) [m].
    """

    def __init__(self, polygon: Array) -> None:
        self.polygon = polygon
        self._edge = np.roll(polygon, -1, axis=0) - polygon
        self._length2 = np.maximum((self._edge**2).sum(axis=1), 1e-12)

    def contains(self, point: Array, side: int) -> bool:
        """Tell whether a point (2,) [m] in the frame of the standing sole lies in it; ``side`` lands, 0 is left."""
        x, y = float(point[0]), float(point[1]) if side == 0 else -float(point[1])
        a, b = self.polygon, np.roll(self.polygon, -1, axis=0)
        crosses = (a[:, 1] > y) != (b[:, 1] > y)
        rise = np.where(crosses, b[:, 1] - a[:, 1], 1.0)
        at = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
        return bool(np.count_nonzero(crosses & (x < at)) % 2)

    def nearest(self, point: Array, side: int) -> Array:
        """Return the point itself where it lies in the region, else the nearest of the region, shape (2,) [m]."""
        if self.contains(point, side):
            return point
        p = np.array([point[0], point[1] if side == 0 else -point[1]])
        along = np.clip(((p - self.polygon) * self._edge).sum(axis=1) / self._length2, 0.0, 1.0)
        on_edge = self.polygon + along[:, None] * self._edge
        best = on_edge[((on_edge - p) ** 2).sum(axis=1).argmin()]
        return np.asarray(best if side == 0 else best * [1.0, -1.0])


def landing_region(robot: RobotModel, *, free_yaw: bool) -> LandingRegion:
    """Return a robot's region, from the cache where it was found before."""
    key = fingerprint(
        _FORMAT,
        robot.files.model.read_bytes(),
        robot.card.model_dump_json(),
        str(free_yaw),
        f"{RAYS} {STEP} {FINE} {TOLERANCE} {APART_M} {_ITERATIONS}",
    )
    path = cache_folder() / "landing" / f"{robot.name}-{key}.npy"
    return LandingRegion(kept(path, lambda: _Explorer(robot.twin(), free_yaw).polygon()))


class _Explorer:
    """Walks outward from the standing place of the foot, along rays, as far as the robot can."""

    def __init__(self, robot: RobotModel, free_yaw: bool) -> None:
        self._robot = robot
        stack = TaskStack(robot.n)
        self._foot = stack.declare("left_foot", TaskKind.POSE, frame="left_foot")
        self._com = stack.declare("com", TaskKind.COM)
        stack.compile()
        stack.anchor = "right_foot"
        self._foot.mask[5] = not free_yaw
        self._com.mask[2] = False
        self._finder = PoseFinder(robot, stack, ["com", "left_foot"])
        q = robot.standing.copy()
        robot.update(q)
        robot.place(q, "right_foot", np.eye(4))
        self._start = q
        self._centre = robot.position("left_foot")[:2].copy()
        self._ankles = [
            robot.rotation(f"{s}_foot").T @ (robot.position(f"{s}_ankle") - robot.position(f"{s}_foot"))
            for s in ("left", "right")
        ]
        self._leg = sum(robot.segment_lengths()[f"left_{s}"] for s in ("thigh", "shank"))
        try:
            shapes = robot_shapes(robot, APART_M)
        except ValueError:  # no collision geometry: the soles alone keep apart
            self._distances = None
        else:
            self._distances = Distances(robot, shapes)
            legs = _legs(robot)
            joints = shapes.joint[shapes.pairs]
            self._between = (legs[joints[:, 0]] * legs[joints[:, 1]]) < 0

    def polygon(self) -> Array:
        """Return the corners, shape (RAYS, 2) [m]."""
        corners = []
        for k in range(RAYS):
            angle = 2.0 * pi * k / RAYS
            out = np.array([cos(angle), sin(angle)])
            q, reach, step = self._start.copy(), 0.0, STEP * self._leg
            for _ in range(FINE + 1):
                while (found := self._reached(q, self._centre + (reach + step) * out)) is not None:
                    q, reach = found, reach + step
                step *= 0.5
            corners.append(self._centre + reach * out)
        return np.array(corners)

    def _reached(self, start: Array, place: Array) -> Array | None:
        """Return a configuration with the foot there, the CoM over the right foot, or none."""
        self._foot.target[:2, 3] = place
        left, right = place + self._ankles[0][:2], self._ankles[1][:2]
        q, first = start.copy(), None
        if self._legs_cross(place):
            return None
        for com in (right, 0.5 * (left + right), left):
            self._com.target[:2] = com
            if self._finder.improve(q, _ITERATIONS, 0.5 * TOLERANCE) > TOLERANCE or self._legs_touch():
                return None
            first = q.copy() if first is None else first
        return first

    def _legs_cross(self, place: Array) -> bool:
        left, right = self._robot.sole[0, :, 1] + place[1], self._robot.sole[1, :, 1]
        return bool(left.min() - right.max() < APART_M)

    def _legs_touch(self) -> bool:
        if self._distances is None:
            return False
        near = self._distances.below(self._distances.shapes.margin)[0]
        return bool(self._between[near].any())


def _legs(robot: RobotModel) -> Array:
    """Return 1 for joints of the left leg, -1 for those of the right, else 0, shape (njoints,)."""
    out = np.zeros(robot.model.njoints)
    for role, sign in (("left_foot", 1.0), ("right_foot", -1.0)):
        joint = robot.model.frames[robot.frame_id(role)].parentJoint
        while joint > 1:
            out[joint] += sign
            joint = robot.model.parents[joint]
    return out
