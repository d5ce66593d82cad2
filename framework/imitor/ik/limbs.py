r"""Damped least squares on all limbs at once, with the joint-limit weights of Chan and Dubey [chan1995].

.. math::
    \dot q = W^{-1} J^T (J W^{-1} J^T + \lambda^2 I)^{-1} e

Limbs share no joints: rows that are measured against the link that carries a limb touch that limb's columns only, so
the stacked :math:`J W^{-1} J^T` is block-diagonal and its one Cholesky factorisation solves every limb by itself. One
kinematics, one product, one factorisation an iteration stand for one each a limb.

The weight of joint i is :math:`1 + |\partial H / \partial q_i|` while it moves towards a limit and 1 while it moves
away, with

.. math::
    \frac{\partial H}{\partial q_i} =
    \frac{(q_u - q_l)^2 (2 q - q_u - q_l)}{4 (q_u - q)^2 (q - q_l)^2}.

A joint that rests keeps its weight: on its limit it would take a share of every step and lose it there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.linalg.lapack import dposv

from imitor.ik.layout import WORLD, Layout
from imitor.robot.model import BASE_NV, RobotModel
from imitor.types import SIDES, Array, BoolArray, IntArray

CHAINS: Final = ("left_arm", "right_arm", "left_leg", "right_leg", "trunk", "head", "shared")
GROUPS: Final = {
    "left_arm": "arms",
    "right_arm": "arms",
    "left_leg": "legs",
    "right_leg": "legs",
    "trunk": "trunk",
    "head": "head",
    "shared": "legs",
}
_NEAREST: Final = 1e-3  # [rad] from a limit, where the gradient is cut off


def chain_joints(robot: RobotModel) -> dict[str, BoolArray]:
    """Return the joints of each chain, shape (n,) each.

    A coupled joint whose partners lie in another chain belongs to neither: it is ``shared``. A joint that carries no
    role is of the trunk.
    """
    n = robot.n

    def moves(*roles: str) -> BoolArray:
        found = [robot.ancestors(r)[BASE_NV:] > 0 for r in roles if robot.has(r)]
        return np.any(found, axis=0) if found else np.zeros(n, dtype=bool)

    trunk = moves("chest")
    chains: dict[str, BoolArray] = {}
    for side in SIDES:
        chains[f"{side}_arm"] = moves(*(f"{side}_{r}" for r in ("elbow", "wrist", "hand"))) & ~trunk
        chains[f"{side}_leg"] = moves(f"{side}_foot")
    chains["head"] = moves("neck", "head") & ~trunk
    used = np.any(list(chains.values()), axis=0)
    chains["trunk"] = ~used
    shared = np.zeros(n, dtype=bool)
    if robot.coupling is not None:
        for column in robot.coupling.T:
            members = column != 0.0
            if members.sum() > 1 and not any((c | ~members).all() for c in chains.values()):
                shared |= members
    out = {name: joints & ~shared for name, joints in chains.items()}
    out["shared"] = shared
    return out


def limb_length(robot: RobotModel) -> float:
    """Return the length by which positions are divided, so that the damping has no unit: that of a leg [m]."""
    lengths = robot.segment_lengths()
    leg = lengths.get("left_thigh", 0.0) + lengths.get("left_shank", 0.0)
    return leg if leg > 0.0 else float(robot.standing[2])


class LimitWeights:
    r"""Chan and Dubey's weights, which know whether a joint came nearer to a limit since the last step.

    With :math:`t = (2 q - q_u - q_l) / (q_u - q_l)`, from -1 at the lower limit to 1 at the upper one, the gradient is
    :math:`4 |t| / ((q_u - q_l) (1 - t^2)^2)`: it grows with :math:`|t|` alone.

    Args:
        lower, upper: Joint limits, shape (n,) [rad].
    """

    def __init__(self, lower: Array, upper: Array) -> None:
        span = upper - lower
        self._slope, self._middle = 2.0 / span, (upper + lower) / span
        self._steep, self._most = 4.0 / span, 1.0 - 2.0 * _NEAREST / span
        self._t, self._last, self._d, self._inverse = (np.zeros_like(span) for _ in range(4))
        self._inward, self._one = np.zeros(span.shape, dtype=bool), np.ones_like(span)
        self.reset()

    def reset(self) -> None:
        """Forget the last joints."""
        self._last[:] = np.inf

    def inverse(self, q: Array) -> Array:
        """Return the diagonal of the inverse weight matrix at joint positions q, shape (n,); valid until the next."""
        t, d, inverse = self._t, self._d, self._inverse
        np.multiply(q, self._slope, out=t)
        np.subtract(t, self._middle, out=t)
        np.absolute(t, out=t)
        np.less(t, self._last, out=self._inward)
        self._t, self._last = self._last, t
        near = np.minimum(t, self._most, out=inverse)
        np.multiply(near, near, out=d)
        np.subtract(self._one, d, out=d)
        np.multiply(d, d, out=d)
        np.multiply(near, self._steep, out=inverse)
        np.add(inverse, d, out=inverse)
        np.divide(d, inverse, out=inverse)  # 1 / (1 + slope) for the slope steep t / d
        np.copyto(inverse, self._one, where=self._inward)
        return inverse


def length_rows(layout: Layout) -> BoolArray:
    """Return which rows are lengths [m]; the others are angles [rad]."""
    rows = np.zeros(layout.m, dtype=bool)
    for part in layout.translations:
        rows[part.rows] = True
    if layout.com is not None:
        rows[layout.com.rows] = True
    return rows


def in_world(layout: Layout) -> bool:
    """Tell whether a row is measured in the world, so that it matters where the base is."""
    relative = all(part.reference != WORLD for part in (*layout.translations, *layout.rotations))
    return not relative or layout.com is not None or layout.directions is not None


class DampedStep:
    """The weighted damped step of Jacobians of one shape, in arrays that are kept.

    Args:
        m, n: Shape of the Jacobian.
    """

    def __init__(self, m: int, n: int) -> None:
        self._weighted, self._gram = np.zeros((m, n)), np.zeros((m, m), order="F")
        self._diagonal = self._gram.reshape(-1, order="F")[:: m + 1]

    def __call__(self, J: Array, e: Array, inverse: Array, damping2: float) -> Array:
        """Return the step, shape (n,).

        Args:
            J: Jacobian, shape (m, n).
            e: Errors to remove, shape (m,).
            inverse: Diagonal of W^-1, shape (n,); 0 holds a joint still.
            damping2: Squared damping, greater than 0.
        """
        weighted, gram, diagonal = self._weighted, self._gram, self._diagonal
        np.multiply(J, inverse, out=weighted)
        np.dot(J, weighted.T, out=gram.T)
        np.add(diagonal, damping2, out=diagonal)
        _, y, _ = dposv(gram, e, 1, 1)  # the lower triangle, in place
        return np.asarray(y.dot(weighted))


def columns(chains: dict[str, BoolArray], names: Sequence[str]) -> BoolArray:
    """Return the joints of some chains, shape (n,)."""
    return np.asarray(np.any([chains[name] for name in names], axis=0))


class Rounds:
    """How many iterations each joint takes part in.

    Attributes:
        counts: By joint, shape (n,).
        most: Of any joint.
        free: Where the joints that move change: iteration -> joints that move from then on, shape (n,).
    """

    def __init__(self, counts: IntArray) -> None:
        self.counts, self.most = counts, int(counts.max())
        self.free = {int(k): counts > k for k in {0, *counts.tolist()}}


class Progress:
    """Where iterations with a tolerance end: within it, or where they bring nothing any more.

    Bringing nothing shows early where the error falls, but hardly, in one iteration: from there it falls ever less.
    An error that also rises needs more patience.

    Args:
        still: An iteration that takes no more than this share off the squared error is the last one.
        share: The squared error must fall to this share
        patience: within so many iterations.
    """

    def __init__(self, still: float, share: float, patience: int) -> None:
        self._still, self._share, self._patience = still, share, patience
        self._last, self._least, self._waited = np.inf, np.inf, 0

    def ends(self, relative: Array) -> bool:
        """Tell whether to stop at errors of which 1 is allowed, shape (m,)."""
        error = float(relative.dot(relative))
        if error <= relative.shape[0] and float(np.abs(relative).max(initial=0.0)) <= 1.0:
            return True
        gain, self._last = self._last - error, error
        if 0.0 <= gain < self._still * error:
            return True
        self._waited += 1
        if error < self._share * self._least:
            self._least, self._waited = error, 0
        return self._waited >= self._patience
