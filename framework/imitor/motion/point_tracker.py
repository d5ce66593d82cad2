"""Points over time with losses: a linear Kalman filter a point, helped by points that move with it.

The state of a point is its position and velocity (and acceleration) in axes that move along with the body, so that a
walk does not leave lost points behind. While nothing is measured velocity and acceleration fade, and the point is
drawn to where it mostly is: limbs swing back. How much it is drawn is told by how much of the body's motion went to and
fro lately: nearly all in a walk, little in a person who stands up, whose points do not come back. A lost point whose
companions on the same segment are seen is measured through them: their shape is rigid, so the place where the point
was in it is where it is now.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from imitor.types import Array, BoolArray, IntArray

MODELS: Final = ("constant_velocity", "constant_acceleration")
_LEAST_MOVERS: Final = 3
"""Points seen in two frames that tell how the body moved."""
_VAGUE: Final = 3.0
"""How much noisier a place is that one or two companions tell [-]."""
_THIN: Final = 0.2
"""Companions that lie on a line, by the ratio of their second to their first spread, do not tell a rotation [-]."""


@dataclass(frozen=True)
class TrackerOptions:
    """How points are expected to move.

    Attributes:
        model: One of `MODELS`.
        acceleration_m_s2: Standard deviation of a point's acceleration [m/s^2].
        noise_m: Standard deviation of a measurement [m].
        acceleration_fading_s: After this time without measurement acceleration is down to 1/e [s].
        fading_s: After this time without measurement velocity is down to 1/e [s].
        pull_rad_s: How strongly a point is drawn to its home, as the frequency of a swing about it [rad/s].
        home_s: Its home is the mean of its places over about this time [s].
        swing_s: Whether the body swings or goes is told by its velocities over about this time [s].
        max_gap_s: A longer loss is not bridged [s].
        rigid: Whether companions help.
        rigid_noise_m: Standard deviation of a place told by three or more companions [m].
    """

    model: str = "constant_acceleration"
    acceleration_m_s2: float = 12.0
    noise_m: float = 0.001
    fading_s: float = 0.3
    acceleration_fading_s: float = 0.06
    pull_rad_s: float = 4.0
    home_s: float = 1.0
    swing_s: float = 0.5
    max_gap_s: float = 0.5
    rigid: bool = True
    rigid_noise_m: float = 0.005


class PointTracker:
    """Bridges the losses of points, frame by frame; it looks at no later frame and so has no delay.

    Args:
        n: Number of points.
        dt_s: Time between frames [s].
        companions: Of every point, by segment that it belongs to, the other points of that segment.
        options: How points are expected to move.
    """

    def __init__(
        self, n: int, dt_s: float, companions: Sequence[Sequence[Sequence[int]]], options: TrackerOptions
    ) -> None:
        self.options = options
        self.most_frames = int(np.floor(options.max_gap_s / dt_s + 1e-9))
        self._companions: list[list[IntArray]] = [
            [np.asarray(group, dtype=np.int_) for group in sorted(groups, key=len, reverse=True) if group]
            for groups in companions
        ]
        self._F, self._Q = _model(options, dt_s)
        self._F_free, _ = _model(replace(options, pull_rad_s=0.0), dt_s)
        self._blend = 1.0 - float(np.exp(-dt_s / options.home_s))
        self._swing_blend = 1.0 - float(np.exp(-dt_s / options.swing_s))
        self._n, self._order = n, len(self._F)
        self.reset()

    def reset(self) -> None:
        """Forget all points."""
        order, n = self._order, self._n
        self._x = np.zeros((n, order, 3))  # state in the moving axes
        self._P = np.zeros((n, order, order))
        self._home = np.zeros((n, 3))  # mean place in the moving axes
        self._mean_velocity, self._mean_square = np.zeros((n, 3)), np.zeros(n)
        self._age = np.full(n, -1)  # frames since a point was seen; -1: never
        self._last = np.full((n, 3), np.nan)  # measured in the frame before
        self._shape: list[tuple[Array, list[Array]] | None] = [
            None
        ] * n  # point and companions when last seen
        self._origin = np.zeros(3)
        self._step = np.zeros(3)

    def update(self, position: Array, seen: BoolArray) -> tuple[Array, BoolArray]:
        """Take the points of the next frame; return them with losses bridged.

        Args:
            position: Shape (N, 3) [m]; what is not seen is not looked at.
            seen: Shape (N,).

        Returns:
            Positions, NaN where not known, and which are known: seen or bridged.
        """
        measured = np.where(seen[:, None], position, np.nan)
        self._remember(self._last, seen)
        self._move(measured)
        swings = self._swings()
        F = swings * self._F + (1.0 - swings) * self._F_free
        self._x[:, 0] -= self._home
        self._x = np.einsum("ij,njk->nik", F, self._x)
        self._x[:, 0] += self._home
        self._P = F @ self._P @ F.T + self._Q
        new = seen & (self._age < 0)
        self._begin(new, measured)
        old = np.flatnonzero(seen & ~new)
        self._correct(old, measured[old], self.options.noise_m)
        self._age = np.where(seen, 0, np.where(self._age >= 0, self._age + 1, -1))
        lost = np.flatnonzero((self._age > 0) & (self._age <= self.most_frames))
        if self.options.rigid:
            for i in lost:
                self._help(int(i), measured)
        self._home[seen] += self._blend * (measured[seen] - self._origin - self._home[seen])
        v = self._x[seen, 1]
        self._mean_velocity[seen] += self._swing_blend * (v - self._mean_velocity[seen])
        self._mean_square[seen] += self._swing_blend * ((v * v).sum(axis=1) - self._mean_square[seen])
        known = seen | ((self._age > 0) & (self._age <= self.most_frames))
        out = np.where(seen[:, None], position, self._x[:, 0] + self._origin)
        out[~known] = np.nan
        return out, np.asarray(known)

    def _swings(self) -> float:
        """Return the share of the body's motion that went to and fro lately [-]: 1 - sum v_mean^2 / sum mean(v^2)."""
        whole = float(self._mean_square.sum())
        return 1.0 - float((self._mean_velocity**2).sum()) / whole if whole > 0.0 else 1.0

    def _move(self, measured: Array) -> None:
        """Move the axes with the body: by the median step of the points seen in this frame and the one before."""
        step = measured - self._last
        both = np.isfinite(step[:, 0])
        if both.sum() >= _LEAST_MOVERS:
            self._step = np.median(step[both], axis=0)
        self._origin = self._origin + self._step
        self._last = measured

    def _begin(self, new: BoolArray, measured: Array) -> None:
        o = self.options
        self._x[new] = 0.0
        self._x[new, 0] = self._home[new] = measured[new] - self._origin
        spread = [o.noise_m, o.acceleration_m_s2 * o.fading_s, o.acceleration_m_s2]
        self._P[new] = np.diag(np.square(spread[: self._order]))

    def _correct(self, rows: IntArray, places: Array, noise_m: float) -> None:
        """Correct the states of some points by their places in world, shape (K, 3)."""
        P = self._P[rows]
        gain = P[:, :, 0] / (P[:, 0, 0] + noise_m**2)[:, None]
        residual = places - self._origin - self._x[rows, 0]
        self._x[rows] += gain[:, :, None] * residual[:, None, :]
        self._P[rows] = P - gain[:, :, None] * P[:, :1, :]

    def _help(self, i: int, measured: Array) -> None:
        """Measure a lost point through its companions: by a segment that tells it fully, or by the mean of all."""
        shape = self._shape[i]
        if shape is None:
            return
        own, before = shape
        found = []
        for group, then in zip(self._companions[i], before, strict=True):
            now = measured[group]
            good = np.isfinite(now[:, 0]) & np.isfinite(then[:, 0])
            if not good.any():
                continue
            place, exact = _carried(own, then[good], now[good])
            if exact:
                found = [place]
                break
            found.append(place)
        if not found:
            return
        noise = self.options.rigid_noise_m * (1.0 if exact else _VAGUE)
        place = np.mean(found, axis=0)
        self._correct(np.array([i]), place[None], noise)

    def _remember(self, before: Array, seen: BoolArray) -> None:
        """Keep how points that have just been lost lay among their companions in the frame before."""
        for i in np.flatnonzero(np.isfinite(before[:, 0]) & ~seen):
            self._shape[i] = (before[i], [before[group] for group in self._companions[i]])


def _model(options: TrackerOptions, dt: float) -> tuple[Array, Array]:
    """Return transition and process noise of one axis.

    About its home a point moves by p'' = -w^2 p - p' / T + a, of a body that swings; w is 0 for one that goes on.
    Acceleration a is white (constant velocity), or a first-order process of its own, a' = -a / S + noise (constant
    acceleration).
    """
    T, S, sigma = options.fading_s, options.acceleration_fading_s, options.acceleration_m_s2
    rates = [[0.0, 1.0, 0.0], [-(options.pull_rad_s**2), -1.0 / T, 1.0], [0.0, 0.0, -1.0 / S]]
    order = 2 if options.model == "constant_velocity" else 3
    drive = np.zeros((order, order))
    drive[-1, -1] = sigma**2 * (2.0 * S if order == 2 else 2.0 / S)
    return _discrete(np.array(rates)[:order, :order], drive, dt)


def _discrete(A: Array, W: Array, dt: float) -> tuple[Array, Array]:
    """Return transition and noise over a time step of a system x' = A x + white noise of density W.

    Both are series in the step, which is short against the times in A.
    """
    n = len(A)
    F, term = np.eye(n), np.eye(n)
    for k in range(1, 12):
        term = term @ A * (dt / k)
        F = F + term
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -A, W, A.T
    whole, term = np.eye(2 * n), np.eye(2 * n)
    for k in range(1, 16):
        term = term @ block * (dt / k)
        whole = whole + term
    Q = F @ whole[:n, n:]
    return F, 0.5 * (Q + Q.T)


def _carried(own: Array, before: Array, now: Array) -> tuple[Array, bool]:
    """Return where a point is that is fixed to others, shape (3,), and whether they tell it fully.

    Three or more points off a line tell the rotation; two tell that of their line, one none.

    Args:
        own: The point when it was last seen, shape (3,).
        before, now: The others then and now, shape (K, 3).
    """
    a, b = before.mean(axis=0), now.mean(axis=0)
    arm = own - a
    if len(before) == 1:
        return b + arm, False
    A, B = before - a, now - b
    u, s, vt = np.linalg.svd(A.T @ B)
    if len(before) >= 3 and s[1] > _THIN**2 * s[0]:
        sign = np.sign(np.linalg.det(u @ vt))
        return b + (vt.T * [1.0, 1.0, sign]) @ u.T @ arm, True
    line, other = A[np.argmax((A * A).sum(1))], B[np.argmax((A * A).sum(1))]
    line, other = line / np.linalg.norm(line), other / np.linalg.norm(other)
    cosine = float(line @ other)
    if cosine < -0.99:
        return b + arm, False
    both = line + other  # the shortest turn: two mirrorings, at the half way between and at the line
    mirrored = arm - 2.0 * line * (line @ arm)
    return b + mirrored - both * (both @ mirrored) / (1.0 + cosine), False
