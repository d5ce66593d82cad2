"""Simple shapes around the parts of a robot: a capsule where one fits, else a convex polytope of few corners.

Both contain the part entirely, so that what they keep apart is apart, and stand out from its convex hull by no more
than a tolerance. Distances between two of them are too small by at most the sum of what they stand out.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.collision.solids import Capsule, Hull, hull_of
from imitor.types import Array

_CUTS_A_ROUND: Final = 6
"""Planes added before the corners are computed anew: fewer give fewer planes, more are found faster."""
_ROUNDS: Final = 200
_APART_RAD: Final = 0.2
"""Planes added in one round differ by more than this [rad]."""
_POINT_M: Final = 1e-6
"""Radius of the ball that stands for a point [m]."""


def simple_shape(points: Array, tolerance_m: float) -> tuple[Hull | Capsule, float]:
    """Return the simplest shape that contains points and stands out from their hull by no more than a tolerance.

    Args:
        points: Corners of a part, (N, 3) [m].
        tolerance_m: How far the shape may stand out [m].

    Returns:
        The shape, and how far it stands out [m].
    """
    full = hull_of(points)
    nearest = _Nearest(full)
    capsule = capsule_around(full.corners)
    excess = nearest.farthest(_surface_of(capsule))
    if excess <= tolerance_m:
        return capsule, excess
    few = _outer(full.corners, nearest, tolerance_m)
    if few is None or len(few.corners) >= len(full.corners):
        return full, 0.0
    return few, nearest.farthest(few.corners)


def capsule_around(points: Array) -> Capsule:
    """Return a capsule along the longest principal axis that contains points, (N, 3) [m]."""
    centre = points.mean(axis=0)
    axes = np.linalg.svd(points - centre, full_matrices=False)[2]
    spread = (points - centre) @ axes.T
    centre = centre + 0.5 * (spread.min(axis=0) + spread.max(axis=0)) @ axes
    along = (points - centre) @ axes[0]
    across = np.linalg.norm(points - centre - along[:, None] * axes[0], axis=1)
    radius = float(across.max())
    # a point at a distance a from the axis is inside when the segment comes within sqrt(r^2 - a^2) of it
    slack = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    low, high = float((along + slack).min()), float((along - slack).max())
    if low > high:
        low = high = 0.5 * (low + high)
        radius = float(np.hypot(along - low, across).max())
    return Capsule(centre + np.array([[low], [high]]) * axes[0], radius)


def _surface_of(capsule: Capsule) -> Array:
    """Return points spread over a capsule, its outermost ones among them, (N, 3)."""
    axis = capsule.ends[1] - capsule.ends[0]
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    side = np.linalg.svd(axis[None])[2][1:]
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    ring = np.cos(turn)[:, None] * side[0] + np.sin(turn)[:, None] * side[1]
    tilt = np.linspace(0.0, 0.5 * np.pi, 7)
    cap = (np.cos(tilt)[:, None, None] * ring + np.sin(tilt)[:, None, None] * axis).reshape(-1, 3)
    tube = np.linspace(0.0, 1.0, 9)[:, None, None] * (capsule.ends[1] - capsule.ends[0])
    parts = [
        capsule.ends[1] + capsule.radius * cap,
        capsule.ends[0] + capsule.radius * (cap - 2.0 * (cap @ axis)[:, None] * axis),
        (capsule.ends[0] + tube + capsule.radius * ring).reshape(-1, 3),
    ]
    return np.concatenate(parts)


def _outer(corners: Array, nearest: _Nearest, tolerance_m: float) -> Hull | None:
    """Return a polytope around a hull: planes that touch it are added where the polytope stands out most."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    centre = corners.mean(axis=0)
    axes = np.linalg.svd(corners - centre, full_matrices=False)[2]
    normals = np.concatenate([axes, -axes])
    try:
        for _ in range(_ROUNDS):
            planes = np.hstack([normals, -(corners @ normals.T).max(axis=0)[:, None]])
            tips = HalfspaceIntersection(planes, centre).intersections
            away, distance = nearest.to(tips)
            order = [k for k in np.argsort(-distance) if distance[k] > tolerance_m]
            if not order:
                return hull_of(_merged(tips))
            new: list[Array] = []
            for k in order:
                direction = away[k] / distance[k]
                if all(direction @ other < np.cos(_APART_RAD) for other in new):
                    new.append(direction)
                if len(new) == _CUTS_A_ROUND:
                    break
            normals = np.concatenate([normals, new])
    except QhullError:
        pass
    return None


def _merged(points: Array) -> Array:
    """Return points without those that repeat another within 1e-6 m."""
    _, first = np.unique(np.round(points * 1e6), axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])


class _Nearest:
    """Distances of points to a hull."""

    def __init__(self, hull: Hull) -> None:
        import fcl

        self._fcl = fcl
        self._hull = fcl.CollisionObject(hull.solid(), fcl.Transform())
        self._point = fcl.CollisionObject(fcl.Sphere(_POINT_M), fcl.Transform())
        self._request = fcl.DistanceRequest(True, False)

    def to(self, points: Array) -> tuple[Array, Array]:
        """Return vectors from the hull to points, and their lengths, (N, 3) and (N,) [m]; 0 for those within."""
        away = np.zeros((len(points), 3))
        for vector, p in zip(away, points, strict=True):
            self._point.setTranslation(p)
            result = self._fcl.DistanceResult()
            if self._fcl.distance(self._hull, self._point, self._request, result) > 0.0:
                vector[:] = p - np.asarray(result.nearest_points[0])
        return away, np.linalg.norm(away, axis=1)

    def farthest(self, points: Array) -> float:
        """Return the largest distance of points to the hull [m]."""
        return float(self.to(points)[1].max(initial=0.0))
