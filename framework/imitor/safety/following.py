"""The person whom the robot follows: as seen while tracking, going on and slowing down when lost, blended back.

All points of a frame (roles, markers, targets, CoM) and all its orientations are handled alike. On the way back each
point is where it is seen plus what is left of the offset that it had when it was seen again; the offset goes to zero
along a smooth step, so that nothing jumps and nothing moves faster beside its own motion than the options say.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from imitor.clock import copied
from imitor.human.rotations import exponential, logarithm
from imitor.safety.tracking import State, TrackingOptions
from imitor.types import N_ROLES, Array, HumanFrame, read_only

_WINDOW_S: Final = 0.05
"""Time over which a point's speed is taken [s]."""
_PEAK: Final = 1.5
"""Largest slope of the smooth step 3 u^2 - 2 u^3."""


class Following:
    """Makes the frame that mapper and stabilizers see.

    Args:
        options: How fast the way back may be, and how long the person goes on when lost.
        dt_s: Time between frames [s].

    Attributes:
        returned: Whether no offset is left.
    """

    def __init__(self, options: TrackingOptions, dt_s: float) -> None:
        self._options = options
        self._size = max(2, round(_WINDOW_S / dt_s) + 1)
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._past: deque[HumanFrame] = deque(maxlen=self._size)
        self._way: _WayBack | None = None
        self._slowing: _SlowingDown | None = None
        self.returned = True

    def step(self, frame: HumanFrame, state: State, left: Array | None = None) -> HumanFrame:
        """Return the frame to follow.

        Args:
            frame: The filtered frame.
            state: Where the tracking stands.
            left: Where roles were that are trusted again after they were taken for lost alone, shape (R, 3) [m].
        """
        seen = state in (State.TRACKING, State.RETURNING)
        if state is State.WAITING or not (seen or self._past):
            return frame
        out = self._seen(frame, left) if seen else self._unseen(frame.time_s)
        self._past.append(out)
        return out

    def _seen(self, frame: HumanFrame, left: Array | None) -> HumanFrame:
        if self._past and self._slowing is not None:
            self._way = _WayBack(self._past[-1], frame, self._options)
        elif left is not None:  # also on the way back, from where that has come to
            now = frame if self._way is None else self._way.step(frame)
            before = copied(now, frame.time_s)
            before.position = np.where(np.isnan(left), now.position, now.position - frame.position + left)
            self._way = _WayBack(before, frame, self._options)
        self._slowing = None
        if self._way is not None:
            out = self._way.step(frame)
            self._way = None if self._way.over else self._way
            self.returned = self._way is None
            return out
        self.returned = True
        return frame

    def _unseen(self, time_s: float) -> HumanFrame:
        if self._slowing is None:
            self._slowing = _SlowingDown(self._past[0], self._past[-1], self._options.predict_s)
        self._way, self.returned = None, False
        return self._slowing.step(time_s)


class _SlowingDown:
    """From a moving person to one who stands still: the speed goes down to zero in ``predict_s``."""

    def __init__(self, first: HumanFrame, last: HumanFrame, predict_s: float) -> None:
        self._last, self._predict_s = last, predict_s
        self._points = _points(last)
        between = last.time_s - first.time_s
        self._speed: Array = np.zeros_like(self._points)
        earlier = _points(first)
        if between > 0 and earlier.shape == self._points.shape:
            self._speed = np.nan_to_num((self._points - earlier) / between)

    def step(self, time_s: float) -> HumanFrame:
        T = self._predict_s
        t = min(time_s - self._last.time_s, T)
        way = t - 0.5 * t * t / T if T > 0 else 0.0
        return _with_points(copied(self._last, time_s), self._points + way * self._speed)


class _WayBack:
    """From where points were left to where they are seen."""

    def __init__(self, left: HumanFrame, seen: HumanFrame, options: TrackingOptions) -> None:
        alike = _alike(left, seen)
        self._offset = np.nan_to_num(_points(left) - _points(seen)) if alike else np.zeros((0, 3))
        self._turn: Array = np.zeros((0, 3))
        if alike:
            turn = logarithm(_rotations(left) @ _rotations(seen).transpose(0, 2, 1))
            self._turn = np.nan_to_num(turn)
        offset, turn = self._offset, self._turn
        far = float(np.sqrt((offset * offset).sum(axis=1).max(initial=0.0)))
        turned = float(np.sqrt((turn * turn).sum(axis=1).max(initial=0.0)))
        self._start_s = left.time_s
        self._lasts_s = _PEAK * max(far / options.blend_m_s, turned / options.blend_rad_s)
        self.over = False

    def step(self, frame: HumanFrame) -> HumanFrame:
        u = (frame.time_s - self._start_s) / self._lasts_s if self._lasts_s > 0 else 1.0
        if u >= 1.0:
            self.over = True
            return frame
        left = 1.0 - u * u * (3.0 - 2.0 * u)
        points = _points(frame)
        if points.shape != self._offset.shape:
            self.over = True
            return frame
        out = _with_points(copied(frame, frame.time_s), points + left * self._offset)
        return _turned(out, left * self._turn) if len(self._turn) else out


def _points(frame: HumanFrame) -> Array:
    """Return all points of a frame, roles first, shape (N, 3) [m]; NaN where not known."""
    parts = [frame.position]
    if frame.marker is not None:
        parts.append(frame.marker)
    if frame.target is not None:
        parts.append(frame.target[:, :3, 3])
    parts.append(np.full((1, 3), np.nan) if frame.com is None else frame.com[None])
    return np.concatenate(parts)


def _rotations(frame: HumanFrame) -> Array:
    """Return all orientations of a frame, shape (N, 3, 3); NaN where not known."""
    parts = [np.zeros((0, 3, 3))]
    if frame.orientation is not None:
        parts.append(frame.orientation)
    if frame.target is not None:
        parts.append(frame.target[:, :3, :3])
    return np.concatenate(parts)


def _alike(a: HumanFrame, b: HumanFrame) -> bool:
    same = [(getattr(a, n) is None) == (getattr(b, n) is None) for n in ("orientation", "marker", "target")]
    return all(same)


def _with_points(frame: HumanFrame, points: Array) -> HumanFrame:
    """Give a frame other points, in the order of `_points`."""
    at = N_ROLES
    frame.position = read_only(points[:at].copy())
    if frame.marker is not None:
        n = len(frame.marker)
        frame.marker, at = read_only(points[at : at + n].copy()), at + n
    if frame.target is not None:
        n = len(frame.target)
        target = frame.target.copy()
        target[:, :3, 3] = points[at : at + n]
        frame.target, at = read_only(target), at + n
    if frame.com is not None:
        frame.com = read_only(points[at].copy())
    return frame


def _turned(frame: HumanFrame, turn: Array) -> HumanFrame:
    """Turn all orientations of a frame by rotation vectors in world, shape (N, 3) [rad]."""
    turned = exponential(turn) @ _rotations(frame)
    at = 0
    if frame.orientation is not None:
        at = len(frame.orientation)
        frame.orientation = read_only(turned[:at].copy())
    if frame.target is not None:
        target = frame.target.copy()
        target[:, :3, :3] = turned[at:]
        frame.target = read_only(target)
    return frame


__all__ = ["Following"]
