"""Points that move faster than a human can are taken for lost, until they are where a human could have gone."""

from __future__ import annotations

import numpy as np

from imitor.clock import copied
from imitor.types import N_ROLES, Array, BoolArray, HumanFrame, read_only


class Teleport:
    """Takes points out of a frame that cannot be where they are said to be.

    A point is trusted within ``speed_m_s`` times the time since it was last trusted, so one that stays at its new place
    is trusted again soon; the way there is then the business of `imitor.safety.following`.

    Args:
        speed_m_s: Largest speed of any point of a human [m/s].

    Attributes:
        rejected: Points taken for lost so far.
        left: Where roles were last trusted that are trusted again in the last frame, shape (R, 3) [m], NaN for the
            others; ``None`` where there is none.
    """

    def __init__(self, speed_m_s: float) -> None:
        self._speed = speed_m_s
        self.reset()

    def reset(self) -> None:
        """Forget all points."""
        self.rejected = 0
        self.left: Array | None = None
        self._at: Array = np.zeros((0, 3))
        self._time_s: Array = np.zeros(0)
        self._out: BoolArray = np.zeros(0, dtype=np.bool_)
        self._any_out = False

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Return the frame without the points that cannot be there; the same frame when all can."""
        points = _points(frame)
        time_s = frame.time_s
        self.left = None
        if len(points) != len(self._at):
            self._at = points.copy()
            self._time_s = np.where(np.isnan(points[:, 0]), -np.inf, time_s)
            self._out, self._any_out = np.zeros(len(points), dtype=np.bool_), False
            return frame
        way = points - self._at
        allowed = self._speed * (time_s - self._time_s)
        # False for NaN: not seen, or never seen before.
        far = np.einsum("ij,ij->i", way, way) > allowed * allowed
        seen = ~(far | np.isnan(points[:, 0]))
        if self._any_out:
            back = (self._out & seen)[:N_ROLES]
            if back.any():
                self.left = np.where(back[:, None], self._at[:N_ROLES], np.nan)
        np.copyto(self._at, points, where=seen[:, None])
        self._time_s[seen] = time_s
        count = int(np.count_nonzero(far))
        if count or self._any_out:
            self._out = np.asarray((self._out | far) & ~seen)
            self._any_out = bool(self._out.any())
        if not count:
            return frame
        self.rejected += count
        return _without(frame, np.asarray(far))


def _points(frame: HumanFrame) -> Array:
    parts = [frame.position]
    if frame.marker is not None:
        parts.append(frame.marker)
    if frame.target is not None:
        parts.append(frame.target[:, :3, 3])
    return np.concatenate(parts) if len(parts) > 1 else frame.position


def _without(frame: HumanFrame, far: BoolArray) -> HumanFrame:
    out = copied(frame, frame.time_s)
    roles, rest = far[:N_ROLES], far[N_ROLES:]
    if roles.any():
        out.valid = read_only(frame.valid & ~roles)
        out.position = read_only(np.where(roles[:, None], np.nan, frame.position))
        if frame.orientation is not None:
            out.orientation = read_only(np.where(roles[:, None, None], np.nan, frame.orientation))
        out.com = None  # it was made of points that are not trusted
    if frame.marker is not None and frame.marker_valid is not None:
        lost, rest = rest[: len(frame.marker)], rest[len(frame.marker) :]
        if lost.any():
            out.marker_valid = read_only(frame.marker_valid & ~lost)
            out.marker = read_only(np.where(lost[:, None], np.nan, frame.marker))
    if frame.target is not None and frame.target_valid is not None and rest.any():
        out.target_valid = read_only(frame.target_valid & ~rest)
        out.target = read_only(np.where(rest[:, None, None], np.nan, frame.target))
    return out


__all__ = ["Teleport"]
