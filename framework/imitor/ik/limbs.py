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
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.linalg.lapack import dposv

from imitor.ik.layout import WORLD, Layout
from imitor.robot.model import BASE_NV, RobotModel
from imitor.types import SIDES, Array, BoolArray

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
    """Chan and Dubey's weights, which know whether a joint came nearer to a limit since the last step.

    Args:
        lower, upper: Joint limits, shape (n,) [rad].
    """

    def __init__(self, lower: Array, upper: Array) -> None:
        self._lower, self._upper = lower, upper
        self._range2, self._sum = (upper - lower) ** 2, upper + lower
        self.reset()

    def reset(self) -> None:
        """Forget the last joints."""
        self._last: Array | None = None

    def inverse(self, q: Array) -> Array:
        """Return the diagonal of the inverse weight matrix at joint positions q, shape (n,)."""
        above, below = np.maximum(self._upper - q, _NEAREST), np.maximum(q - self._lower, _NEAREST)
        slope = self._range2 * np.abs(2.0 * q - self._sum) / (4.0 * (above * below) ** 2)
        if self._last is None:
            self._last = slope
            return np.ones_like(q)
        weight = np.where(slope > self._last, 1.0 + slope, 1.0)
        self._last = slope
        return np.asarray(1.0 / weight)


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


def damped_step(J: Array, e: Array, inverse: Array, damping2: float) -> Array:
    """Return the weighted damped step.

    Args:
        J: Jacobian, shape (m, n).
        e: Errors to remove, shape (m,).
        inverse: Diagonal of W^-1, shape (n,); 0 holds a joint still.
        damping2: Squared damping, greater than 0.
    """
    weighted = J * inverse
    gram = weighted @ J.T
    gram.reshape(-1)[:: e.shape[0] + 1] += damping2
    _, y, _ = dposv(gram, e, lower=1)
    return np.asarray(y @ weighted)


def columns(chains: dict[str, BoolArray], names: Sequence[str]) -> BoolArray:
    """Return the joints of some chains, shape (n,)."""
    return np.asarray(np.any([chains[name] for name in names], axis=0))


class LimbRows:
    """Positions of limbs' ends against carriers that stay where they are: the rows of the loop that is run most.

    While only limbs move, chest and waist do not, so targets are taken to the world once a frame, and an iteration
    reads end points and the limbs' columns alone. The rows are those of `imitor.ik.rows.TaskRows` turned into the
    world's axes, which changes no damped step.

    Args:
        robot: The robot.
        layout: A layout that `fits`.
        moved: Joints that move, shape (n,).

    Attributes:
        joints: Indices of the joints that move.
        e, J: Errors (3 L,) and Jacobian (3 L, joints).
    """

    def __init__(self, robot: RobotModel, layout: Layout, moved: BoolArray) -> None:
        self._robot, self._parts = robot, layout.translations
        tasks = [part.task for part in self._parts]
        self._ends = [robot.position(t.frame) for t in tasks]
        self._carriers = [(robot.rotation(t.relative_to), robot.position(t.relative_to)) for t in tasks]
        self.joints = np.flatnonzero(moved)
        self._columns = BASE_NV + self.joints
        self._mask = np.concatenate([layout.mask[p.rows][:, self.joints] for p in self._parts])
        n = len(tasks)
        self._points, self._goals = np.zeros((n, 3)), np.zeros((n, 3))
        self._point_rows = list(self._points)
        self._gains = np.ones((n, 1))
        W = np.zeros((n, 3, 6))
        W[:, range(3), range(3)] = 1.0
        self._W = W.reshape(3 * n, 6)
        # moments p x e_i of the unit forces, as places in W and signed components of p
        self._moment = [(W[:, 0, 4], 2), (W[:, 1, 5], 0), (W[:, 2, 3], 1)]
        self._counter = [(W[:, 0, 5], 1), (W[:, 1, 3], 2), (W[:, 2, 4], 0)]

    @staticmethod
    def fits(robot: RobotModel, layout: Layout, moved: BoolArray) -> bool:
        """Tell whether a layout has whole relative positions only, on carriers that the moved joints leave alone."""
        if layout.first or layout.rotations or layout.root_weight is not None or in_world(layout):
            return False
        if (
            robot.coupling is not None
            and (robot.coupling[:, np.abs(robot.coupling).sum(axis=0) > 1][moved] != 0).any()
        ):
            return False
        carriers = [robot.ancestors(part.task.relative_to)[BASE_NV:] for part in layout.translations]
        whole = all(len(part.axes) == 3 for part in layout.translations)
        return bool(carriers) and whole and not (np.any(carriers, axis=0) & moved).any()

    def begin(self) -> None:
        """Take the targets of this frame to the world, at the robot's last update."""
        for i, (part, (R, p)) in enumerate(zip(self._parts, self._carriers, strict=True)):
            self._goals[i] = R @ part.task.target + p
            self._gains[i] = part.task.gain

    def assemble(self) -> None:
        """Fill errors and Jacobian at the robot's last update."""
        for row, view in zip(self._point_rows, self._ends, strict=True):
            row[:] = view
        points = self._points
        self.e = ((self._goals - points) * self._gains).reshape(-1)
        for place, axis in self._moment:
            place[:] = points[:, axis]
        for place, axis in self._counter:
            np.negative(points[:, axis], out=place)
        self.J = self._W @ self._robot.jacobian[:, self._columns]
        self.J *= self._mask


class Progress:
    """Where iterations with a tolerance end: within it, or where they bring nothing any more.

    Args:
        share: The squared error must fall to this share
        patience: within so many iterations.
    """

    def __init__(self, share: float, patience: int) -> None:
        self._share, self._patience = share, patience
        self._least, self._waited = np.inf, 0

    def ends(self, e: Array, allowed: Array) -> bool:
        """Tell whether to stop at errors e, shape (m,), of which ``allowed`` are allowed."""
        relative = np.abs(e) / allowed
        if relative.max() <= 1.0:
            return True
        error = float(relative @ relative)
        self._waited += 1
        if error < self._share * self._least:
            self._least, self._waited = error, 0
        return self._waited >= self._patience
