r"""Rows of places and rotations while a frame of the robot is anchored: those of the loops that are run most.

The anchor is held by placing the base, but no error and no Jacobian depends on where the base is once every target is
measured from a frame of the robot: a target in the world is one relative to the anchor. So the base stays still while
the joints iterate and is placed once at the end, an iteration updates the frames of its rows alone, and of the
references only those that the joints move are read again. In the axes of that still base,

.. math::
    e = R_r t + p_r - p_f, \qquad e = \log(T R_f^T R_r)

for the place t and the rotation T that frame f shall have, seen from its reference r. The rows of a place are left in
the base's axes: they are those of `imitor.ik.rows.TaskRows` turned as a whole, which changes no damped step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from imitor.ik.layout import WORLD, Layout, Part
from imitor.robot.model import BASE_NV, RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.types import Array, BoolArray, IntArray


@dataclass
class Reference:
    """What targets are measured from: a link, or the world as the anchor sees it.

    Attributes:
        moves: Whether the joints move it.
        link_R, link_p: Views of the pose of the link, or of the anchor.
        R, p: Its pose in the world of the still base.
        C, c: The world's pose in the anchor; ``None`` for a link.
    """

    moves: bool
    link_R: Array
    link_p: Array
    R: Array
    p: Array
    C: Array | None = None
    c: Array | None = None

    def begin(self, stack: TaskStack) -> None:
        """Read the anchor's pose of this frame."""
        if self.C is not None:
            pose = stack.anchor_pose
            self.C = pose[:3, :3].T
            self.c = -self.C.dot(pose[:3, 3])

    def update(self) -> None:
        """Read the pose at the robot's last update."""
        if self.C is not None and self.c is not None:
            self.R = self.link_R.dot(self.C)
            self.p = self.link_p + self.link_R.dot(self.c)


@dataclass
class Shift:
    """A place to reach: its target, where its goal in the base's axes is kept, and its reference."""

    target: Array
    goal: Array
    reference: Reference


@dataclass
class Turn:
    """A rotation to reach: its target, its frame, its rows' errors and axes in the arrays, and its reference."""

    target: Array
    R: Array
    axes: slice | IntArray
    e: Array
    W: Array
    reference: Reference


Measured = tuple[Reference, list[Shift], list[Turn]]


class AnchoredRows:
    """Errors and Jacobian of an anchored robot's rows, scaled to have no unit.

    Args:
        robot: The robot.
        layout: A layout that `fits`.
        stack: The tasks, for the anchor.
        moved: Joints that move, shape (n,).
        inverse_length: Factor of places, so that they have no unit [1/m].

    Attributes:
        e, J: Errors (m,) and Jacobian (m, n), or (m, n_u) where joints that move are coupled.
        coupling: Joints from independent ones, shape (n, n_u), where joints that move are coupled.
        scale: Factor of each row, shape (m,): that of its unit times the root of its weight.
        places: Which rows are places [m], shape (m,); the others are rotations [rad].
        served: Rows that a joint still moves, shape (m,).
    """

    def __init__(
        self, robot: RobotModel, layout: Layout, stack: TaskStack, moved: BoolArray, inverse_length: float
    ) -> None:
        self._robot, self._stack, self._moved = robot, stack, moved
        shifts = [p for p in layout.translations if layout.mask[p.rows][:, moved].any()]
        turns = [p for p in layout.rotations if layout.mask[p.rows][:, moved].any()]
        parts = [*shifts, *turns]
        rows = np.concatenate([p.rows for p in parts])
        n, m = len(shifts), len(rows)
        self.places = np.arange(m) < 3 * n
        root = np.ones(m) if layout.root_weight is None else layout.root_weight[rows]
        self.scale = root * np.where(self.places, inverse_length, 1.0)
        self._mask = layout.mask[rows] * moved * self.scale[:, None]
        self._free, self.served = self._mask, np.ones(m, dtype=bool)
        names = stack.names
        self._gain_of_row = np.array([names.index(p.task.name) for p in parts for _ in p.rows])
        self._held: dict[bytes, tuple[Array, BoolArray]] = {}

        self._references = {p.reference: self._reference(p) for p in parts}
        roles = [p.task.frame for p in parts] + [p.task.relative_to for p in parts if p.task.relative_to]
        self._frames = [
            robot.frame_id(role) for role in dict.fromkeys([*roles, stack.anchor]) if self._moves(role)
        ]

        self._error, self.e = np.zeros(m), np.zeros(m)
        self._W, self._full = np.zeros((m, 6)), np.zeros((m, robot.n))
        self.J = self._full
        self._spatial = robot.jacobian[:, BASE_NV:]
        self.coupling = _coupling(robot, moved)
        self._points, self._goals = np.ones(3 * n + 1), np.zeros((n, 3))
        self._ends = [
            (self._points[3 * i : 3 * i + 3], robot.position(p.task.frame)) for i, p in enumerate(shifts)
        ]
        self._wrenches = _wrenches(n)
        self._shifts = [self._shift(p, goal) for p, goal in zip(shifts, self._goals, strict=True)]
        self._turns, at = [], 3 * n
        for part in turns:
            self._turns.append(self._turn(part, slice(at, at + len(part.rows))))
            at += len(part.rows)
        measured = [
            (r, [s for s in self._shifts if s.reference is r], [t for t in self._turns if t.reference is r])
            for r in self._references.values()
        ]
        self._still: list[Measured] = [x for x in measured if not x[0].moves]
        self._moving: list[Measured] = [x for x in measured if x[0].moves]

    @staticmethod
    def fits(layout: Layout, moved: BoolArray) -> bool:
        """Tell whether a layout is anchored and has whole places and rotations only, some of which the joints move."""
        if layout.first or layout.com is not None or layout.directions is not None:
            return False
        whole = all(len(p.axes) == 3 for p in layout.translations)
        return whole and bool(layout.mask[:, moved].any())

    def _moves(self, role: str) -> bool:
        return bool(self._robot.ancestors(role)[BASE_NV:][self._moved].any())

    def _reference(self, part: Part) -> Reference:
        robot, world = self._robot, part.reference == WORLD
        role = self._stack.anchor if world else part.task.relative_to
        R, p = robot.rotation(role), robot.position(role)
        return Reference(
            self._moves(role), R, p, R, p, np.eye(3) if world else None, np.zeros(3) if world else None
        )

    def _shift(self, part: Part, goal: Array) -> Shift:
        task = part.task
        target = task.target if task.kind is TaskKind.POSITION else task.target[:3, 3]
        return Shift(target, goal, self._references[part.reference])

    def _turn(self, part: Part, rows: slice) -> Turn:
        task, axes = part.task, part.axes
        target = task.target if task.kind is TaskKind.ORIENTATION else task.target[:3, :3]
        neighbours = bool((np.diff(axes) == 1).all())
        return Turn(
            target,
            self._robot.rotation(task.frame),
            slice(int(axes[0]), int(axes[-1]) + 1) if neighbours else axes,
            self._error[rows],
            self._W[rows, 3:],
            self._references[part.reference],
        )

    def begin(self) -> None:
        """Take the targets of this frame to the still base, at the robot's last update."""
        for reference in self._references.values():
            reference.begin(self._stack)
        self._place(self._still)
        self._gains = self.scale * self._stack.flat_gain[self._gain_of_row]

    def hold(self, free: BoolArray) -> None:
        """Let only some of the joints move from now on, shape (n,)."""
        key = free.tobytes()
        if key not in self._held:
            mask = self._mask * free
            self._held[key] = mask, mask.any(axis=1)
        self._free, self.served = self._held[key]

    def assemble(self, q: Array) -> None:
        """Fill errors and Jacobian at a configuration whose base stands where it stood at `begin`, shape (nq,)."""
        self._robot.update_frames(q, self._frames)
        self._place(self._moving)
        for turn in self._turns:
            turn.e[:] = pin.log3(turn.target.dot(turn.R.T).dot(turn.reference.R))[turn.axes]
        if self._ends:
            self._assemble_places()
        np.multiply(self._error, self._gains, out=self.e)
        J = np.dot(self._W, self._spatial, out=self._full)
        np.multiply(J, self._free, out=J)
        self.J = J if self.coupling is None else J.dot(self.coupling)

    @staticmethod
    def _place(measured: Sequence[Measured]) -> None:
        """Read where references are, and take what is measured from them to the axes of the base."""
        for reference, shifts, turns in measured:
            reference.update()
            for shift in shifts:
                np.add(reference.R.dot(shift.target), reference.p, out=shift.goal)
            for turn in turns:
                turn.W[:] = reference.R.T[turn.axes]

    def _assemble_places(self) -> None:
        for point, end in self._ends:
            point[:] = end
        n = 3 * len(self._ends)
        np.subtract(self._goals.reshape(-1), self._points[:-1], out=self._error[:n])
        np.dot(self._wrenches, self._points, out=self._W.reshape(-1)[: 6 * n])


def _wrenches(n: int) -> Array:
    """Return the matrix that gives the wrenches of unit forces at n points, shape (18 n, 3 n + 1).

    Applied to the points' coordinates and a 1 it returns, for each point p and axis i, the wrench (e_i, p x e_i).
    """
    out = np.zeros((n, 3, 6, 3 * n + 1))
    for i in range(n):
        for axis in range(3):
            out[i, axis, axis, -1] = 1.0
            for k in range(3):  # e_k x e_axis is the moment for a unit coordinate k of the point
                out[i, axis, 3:, 3 * i + k] = np.cross(np.eye(3)[k], np.eye(3)[axis])
    return out.reshape(18 * n, 3 * n + 1)


def _coupling(robot: RobotModel, moved: BoolArray) -> Array | None:
    """Return the robot's coupling where coupled joints move."""
    S = robot.coupling
    if S is None:
        return None
    coupled = S[:, (S != 0.0).sum(axis=0) > 1]
    return S if (coupled[moved] != 0.0).any() else None
