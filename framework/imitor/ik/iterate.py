"""The loop that velocity-level solvers share: assemble the rows, find a step within bounds, move, hold the anchor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field

from imitor.errors import ImitorError
from imitor.kinds import Config, Solver
from imitor.tasks import TaskStack
from imitor.types import Array, Configuration

if TYPE_CHECKING:
    from imitor.ik.layout import Layout

Weight = Annotated[float, Field(gt=0)]
Bounds = tuple[Array, Array]
Gradient = Literal["limits", "posture"]


class IterativeConfig(Config):
    """Options that velocity-level solvers share."""

    order: Sequence[Sequence[str]] = Field(
        description="Levels of task names, highest priority first; a task of no level is ignored [-].",
        min_length=1,
    )
    weights: Mapping[str, Weight] = Field(
        {}, description="Weights within a level by task name; default 1 [-]."
    )
    null_space: Mapping[Gradient, float] = Field(
        {"limits": -0.10, "posture": -0.02},
        description="Gradient terms in the last null space: kappa of `limits` (eq. 7) and of `posture` (eq. 8) [-].",
    )
    iterations: int | None = Field(
        None, ge=1, le=1000, description="Most iterations per frame; none: 1 from 90 Hz on, else 2 [-]."
    )
    tolerance: float = Field(
        1e-4, ge=0, description="Stop when no task of a frame is further off than this [m or rad]."
    )
    max_step_rad: float = Field(0.25, gt=0, description="Largest joint step of one iteration [rad].")
    speed_limits: bool = Field(True, description="Treat joint speed limits as limits of the step too.")
    speed_share: float = Field(
        1.0, gt=0, le=1, description="How much of the joints' speed limits is used, for calmer motion [-]."
    )
    settle_iterations: int = Field(200, ge=1, description="Most iterations for the first frame [-].")


C = TypeVar("C", bound=IterativeConfig)


class IterativeSolver(Solver[C]):
    """Base of solvers that serve an order of tasks by bounded steps; a subclass writes `bounded_step`."""

    def bounded_step(self, layout: Layout, J: Array, g: Array, limits: Bounds, speeds: Bounds) -> Array:
        """Return the step of the free columns.

        Args:
            layout: Rows of this frame; ``layout.e`` holds the errors, ``layout.starts`` the levels.
            J: Jacobian of the rows in independent coordinates, shape (m, first + n_u).
            g: Gradient step for the last null space, shape (first + n_u,).
            limits: Lowest and highest joint steps to the position limits, shapes (n_u,).
            speeds: Lowest and highest joint steps by the speed limits, shapes (n_u,).
        """
        raise NotImplementedError

    def prepare(self, stack: TaskStack) -> None:
        """Look up the tasks of the order and compile their rows."""
        from imitor.ik.rows import SERVED, TaskRows

        order = [[name for name in level if name in stack] for level in self.config.order]
        for name in (name for level in order for name in level):
            if stack[name].kind not in SERVED:
                raise ImitorError(
                    f"'{name}' is a {stack[name].kind} task; put it under null_space, not in order"
                )
        robot = self.robot
        self._rows = TaskRows(robot, stack, order, dict(self.config.weights))
        self._posture: Array | None = stack["posture"].target if "posture" in stack else None
        self._middle = 0.5 * (robot.lower + robot.upper)
        self._limit_slope = 2 * self.config.null_space.get("limits", 0.0) / (robot.upper - robot.lower) ** 2
        self._posture_slope = 2 * self.config.null_space.get("posture", 0.0)
        self._independent = None if robot.coupling is None else robot.coupling.argmax(axis=0)
        self._step_limit = self.config.speed_share * robot.speed * self.dt_s
        self._unlimited = np.full(robot.n, np.inf)
        self._iterations = self.config.iterations or (1 if self.dt_s <= 1.0 / 90.0 else 2)

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Solve one frame from where the last one ended."""
        start = state.q[7:].copy()
        fast = self._step_limit if self.config.speed_limits else self._unlimited
        self._iterate(stack, state.q, (start - fast, start + fast), self._iterations)

    def settle(self, stack: TaskStack, state: Configuration) -> None:
        """Solve the first frame without speed limits, from several postures; the best end wins.

        Arms and legs have several ways to point in a direction, and joint limits between them: from one posture
        alone a limb may end at a limit and stay there. Where another solver has been before, its result is the start.
        """
        robot, far = self.robot, (-self._unlimited, self._unlimited)
        starts = [state.q[7:].copy()]
        if np.array_equal(starts[0], robot.standing[7:]):
            starts += [robot.joint_values(robot.card.t_pose), self._middle]
        best = state.q.copy()
        best_error: tuple[float, ...] = ()
        for joints in starts:
            q = state.q.copy()
            q[7:] = joints
            robot.update(q)
            self._iterate(stack, q, far, self.config.settle_iterations)
            layout = self._rows.layout()
            self._rows.assemble(layout, jacobian=False)
            error = tuple(np.sqrt(np.add.reduceat(layout.e**2, layout.starts)).tolist()) if layout.m else ()
            if not best_error or _better(error, best_error):
                best, best_error = q, error
        state.q[:] = best
        robot.update(state.q)

    def _iterate(self, stack: TaskStack, q: Array, reach: Bounds, most: int) -> None:
        robot, config = self.robot, self.config
        if stack.anchor and not robot.is_at(stack.anchor, stack.anchor_pose):
            robot.place(q, stack.anchor, stack.anchor_pose)
        layout = self._rows.layout()
        for k in range(most):
            self._rows.assemble(layout)
            if k > 0 and np.abs(layout.e).max(initial=0.0) < config.tolerance:
                break  # not before the first step: the gradients act even when every task is met
            self._move(layout, q, reach)
            if stack.anchor:
                robot.place(q, stack.anchor, stack.anchor_pose)

    def _move(self, layout: Layout, q: Array, reach: Bounds) -> None:
        robot, first, joints = self.robot, layout.first, q[7:]
        g = np.zeros(layout.n)
        g[first:] = self._limit_slope * (joints - self._middle)
        if self._posture is not None:
            g[first:] += self._posture_slope * (joints - self._posture)
        limits = (robot.lower - joints, robot.upper - joints)
        speeds = (np.minimum(reach[0] - joints, 0.0), np.maximum(reach[1] - joints, 0.0))
        if robot.coupling is None or self._independent is None:
            step = self.bounded_step(layout, layout.J, g, limits, speeds)
            moved = step[first:]
        else:
            S, pick = robot.coupling, self._independent
            J = np.hstack([layout.J[:, :first], layout.J[:, first:] @ S])
            reduced = np.concatenate([g[:first], S.T @ g[first:]])
            step = self.bounded_step(
                layout, J, reduced, (limits[0][pick], limits[1][pick]), (speeds[0][pick], speeds[1][pick])
            )
            moved = S @ step[first:]
        if first:
            q[:] = robot.integrate(q, np.concatenate([step[:first], moved]))
        else:
            joints += moved
        np.clip(joints, robot.lower, robot.upper, out=joints)
        robot.update(q)


def _better(errors: Sequence[float], others: Sequence[float]) -> bool:
    """Tell whether errors by level are clearly less, the higher level deciding first."""
    for mine, other in zip(errors, others, strict=True):
        if abs(mine - other) > 0.005 + 0.05 * other:
            return mine < other
    return False
