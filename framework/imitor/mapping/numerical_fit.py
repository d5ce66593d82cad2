"""Fit of marker positions alone, with differences in place of derivatives [ude2004]: what eq. 11 is compared with."""

from __future__ import annotations

import numpy as np

from imitor.mapping.virtual_markers import Criterion
from imitor.types import Array, BoolArray

_DELTA = 1e-6
"""Step of the finite differences [m or rad]."""
_MOST = 4
_DAMPING2 = 0.02**2
_LEAST_STEP = 1e-5


class NumericalFit:
    """Levenberg-Marquardt on the positions of the markers, from the last frame's coordinates.

    Args:
        prior: Pull of the joints towards the calibration pose, for those that the markers hardly show: on the forearm
            and the hand they are near the axes, and skin motion alone would turn an arm over [m/rad].
    """

    def __init__(self, prior: float) -> None:
        self._prior = prior

    def __call__(self, criterion: Criterion, goal: Array, real: Array) -> Array:
        """Return the whole way to the fit of this frame."""
        model = criterion.model
        n = len(criterion.arms.markers)
        seen = np.asarray(np.isfinite(goal[:n]).all(axis=1))
        start = model.q.copy()
        way = np.zeros(model.columns.size)
        for _ in range(_MOST):
            at = self._errors(criterion, goal[:n], seen)
            J = np.empty((at.size, way.size))
            q = model.q.copy()
            for k in range(way.size):
                nudge = np.zeros(way.size)
                nudge[k] = _DELTA
                model.move(nudge)
                J[:, k] = (self._errors(criterion, goal[:n], seen) - at) / _DELTA
                model.q[:] = q
            step = -np.linalg.solve(J.T @ J + _DAMPING2 * np.eye(way.size), J.T @ at)
            model.move(np.asarray(step, dtype=float))
            way += step
            if np.abs(step).max() < _LEAST_STEP:
                break
        model.q[:] = start
        model.update()
        return way

    def _errors(self, criterion: Criterion, goal: Array, seen: BoolArray) -> Array:
        model = criterion.model
        model.place()
        off = (goal - model.points()[: len(goal)])[seen].reshape(-1)
        return np.concatenate([off, self._prior * (criterion.rest[7:] - model.q[7:])])


__all__ = ["NumericalFit"]
