r"""Task rows: every scalar objective is a wrench, every Jacobian row one product with the spatial Jacobian.

A row that measures the velocity of a frame along an axis :math:`a` at the point :math:`p` is the wrench
:math:`w = (a, p \times a)` about the world's origin; one that measures rotation is :math:`w = (0, a)`. With
Pinocchio's world-frame spatial Jacobian :math:`{}^0 J` (6, nv) the Jacobian row is :math:`(w^T\, {}^0 J) \odot m`, where
the mask :math:`m` keeps the joints that carry the frame.

Relative frames and the anchor are differences of masks. Measured against a reference frame :math:`r` moving with the
robot, the row is :math:`(w^T\,{}^0J) \odot (m_f - m_r)`. Holding an anchor :math:`a` exactly makes the base's spatial
velocity :math:`-\,({}^0 J \odot m_a)\,\dot q`; eliminating the base therefore replaces every :math:`m` by
:math:`m - m_a` on the joint columns and drops the base's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from imitor.ik.vectors import cross, skew, tangent_basis
from imitor.robot.model import BASE_NV, RobotModel
from imitor.tasks import Task, TaskKind, TaskStack
from imitor.types import Array

SERVED = (TaskKind.POSITION, TaskKind.ORIENTATION, TaskKind.DIRECTION, TaskKind.POSE, TaskKind.COM)


@dataclass
class _Entry:
    """A task and what of it a layout needs."""

    task: Task
    level: int
    weight: float
    frame: int = -1
    reference: int = -1


@dataclass
class Layout:
    """Rows of the tasks active in a frame, in level order, and the arrays they are assembled into.

    Attributes:
        m, n: Numbers of rows and of columns.
        first: Columns of a free base (6), or 0 with an anchor.
        J, e: Jacobian and error, shapes (m, n) and (m,).
        level_of: Level of each row, shape (m,).
        n_levels: Number of levels with rows.
    """

    m: int
    n: int
    first: int
    J: Array
    e: Array
    level_of: Array
    n_levels: int
    starts: list[int]
    root_weight: Array
    weighted: bool
    W: Array
    mask: Array
    far_mask: Array
    directions: list[Task]
    direction_rows: Array
    distal: Array
    proximal: Array
    linear_rows: Array
    linear_frame: Array
    linear_axis: Array
    points: list[tuple[Task, Array, Array, int, int]] = field(default_factory=list)
    rotations: list[tuple[Task, Array, Array, int, int]] = field(default_factory=list)
    com_rows: Array = field(default_factory=lambda: np.zeros(0, dtype=int))
    com_axes: Array = field(default_factory=lambda: np.zeros(0, dtype=int))
    com_task: Task | None = None


class TaskRows:
    """Assembles error and Jacobian of the tasks in a solver's order.

    Args:
        robot: The robot, whose `update` the solver calls.
        stack: The compiled tasks.
        order: Levels, highest first, each a list of task names.
        weights: Weights within a level by task name; 1 where not given.
    """

    def __init__(
        self, robot: RobotModel, stack: TaskStack, order: Sequence[Sequence[str]], weights: dict[str, float]
    ) -> None:
        self._robot, self._stack = robot, stack
        self._entries = [
            _Entry(stack[name], level, weights.get(name, 1.0)) for level, names in enumerate(order) for name in names
        ]
        roles: list[str] = []
        for entry in self._entries:
            for attribute, role in (("frame", entry.task.frame), ("reference", entry.task.relative_to)):
                if role:
                    if role not in roles:
                        roles.append(role)
                    setattr(entry, attribute, roles.index(role))
        self._positions = [robot.position(r) for r in roles]
        self._rotations = [robot.rotation(r) for r in roles]
        self._masks = np.array([robot.ancestors(r) for r in roles]).reshape(len(roles), robot.nv)
        self._points = np.zeros((len(roles), 3))
        self._layouts: dict[bytes, Layout] = {}
        self._com = robot.com
        self._com_jacobian = robot.com_jacobian
        self._spatial = robot.jacobian

    def layout(self) -> Layout:
        """Return the layout of the tasks that are active now (cached by switches and anchor)."""
        key = self._stack.flat_switch.tobytes() + self._stack.anchor.encode()
        found = self._layouts.get(key)
        if found is None:
            found = self._layouts[key] = self._new_layout()
        return found

    def _new_layout(self) -> Layout:
        robot, anchor = self._robot, self._stack.anchor
        first = 0 if anchor else BASE_NV
        n = robot.nv - BASE_NV + first
        columns = slice(BASE_NV - first, None)
        held = robot.ancestors(anchor)[columns] if anchor else np.zeros(n)
        masks = self._masks[:, columns]

        rows: list[tuple[str, _Entry, int]] = []
        for entry in self._entries:
            task = entry.task
            if not task.active[0]:
                continue
            if task.kind is TaskKind.DIRECTION:
                rows += [("direction", entry, k) for k in range(2) if task.mask[0]]
            elif task.kind is TaskKind.COM:
                rows += [("com", entry, k) for k in range(3) if task.mask[k]]
            else:
                turn = 0 if task.kind is TaskKind.ORIENTATION else 3
                kinds = ["angular"] * 3 if turn == 0 else ["linear"] * 3 + ["angular"] * 3
                rows += [(kinds[k], entry, k if k < 3 else k - 3) for k in range(len(task.mask)) if task.mask[k]]
        m = len(rows)
        level_of = np.array([entry.level for _, entry, _ in rows], dtype=int)
        W, mask, far = np.zeros((m, 6)), np.zeros((m, n)), np.zeros((m, n))
        directions: list[Task] = []
        d_rows, distal, proximal = [], [], []
        lin_rows, lin_frame, lin_axis = [], [], []
        points: dict[int, tuple[Task, list[int], list[int], int, int]] = {}
        turns: dict[int, tuple[Task, list[int], list[int], int, int]] = {}
        com_rows, com_axes, com_task = [], [], None
        for i, (what, entry, axis) in enumerate(rows):
            task = entry.task
            if what == "com":
                com_rows.append(i)
                com_axes.append(axis)
                com_task = task
                mask[i] = -held
                continue
            reference = masks[entry.reference] if entry.reference >= 0 else held
            mask[i] = masks[entry.frame] - (held if what == "direction" else reference)
            if what == "direction":
                far[i] = masks[entry.reference] - held
                d_rows.append(i)
                if axis == 0:
                    directions.append(task)
                    distal.append(entry.frame)
                    proximal.append(entry.reference)
            elif what == "linear":
                lin_rows.append(i)
                lin_frame.append(entry.frame)
                lin_axis.append(np.eye(3)[axis])
                item = points.setdefault(id(task), (task, [], [], entry.frame, entry.reference))
                item[1].append(i)
                item[2].append(axis)
            else:
                W[i, 3 + axis] = 1.0
                item = turns.setdefault(id(task), (task, [], [], entry.frame, entry.reference))
                item[1].append(i)
                item[2].append(axis)
        weight = np.sqrt([entry.weight for _, entry, _ in rows])
        used = sorted(set(level_of.tolist()))
        compact = np.array([used.index(v) for v in level_of], dtype=int)
        pack = lambda d: [(t, np.array(r), np.array(a), f, ref) for t, r, a, f, ref in d.values()]  # noqa: E731
        return Layout(
            m=m, n=n, first=first, J=np.zeros((m, n)), e=np.zeros(m), level_of=compact, n_levels=len(used),
            starts=[int(np.argmax(compact == k)) for k in range(len(used))],
            root_weight=weight, weighted=bool((weight != 1.0).any()), W=W, mask=mask, far_mask=far,
            directions=directions, direction_rows=np.array(d_rows, dtype=int), distal=np.array(distal, dtype=int),
            proximal=np.array(proximal, dtype=int), linear_rows=np.array(lin_rows, dtype=int),
            linear_frame=np.array(lin_frame, dtype=int), linear_axis=np.array(lin_axis).reshape(-1, 3),
            points=pack(points), rotations=pack(turns), com_rows=np.array(com_rows, dtype=int),
            com_axes=np.array(com_axes, dtype=int), com_task=com_task,
        )  # fmt: skip

    def assemble(self, layout: Layout, *, jacobian: bool = True) -> None:
        """Fill ``layout.e`` (and ``layout.J``) at the configuration of the robot's last update.

        Errors are times the gain of their task; rows are times the root of their weight.
        """
        points, W, e, J = self._points, layout.W, layout.e, layout.J
        for row, view in zip(points, self._positions, strict=True):
            row[:] = view
        spatial = self._spatial[:, BASE_NV - layout.first :]

        for task, rows, axes, frame, reference in layout.points:
            target = task.target if task.kind is TaskKind.POSITION else task.target[:3, 3]
            if reference < 0:
                error = target - points[frame]
            else:
                R = self._rotations[reference]
                error = target - (points[frame] - points[reference]) @ R
                W[rows, :3] = R.T[axes]
                W[rows, 3:] = cross(points[frame], R.T[axes])
            e[rows] = task.gain * error[axes]
        if jacobian and layout.linear_rows.size:
            world = layout.linear_rows
            W[world, :3] = layout.linear_axis
            W[world, 3:] = (layout.linear_axis[:, None, :] @ -skew(points[layout.linear_frame]))[:, 0]
            for task, rows, axes, frame, reference in layout.points:
                if reference >= 0:
                    axis = self._rotations[reference].T[axes]
                    W[rows, :3], W[rows, 3:] = axis, cross(points[frame], axis)
        for task, rows, axes, frame, reference in layout.rotations:
            R = self._rotations[frame]
            target = task.target if task.kind is TaskKind.ORIENTATION else task.target[:3, :3]
            if reference < 0:
                error = pin.log3(target @ R.T)
            else:
                world_from_reference = self._rotations[reference]
                error = pin.log3(target @ R.T @ world_from_reference)
                W[rows, 3:] = world_from_reference.T[axes]
            e[rows] = task.gain * error[axes]
        if layout.directions:
            self._directions(layout, spatial, jacobian)
        if jacobian:
            np.matmul(W, spatial, out=J)
            J *= layout.mask
            if layout.directions:
                rows = layout.direction_rows
                J[rows] -= (self._far @ spatial) * layout.far_mask[rows]
        if layout.com_task is not None:
            task, rows, axes = layout.com_task, layout.com_rows, layout.com_axes
            e[rows] = task.gain * (task.target - self._com)[axes]
            if jacobian:
                J[rows] = self._com_jacobian[:, BASE_NV - layout.first :][axes]
                if layout.first == 0:
                    axis = np.eye(3)[axes]
                    wrench = np.hstack([axis, cross(self._com, axis)])
                    J[rows] += (wrench @ spatial) * layout.mask[rows]
        if layout.weighted:
            e *= layout.root_weight
            if jacobian:
                J *= layout.root_weight[:, None]

    def _directions(self, layout: Layout, spatial: Array, jacobian: bool) -> None:
        """Errors and wrenches of all direction tasks at once; two rows each, in the tangent plane."""
        points = self._points
        start, end = points[layout.proximal], points[layout.distal]
        d = end - start
        length = np.sqrt(np.einsum("ij,ij->i", d, d))
        d /= length[:, None]
        target = np.array([t.target for t in layout.directions])
        gain = np.array([t.gain[0] for t in layout.directions])
        basis = tangent_basis(d)  # (S, 2, 3)
        along = np.einsum("ij,ij->i", d, target)
        across = (basis @ target[:, :, None])[:, :, 0]  # (S, 2)
        sine = np.sqrt(np.einsum("ij,ij->i", across, across))
        angle = np.arctan2(sine, along)
        flat = (sine < 1e-9) & (along < 0)
        if flat.any():  # opposite: any way round is as good
            across[flat] = (1.0, 0.0)
            sine[flat] = 1.0
        scale = gain * angle / np.maximum(sine, 1e-12)
        layout.e[layout.direction_rows] = (across * scale[:, None]).reshape(-1)
        if jacobian:
            force = basis / length[:, None, None]
            rows = layout.direction_rows
            layout.W[rows, :3] = force.reshape(-1, 3)
            layout.W[rows, 3:] = cross(end[:, None, :], force).reshape(-1, 3)
            far = np.empty((rows.size, 6))
            far[:, :3] = force.reshape(-1, 3)
            far[:, 3:] = cross(start[:, None, :], force).reshape(-1, 3)
            self._far = far
