r"""Task rows: every scalar objective is a wrench, every Jacobian row one product with the spatial Jacobian.

A row that measures the velocity of a frame along an axis :math:`a` at the point :math:`p` is the wrench
:math:`w = (a, p \times a)` about the world's origin; one that measures rotation is :math:`w = (0, a)`. With
Pinocchio's world-frame spatial Jacobian :math:`{}^0 J` (6, nv) the Jacobian row is :math:`(w^T {}^0 J) \odot m`, where
the mask :math:`m` keeps the joints that carry the frame.

Relative frames and the anchor are differences of masks. Measured against a reference frame :math:`r` moving with the
robot, the row is :math:`(w^T\,{}^0J) \odot (m_f - m_r)`. Holding an anchor :math:`a` exactly makes the base's spatial
velocity :math:`-\,({}^0 J \odot m_a)\,\dot q`; eliminating the base therefore replaces every :math:`m` by
:math:`m - m_a` on the joint columns and drops the base's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from imitor.ik.layout import WORLD, Directions, Entry, Layout, make_layout
from imitor.ik.vectors import cross, skew, tangent_basis
from imitor.robot.model import BASE_NV, RobotModel
from imitor.tasks import TaskKind, TaskStack

SERVED = (
    TaskKind.POSITION,
    TaskKind.ORIENTATION,
    TaskKind.DIRECTION,
    TaskKind.VECTOR,
    TaskKind.POSE,
    TaskKind.COM,
)
_EYE = np.eye(3)


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
        tasks = [(stack[name], level) for level, names in enumerate(order) for name in names]
        roles = list(dict.fromkeys(role for t, _ in tasks for role in (t.frame, t.relative_to) if role))
        index = {"": WORLD, **{role: i for i, role in enumerate(roles)}}
        self._entries = [
            Entry(task, level, weights.get(task.name, 1.0), index[task.frame], index[task.relative_to])
            for task, level in tasks
        ]
        self._positions = [robot.position(r) for r in roles]
        self._rotations = [robot.rotation(r) for r in roles]
        self._masks = np.array([robot.ancestors(r) for r in roles]).reshape(len(roles), robot.nv)
        self._points = np.zeros((len(roles), 3))
        self._point_rows = list(self._points)
        self._layouts: dict[bytes, Layout] = {}

    def layout(self) -> Layout:
        """Return the layout of the tasks that are active now (kept for each combination of switches and anchor)."""
        key = self._stack.flat_switch.tobytes() + self._stack.anchor.encode()
        found = self._layouts.get(key)
        if found is None:
            found = make_layout(self._robot, self._stack, self._entries, self._masks)
            self._layouts[key] = found
        return found

    def assemble(self, layout: Layout, *, jacobian: bool = True) -> None:
        """Fill ``layout.e`` (and ``layout.J``) at the configuration of the robot's last update.

        Errors are times the gain of their task; rows are times the root of their weight.
        """
        for row, view in zip(self._point_rows, self._positions, strict=True):
            row[:] = view
        self._translations(layout)
        self._rotation_rows(layout)
        self._vector_rows(layout)
        if layout.directions is not None:
            self._directions(layout, layout.directions, jacobian)
        if jacobian:
            self._jacobian(layout)
        if layout.com is not None:
            self._com(layout, jacobian)
        if layout.root_weight is not None:
            layout.e *= layout.root_weight
            if jacobian:
                layout.J *= layout.root_weight[:, None]

    def _translations(self, layout: Layout) -> None:
        points, W = self._points, layout.W
        for part in layout.translations:
            task, point = part.task, points[part.frame]
            target = task.target if task.kind is TaskKind.POSITION else task.target[:3, 3]
            if part.reference == WORLD:
                error = target - point
            else:
                R = self._rotations[part.reference]
                error = target - (point - points[part.reference]) @ R
                axis = R.T[part.axes]
                W[part.rows, :3], W[part.rows, 3:] = axis, cross(point, axis)
            layout.e[part.rows] = (task.gain * error)[part.axes]
        if layout.world_rows.size:
            axis = W[layout.world_rows, :3]
            W[layout.world_rows, 3:] = (axis[:, None] @ skew(-points[layout.world_frame]))[:, 0]

    def _rotation_rows(self, layout: Layout) -> None:
        for part in layout.rotations:
            task, R = part.task, self._rotations[part.frame]
            target = task.target if task.kind is TaskKind.ORIENTATION else task.target[:3, :3]
            turn = target @ R.T
            if part.reference != WORLD:
                world_from_reference = self._rotations[part.reference]
                turn = turn @ world_from_reference
                layout.W[part.rows, 3:] = world_from_reference.T[part.axes]
            layout.e[part.rows] = (task.gain * pin.log3(turn))[part.axes]

    def _vector_rows(self, layout: Layout) -> None:
        """Errors along the cross product of forward axis and target [montecillo2010] eq. 5, times angle over sine.

        Two rows a task, across the axis: the turn about the axis itself stays free.
        """
        for part in layout.vectors:
            forward, target = self._rotations[part.frame][:, 0], part.task.target
            across = tangent_basis(forward[None])[0]
            turn = across @ cross(forward, target)
            sine, along = float(np.sqrt(turn @ turn)), float(forward @ target)
            if sine < 1e-9:
                turn[:] = (np.pi, 0.0) if along < 0.0 else (0.0, 0.0)  # opposite: any way round is as good
            else:
                turn *= np.arctan2(sine, along) / sine
            layout.e[part.rows] = part.task.gain * turn
            layout.W[part.rows, 3:] = across

    def _directions(self, layout: Layout, part: Directions, jacobian: bool) -> None:
        """Errors and wrenches of all direction tasks at once: the angle, and two unit forces across the segment."""
        start, end = self._points[part.proximal], self._points[part.distal]
        d = end - start
        length = np.sqrt(np.einsum("ij,ij->i", d, d))
        d /= length[:, None]
        target = self._stack.flat_target[part.target]
        basis = tangent_basis(d)  # (S, 2, 3)
        along = np.einsum("ij,ij->i", d, target)
        across = np.einsum("ijk,ik->ij", basis, target)
        sine = np.sqrt(np.einsum("ij,ij->i", across, across))
        if sine.min() < 1e-9:
            aligned = sine < 1e-9
            across[aligned & (along < 0.0)] = (1.0, 0.0)  # opposite: any way round is as good
            scale = np.arctan2(sine, along) / np.where(aligned, 1.0, sine)
        else:
            scale = np.arctan2(sine, along) / sine
        scale *= self._stack.flat_gain[part.gain]
        across *= scale[:, None]
        layout.e[part.rows] = across.reshape(-1)
        if jacobian:
            basis /= length[:, None, None]
            force = basis.reshape(-1, 3)
            part.near[:, :3] = part.far[:, :3] = force
            part.near[:, 3:] = (basis @ skew(-end)).reshape(-1, 3)
            part.far[:, 3:] = (basis @ skew(-start)).reshape(-1, 3)
            layout.W[part.rows] = part.near

    def _jacobian(self, layout: Layout) -> None:
        spatial = self._robot.jacobian[:, BASE_NV - layout.first :]
        np.matmul(layout.W, spatial, out=layout.J)
        layout.J *= layout.mask
        if layout.directions is not None:
            far = layout.directions.far @ spatial
            far *= layout.directions.far_mask
            layout.J[layout.directions.rows] -= far

    def _com(self, layout: Layout, jacobian: bool) -> None:
        part, com = layout.com, self._robot.com
        assert part is not None
        layout.e[part.rows] = (part.task.gain * (part.task.target - com))[part.axes]
        if not jacobian:
            return
        first = BASE_NV - layout.first
        layout.J[part.rows] = self._robot.com_jacobian[part.axes, first:]
        if layout.first == 0:  # the base moves with the joints between it and the anchor
            axis = _EYE[part.axes]
            wrench = np.hstack([axis, cross(com, axis)])
            layout.J[part.rows] += (wrench @ self._robot.jacobian[:, first:]) * layout.mask[part.rows]
