"""The prioritised solver: strict levels, gradients in the last null space, clamping loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from imitor import Component, Config, Configuration, Solver, Strictness, TaskKind, TaskStack, hookimpl
from imitor.errors import ImitorError
from imitor.types import Array

if TYPE_CHECKING:
    from imitor.ik.rows import Layout, TaskRows

Weight = Annotated[float, Field(gt=0)]


class PrioritizedConfig(Config):
    """Options of the prioritised solver."""

    order: Sequence[Sequence[str]] = Field(
        description="Levels of task names, highest priority first; a task of no level is ignored [-].", min_length=1
    )
    weights: Mapping[str, Weight] = Field({}, description="Weights within a level by task name; default 1 [-].")
    null_space: Mapping[str, float] = Field(
        {"limits": -0.10, "posture": -0.02},
        description="Gradient terms in the last null space: kappa of `limits` (eq. 7) and of `posture` (eq. 8) [-].",
    )
    iterations: int = Field(2, ge=1, le=1000, description="Most iterations per frame [-].")
    tolerance: float = Field(
        1e-4, ge=0, description="Stop when no task of a frame is further off than this [m or rad]."
    )
    damping: float = Field(0.01, gt=0, description="Damping of every level, lambda [-].")
    error_damping: float = Field(
        1.0, ge=0, description="Damping added with a level's error, lambda^2 += value * |e|^2 [-]; bounds steps."
    )
    max_step_rad: float = Field(0.5, gt=0, description="Largest joint step of one iteration [rad].")
    speed_limits: bool = Field(True, description="Treat joint speed limits as limits of the clamping loop too.")
    settle_iterations: int = Field(200, ge=1, description="Most iterations for the first frame [-].")


class Prioritized(Solver[PrioritizedConfig]):
    """Strict task levels by the augmented Jacobian, with joint limits by clamping [pennapoubel2014] eqs. 2-8.

    Each level acts in the null space of those above it; the gradients of joint-limit avoidance and of the posture
    act in what is left. Joints that would leave their range (or exceed their speed) are fixed at the limit and the
    levels are solved again without them.
    """

    name = "prioritized"
    serves: Mapping[TaskKind, Strictness] = {kind: Strictness.PRIORITISED for kind in TaskKind}  # type: ignore[misc]

    def prepare(self, stack: TaskStack) -> None:
        """Look up the tasks of the order and compile their rows."""
        from imitor.ik.rows import SERVED, TaskRows

        order = [[name for name in level if name in stack] for level in self.config.order]
        for name in (name for level in order for name in level):
            if stack[name].kind not in SERVED:
                raise ImitorError(
                    f"solver {self.name}: '{name}' is a {stack[name].kind} task; put it under null_space, not in order"
                )
        unknown = set(self.config.null_space) - {"limits", "posture"}
        if unknown:
            raise ImitorError(f"solver {self.name}: null_space knows limits and posture, not {', '.join(sorted(unknown))}")
        self._rows: TaskRows = TaskRows(self.robot, stack, order, dict(self.config.weights))
        self._posture: Array | None = stack["posture"].target if "posture" in stack else None
        self._middle = 0.5 * (self.robot.lower + self.robot.upper)
        self._range2 = (self.robot.upper - self.robot.lower) ** 2
        self._kappa_limits = self.config.null_space.get("limits", 0.0)
        self._kappa_posture = self.config.null_space.get("posture", 0.0) if self._posture is not None else 0.0
        S = self.robot.coupling
        self._independent = np.arange(self.robot.n) if S is None else S.argmax(axis=0)
        self._step_limit = self.robot.speed * self.dt_s

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Solve one frame from where the last one ended."""
        robot, q = self.robot, state.q
        joints = q[7:]
        if self.config.speed_limits:
            lowest = np.maximum(robot.lower, joints - self._step_limit)
            highest = np.minimum(robot.upper, joints + self._step_limit)
        else:
            lowest, highest = robot.lower, robot.upper
        self._iterate(stack, q, lowest, highest, self.config.iterations)

    def settle(self, stack: TaskStack, state: Configuration) -> None:
        """Solve the first frame without speed limits, as long as it improves."""
        self._iterate(stack, state.q, self.robot.lower, self.robot.upper, self.config.settle_iterations)

    def _iterate(self, stack: TaskStack, q: Array, lowest: Array, highest: Array, most: int) -> None:
        robot = self.robot
        if stack.anchor:
            robot.place(q, stack.anchor, stack.anchor_pose)
        layout = self._rows.layout()
        for _ in range(most):
            self._rows.assemble(layout)
            if np.abs(layout.e).max(initial=0.0) < self.config.tolerance:
                break
            self._move(stack, layout, q, lowest, highest)

    def _move(self, stack: TaskStack, layout: Layout, q: Array, lowest: Array, highest: Array) -> None:
        from imitor.ik.clamping import clamped_step

        robot, config, first = self.robot, self.config, layout.first
        e = layout.e
        errors2 = np.add.reduceat(e * e, layout.starts)
        damping2 = (config.damping**2 + config.error_damping * errors2)[layout.level_of]
        joints = q[7:]
        g = np.zeros(layout.n)
        g[first:] = (2 * self._kappa_limits) * (joints - self._middle) / self._range2
        if self._posture is not None:
            g[first:] += (2 * self._kappa_posture) * (joints - self._posture)
        J, S, pick = layout.J, robot.coupling, self._independent
        if S is None:
            step, _ = clamped_step(J, e, g, damping2, lowest - joints, highest - joints, first)
            moved = step[first:]
        else:
            J = np.hstack([J[:, :first], J[:, first:] @ S])
            g = np.concatenate([g[:first], S.T @ g[first:]])
            step, _ = clamped_step(
                J, e, g, damping2, (lowest - joints)[pick], (highest - joints)[pick], first
            )
            moved = S @ step[first:]
        largest = np.abs(moved).max()
        if largest > config.max_step_rad:
            step, moved = step * (config.max_step_rad / largest), moved * (config.max_step_rad / largest)
        if first:
            v = np.concatenate([step[:first], moved])
            q[:] = robot.integrate(q, v)
        else:
            joints += moved
        np.clip(joints, robot.lower, robot.upper, out=joints)
        robot.update(q)
        if stack.anchor:
            robot.place(q, stack.anchor, stack.anchor_pose)


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the solver."""
    return [Prioritized]
