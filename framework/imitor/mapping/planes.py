"""Virtual planes of the body: how head, chest and waist are turned [montecillo2010] section 3.2, eq. 1.

A plane is spanned by three markers that move with one segment; its normal is the cross product of the unit vectors
from one of them to the others. Where the normal points depends on where the markers are stuck, so the constant turn
from plane to segment is found when the markers are first seen: upright, facing where the body does. Sources without
markers give the turn of the segment itself, or, with points alone, the plane of a line across the body and the torso.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from math import atan2, cos, hypot, sin

import numpy as np

from imitor.ik.vectors import cross3
from imitor.types import ROLE_INDEX, Array, BoolArray, HumanFrame, Skeleton

_FLAT = 0.05
"""Sine of the angle between plane vectors below which three markers are taken for a line [-]."""


class VirtualPlane:
    """How one segment is turned, from markers, from its orientation, or as it is told.

    Args:
        skeleton: Facts about the human.
        segment: Segment whose markers span the plane, as in ``marker_segments``.
        role: Role whose orientation is the segment's.

    Attributes:
        turn: World from segment (x forward, y left, z up), shape (3, 3).
    """

    def __init__(self, skeleton: Skeleton, segment: str, role: str) -> None:
        names = list(skeleton.marker_names)
        self._members = [
            names.index(n) for n in skeleton.marker_segments.get(segment, ()) if n in skeleton.marker_names
        ]
        self._role = ROLE_INDEX[role]
        self.reset()

    def reset(self) -> None:
        """Forget the markers and the last turn."""
        self._plane: list[int] = []
        self._constant: Array = np.eye(3)
        self.turn: Array = np.eye(3)

    def step(self, frame: HumanFrame, otherwise: Array) -> Array:
        """Return the turn in this frame, shape (3, 3); lost markers leave it as it was.

        Args:
            frame: The human.
            otherwise: The turn of the body as the points have it, shape (3, 3).
        """
        if len(self._members) >= 3 and frame.marker is not None and frame.marker_valid is not None:
            self._from_markers(frame.marker, frame.marker_valid, otherwise)
        elif frame.orientation is not None:
            R = frame.orientation[self._role]
            if np.isfinite(R).all():
                self.turn = R
        else:
            self.turn = otherwise
        return self.turn

    def _from_markers(self, marker: Array, valid: BoolArray, body: Array) -> None:
        if not self._plane:
            seen = [i for i in self._members if valid[i]]
            if len(seen) < 3:
                self.turn = body
                return
            self._plane = _widest(marker, seen)
            plane = _plane_of(marker[self._plane])
            if plane is None:
                self._plane = []
                return
            self._constant = plane.T @ upright(body)
        if valid[self._plane].all():
            plane = _plane_of(marker[self._plane])
            if plane is not None:
                self.turn = plane @ self._constant


def upright(turn: Array) -> Array:
    """Return the turn about the vertical alone that faces the same way, shape (3, 3)."""
    angle = atan2(float(turn[1, 0]), float(turn[0, 0]))
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def frame_of(left: Sequence[float], up: Sequence[float]) -> Array | None:
    """Return axes forward, left, up from a line to the left and one about upward; none when they are in line."""
    x = cross3(left, up)
    norm = hypot(*x)
    if norm < 1e-3:
        return None
    x = (x[0] / norm, x[1] / norm, x[2] / norm)
    z = cross3(x, left)
    return np.array([[x[0], left[0], z[0]], [x[1], left[1], z[1]], [x[2], left[2], z[2]]])


def _plane_of(points: Array) -> Array | None:
    """Return axes of the plane of three markers, the last one its normal, shape (3, 3); eq. 1."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = points.tolist()
    first, second = (bx - ax, by - ay, bz - az), (cx - ax, cy - ay, cz - az)
    length, other = hypot(*first), hypot(*second)
    if length < 1e-6 or other < 1e-6:
        return None
    x = (first[0] / length, first[1] / length, first[2] / length)
    normal = cross3(x, second)
    sine = hypot(*normal)
    if sine < _FLAT * other:
        return None
    z = (normal[0] / sine, normal[1] / sine, normal[2] / sine)
    y = cross3(z, x)
    return np.array([[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]])


def _widest(marker: Array, seen: Sequence[int]) -> list[int]:
    """Return the three markers that span the largest triangle."""

    def area(three: Iterable[int]) -> float:
        a, b, c = marker[list(three)]
        return hypot(*cross3((b - a).tolist(), (c - a).tolist()))

    return list(max(combinations(seen, 3), key=area))
