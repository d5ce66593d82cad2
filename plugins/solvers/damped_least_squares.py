"""Damped least squares per limb, with joint-limit weights; all limbs in one array operation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from imitor import (
    Component,
    Config,
    Configuration,
    ImitorError,
    Solver,
    Strictness,
    TaskKind,
    TaskStack,
    hookimpl,
)
from imitor.types import Array, BoolArray, IntArray

if TYPE_CHECKING:
    from imitor.ik.anchored import AnchoredRows
    from imitor.ik.layout import Layout
    from imitor.ik.limbs import DampedStep, Rounds

Chain = Literal["left_arm", "right_arm", "left_leg", "right_leg", "trunk", "head", "shared"]
Group = Literal["arms", "legs", "trunk", "head"]
Count = Annotated[int, Field(ge=1, le=5000)]
Weight = Annotated[float, Field(gt=0)]
_SERVED = (TaskKind.POSITION, TaskKind.ORIENTATION, TaskKind.DIRECTION, TaskKind.POSE)
Bounds = tuple[Array, Array]
_PROGRESS = 0.004, 0.98, 5
"""With a tolerance a frame is done when an iteration takes less than the first share off the squared error, or when
that does not fall to the second share within so many iterations."""


class Tolerance(Config):
    """Where a solver may stop."""

    position_m: float = Field(0.001, gt=0, description="Largest error of a position along an axis [m].")
    orientation_rad: float = Field(
        0.033, gt=0, description="Largest error of a rotation about an axis [rad]."
    )


def _paper_iterations() -> dict[Group, int]:
    return {"arms": 30, "legs": 5}


class DampedLeastSquaresConfig(Config):
    """Options of the damped least-squares solver."""

    damping: float = Field(
        0.3, gt=0, description="Damping lambda; positions are measured in leg lengths, so it has no unit [-]."
    )
    iterations: Count | Mapping[Group, Count] = Field(
        default_factory=_paper_iterations,
        description="Iterations per frame, or by group of chains: arms, legs, trunk, head (not named: as arms) [-].",
    )
    tolerance: Tolerance | None = Field(
        None,
        description="Stop earlier, once every error is within position_m and orientation_rad; none: never [-].",
    )
    chains: Sequence[Chain] = Field(
        ["left_arm", "right_arm", "left_leg", "right_leg", "trunk", "head"],
        min_length=1,
        description="What moves; `shared` is a joint that one motor moves for two limbs [-].",
    )
    order: Sequence[Sequence[str]] | None = Field(
        None,
        description="Tasks to serve, as levels of names; all are served together, so only the names count. None: every "
        "active one of a kind that it serves [-].",
    )
    weights: Mapping[str, Weight] = Field({}, description="Weight by task name; default 1 [-].")
    max_step_rad: float = Field(0.25, gt=0, description="Largest joint step of one iteration [rad].")
    speed_limits: bool = Field(True, description="Keep joints within what their speed allows in a frame.")
    settle_iterations: Count = Field(400, description="Most iterations for the first frame [-].")


@dataclass(frozen=True)
class Plan:
    """What is worked out once for a layout: factors that make rows unit-free, errors allowed, the quick loop's rows."""

    layout: Layout
    scale: Array
    allowed: Array | None
    anchored: AnchoredRows | None
    solve: DampedStep


class DampedLeastSquares(Solver[DampedLeastSquaresConfig]):
    """Damped least squares per chain, avoiding joint limits by weights [koenemann2014] section IV-B (K2).

    Chan and Dubey's weights slow a joint that comes near a limit. A task relative to the link that carries a limb moves
    that limb alone; one given in the world moves every chain that has a part in it, all weighted. The anchor is held
    exactly, by placing the base.
    """

    name = "damped_least_squares"
    serves: Mapping[TaskKind, Strictness] = dict.fromkeys(_SERVED, Strictness.WEIGHTED)  # type: ignore[misc]
    spent = 0
    """Iterations of the last frame."""

    def prepare(self, stack: TaskStack) -> None:
        """Look up tasks and chains."""
        from imitor.ik.anchored import AnchoredRows
        from imitor.ik.limbs import (
            GROUPS,
            DampedStep,
            LimitWeights,
            Progress,
            Rounds,
            chain_joints,
            columns,
            in_world,
            length_rows,
            limb_length,
        )
        from imitor.ik.rows import TaskRows

        config, robot = self.config, self.robot
        if config.order is None:
            names = [t.name for t in stack if t.kind in _SERVED]
        else:
            names = [name for level in config.order for name in level if name in stack]
        for name in names:
            if stack[name].kind not in _SERVED:
                raise ImitorError(
                    f"order: '{name}' is a {stack[name].kind} task; it serves {', '.join(_SERVED)}"
                )
        self._damped_step, self._length_rows, self._in_world = DampedStep, length_rows, in_world
        self._rows = TaskRows(robot, stack, [names], dict(config.weights))
        chains = chain_joints(robot)
        moved = columns(chains, config.chains)
        pick = None if robot.coupling is None else robot.coupling.argmax(axis=0)
        self._coupling, self._pick = robot.coupling, slice(None) if pick is None else pick
        counts = config.iterations
        rounds = np.zeros(robot.n, dtype=int)
        for name in config.chains:
            group: Any = GROUPS[name]
            rounds[chains[name]] = (
                counts if isinstance(counts, int) else counts.get(group, counts.get("arms", 30))
            )
        self._rounds = Rounds(self._coupled(np.where(moved, rounds, 0)[self._pick]))
        self._settling = Rounds(np.where(self._rounds.counts > 0, config.settle_iterations, 0))
        self._weights = LimitWeights(robot.lower, robot.upper)
        self._inverse_length = 1.0 / limb_length(robot)
        self._plans: dict[int, Plan] = {}
        self._anchored_rows, self._progress = AnchoredRows, Progress
        self._fast = robot.speed * self.dt_s if config.speed_limits else np.full(robot.n, np.inf)

    def reset(self) -> None:
        """Forget how near to their limits the joints were."""
        self._weights.reset()

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Solve one frame from where the last one ended."""
        start = state.q[7:].copy()
        robot = self.robot
        bounds = (np.maximum(robot.lower, start - self._fast), np.minimum(robot.upper, start + self._fast))
        self._iterate(stack, state.q, bounds, self._rounds)

    def settle(self, stack: TaskStack, state: Configuration) -> None:
        """Solve the first frame without speed limits."""
        self._iterate(stack, state.q, (self.robot.lower, self.robot.upper), self._settling)
        self.reset()

    def _iterate(self, stack: TaskStack, q: Array, bounds: Bounds, rounds: Rounds) -> None:
        robot, layout = self.robot, self._rows.layout()
        self.spent = 0
        if layout.m > 0:
            plan = self._plans.get(id(layout)) or self._plan(stack, layout)
            if plan.anchored is not None:
                self._iterate_anchored(plan.anchored, plan, q, bounds, rounds)
            else:
                self._iterate_rows(plan, stack, q, bounds, rounds)
        if stack.anchor:
            robot.place(q, stack.anchor, stack.anchor_pose)

    def _iterate_rows(self, plan: Plan, stack: TaskStack, q: Array, bounds: Bounds, rounds: Rounds) -> None:
        """Iterate on rows of any kind."""
        robot, joints, layout = self.robot, q[7:], plan.layout
        if stack.anchor and not robot.is_at(stack.anchor, stack.anchor_pose):
            robot.place(q, stack.anchor, stack.anchor_pose)
        in_world = bool(stack.anchor) and self._in_world(layout)
        progress = self._progress(*_PROGRESS)
        for k in range(rounds.most):
            self._rows.assemble(layout)
            if plan.allowed is not None and progress.ends(layout.e / plan.allowed):
                return
            self._move(plan, q, rounds.counts > k)
            np.minimum(np.maximum(joints, bounds[0]), bounds[1], out=joints)
            robot.update(q)
            if in_world:
                robot.place(q, stack.anchor, stack.anchor_pose)
            self.spent = k + 1

    def _iterate_anchored(
        self, rows: AnchoredRows, plan: Plan, q: Array, bounds: Bounds, rounds: Rounds
    ) -> None:
        """Iterate on places and rotations while the base stays still: the same steps, placed once at the end."""
        joints, weights, (low, high) = q[7:], self._weights, bounds
        most = self.config.max_step_rad
        progress, relative = self._progress(*_PROGRESS), plan.allowed
        rows.begin()
        for k in range(rounds.most):
            if k in rounds.free:
                rows.hold(rounds.free[k])
                if plan.allowed is not None:
                    relative = rows.served / plan.allowed
            rows.assemble(q)
            if relative is not None and progress.ends(rows.e * relative):
                break
            inverse = weights.inverse(joints)
            if rows.coupling is not None:
                inverse = inverse[self._pick]
            step = plan.solve(rows.J, rows.e, inverse, self.config.damping**2)
            if rows.coupling is not None:
                step = rows.coupling.dot(step)
            if step.dot(step) > most * most:  # else no joint is over it either
                step *= min(1.0, most / float(np.abs(step).max()))
            np.add(joints, step, out=joints)
            np.maximum(joints, low, out=joints)
            np.minimum(joints, high, out=joints)
            self.spent = k + 1
        else:
            self.robot.update(q)  # the anchor's place is needed where the last step has left it

    def _coupled(self, rounds: IntArray) -> IntArray:
        """Return values of independent joints for all of them, shape (n,)."""
        if self._coupling is None:
            return rounds
        return np.asarray(rounds[np.abs(self._coupling).argmax(axis=1)])

    def _plan(self, stack: TaskStack, layout: Layout) -> Plan:
        lengths, tolerance, moved = self._length_rows(layout), self.config.tolerance, self._rounds.counts > 0
        allowed: Array | None = None
        if tolerance is not None:
            allowed = np.where(lengths, tolerance.position_m, tolerance.orientation_rad)
            allowed = allowed if layout.root_weight is None else allowed * layout.root_weight
        anchored = None
        if self._anchored_rows.fits(layout, moved):
            anchored = self._anchored_rows(self.robot, layout, stack, moved, self._inverse_length)
            if tolerance is not None:
                places = anchored.places
                allowed = anchored.scale * np.where(places, tolerance.position_m, tolerance.orientation_rad)
        m, n = layout.J.shape if anchored is None else anchored.J.shape
        if self._coupling is not None and (anchored is None or anchored.coupling is not None):
            n += self._coupling.shape[1] - self._coupling.shape[0]
        scale = np.where(lengths, self._inverse_length, 1.0)
        plan = Plan(layout, scale, allowed, anchored, self._damped_step(m, n))
        self._plans[id(layout)] = plan
        return plan

    def _move(self, plan: Plan, q: Array, free: BoolArray) -> None:
        layout, scale = plan.layout, plan.scale
        first, joints = layout.first, q[7:]
        J = layout.J
        if self._coupling is not None and first == 0:
            J = J @ self._coupling
        elif self._coupling is not None:
            J = np.hstack([J[:, :first], J[:, first:] @ self._coupling])
        J, e = J * scale[:, None], layout.e * scale
        pick, inverse = self._pick, np.ones(J.shape[1])
        inverse[first:] = (self._weights.inverse(joints) * free)[pick]
        step = plan.solve(J, e, inverse, self.config.damping**2)
        largest = float(np.abs(step[first:]).max(initial=0.0))
        if largest > self.config.max_step_rad:
            step *= self.config.max_step_rad / largest
        moved = step[first:] if self._coupling is None else self._coupling @ step[first:]
        if first:
            q[:] = self.robot.integrate(q, np.concatenate([step[:first], moved]))
        else:
            joints += moved


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the solver."""
    return [DampedLeastSquares]
