"""Checks of a solver: it serves what it says, as strictly as it says, and holds limits, anchor and coupling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.errors import NoSolution
from imitor.kinds import Solver, Strictness
from imitor.robot.card import Coupling
from imitor.tasks import TaskKind, TaskStack
from imitor.testing import stacks
from imitor.testing.expect import Snapshot, attempt, build, check_same, expect
from imitor.testing.fixtures import RATE_HZ, make_context, make_robot
from imitor.testing.lifecycle import begin, end, restart
from imitor.testing.robots import check_configuration, mirrored_pair, near_standing, standing_state
from imitor.types import Configuration

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

K = TaskKind
GRADIENTS: Final = (K.POSTURE, K.LIMITS)
"""Kinds that a solver with the option ``null_space`` serves there and not in ``order``."""
EXAMPLES: Final[Mapping[TaskKind, Sequence[str]]] = {
    K.POSITION: ("left_hand", "head"),
    K.ORIENTATION: ("chest",),
    K.DIRECTION: ("left_forearm", "right_upper_arm"),
    K.VECTOR: ("waist_vector",),
    K.POSE: ("right_foot",),
    K.COM: ("com",),
    K.POSTURE: ("posture",),
    K.LIMITS: ("limits",),
}
FRAMES: Final = 60
UNDISTURBED: Final = 3e-3
"""What a lower task may cost a prioritised one once both have settled [m or rad]; a hard one, a tenth of it."""


def check_solver(
    cls: type[Solver[Any]], config: Mapping[str, Any] | None = None, *, robot: RobotModel | None = None
) -> None:
    """Check a solver. Its option ``order``, where it has one, is chosen by the kit."""
    expect(cls.serves, cls, "`serves` names no kind of task")
    wrong = [k for k, s in cls.serves.items() if k not in set(K) or s not in set(Strictness)]
    expect(not wrong, cls, f"`serves` has {wrong}, no TaskKind or no Strictness")
    robot = robot or make_robot()
    for kind in cls.serves:
        for seed, anchor in enumerate(("left_foot", "")):
            _check_served(_Bench(cls, config, robot, [EXAMPLES[kind]]), kind, seed, anchor)
    _check_strictness(cls, config, robot)
    _check_out_of_reach(_Bench(cls, config, robot, [_all_names(cls)]))
    pair = mirrored_pair(robot)
    if pair is not None:
        coupled = make_robot(str(robot.card.path), coupled=(Coupling(joints=pair),))
        _check_out_of_reach(_Bench(cls, config, coupled, [_all_names(cls)]))


class _Bench:
    """A solver with the canonical tasks of the kinds it serves, a robot to move and one to aim with."""

    def __init__(
        self,
        cls: type[Solver[Any]],
        config: Mapping[str, Any] | None,
        robot: RobotModel,
        order: Sequence[Sequence[str]],
    ) -> None:
        self.cls, self.robot, self.moving = cls, robot, ""
        self.goal = type(robot).from_card(robot.card)
        self.stack = TaskStack(robot.n)
        unserved = [name for name, kind in stacks.CANONICAL.items() if kind not in cls.serves]
        stacks.declare_canonical(self.stack, robot, leave_out=unserved)
        self.stack.compile()
        self.names = [[n for n in level if n in self.stack] for level in order]
        self.solver = build(cls, self._options(config), make_context(robot))
        attempt(cls, "prepare()", lambda: self.solver.prepare(self.stack))
        begin(self.solver)
        stacks.activate(self.stack, [n for level in self.names for n in level])

    def _options(self, config: Mapping[str, Any] | None) -> dict[str, Any]:
        options, fields = dict(config or {}), self.cls.config_type.model_fields
        levels, gradients = self.names, []
        if "null_space" in fields:
            gradients = [n for level in levels for n in level if stacks.CANONICAL[n] in GRADIENTS]
            options["null_space"] = dict.fromkeys(gradients, -0.1)
            levels = [[n for n in level if n not in gradients] for level in levels]
        if "order" in fields:
            # a null space is that of something: gradients act beside a task, and while that moves
            beside = [n for n in ("left_hand", "com") if n in self.stack][:1]
            self.moving = beside[0] if gradients and beside else ""
            self.names = [level for level in levels if level] or [beside]
            options["order"] = self.names
            self.names = [*self.names, gradients]
        return options

    def begin(self, anchor: str) -> Configuration:
        """Stand the robot, on an anchor or free."""
        restart(self.solver)
        state = standing_state(self.robot)
        self.stack.anchor = anchor
        self.stack.anchor_pose = self.robot.pose("left_foot")
        self.stack.contact = np.ones(2, dtype=bool)
        return state

    def step(self, state: Configuration, which: str) -> None:
        """Solve a frame and check what every solver must keep."""
        before, q = stacks.snapshot(self.stack), state.q
        stacks.set_writable(self.stack, writable=False)
        try:
            attempt(self.cls, f"step() on {which}", lambda: self.solver.step(self.stack, state))
        finally:
            stacks.set_writable(self.stack, writable=True)
        expect(
            state.q is q, self.cls, f"{which}: it put a new array in state.q; change the one that is there"
        )
        check_same(self.cls, [before], [stacks.snapshot(self.stack)], f"{which}: the tasks before and after")
        check_configuration(self.cls, self.robot, self.stack, state, which)

    def errors(self, state: Configuration) -> dict[str, float]:
        """Return the error of every task."""
        return {t.name: stacks.error_of(t, self.robot, state.q) for t in self.stack}

    def run(self, state: Configuration, what: str, frames: int = FRAMES, moving: str = "") -> list[Snapshot]:
        """Solve frames with targets that stay, but for that of one position that goes up and down."""
        out = []
        for i in range(frames):
            if moving:
                self.stack[moving].target[2] += 0.005 * np.cos(0.2 * i)
            self.step(state, f"{what}, frame {i}")
            out.append({"q": state.q.copy()})
        return out


def _all_names(cls: type[Solver[Any]]) -> list[str]:
    return [name for kind in cls.serves for name in EXAMPLES[kind]]


def _check_served(bench: _Bench, kind: TaskKind, seed: int, anchor: str) -> None:
    """Let it reach random targets that can be reached; do it twice, and once from `settle`."""
    cls, stack = bench.cls, bench.stack
    what = f"{kind} tasks, {'anchored' if anchor else 'free base'}"
    state = bench.begin(anchor)
    goal = near_standing(bench.goal, np.random.default_rng(seed))
    stacks.aim(stack, bench.goal, goal)
    names = [n for n in EXAMPLES[kind] if n in stack]
    before = bench.errors(state)
    first = bench.run(state, what, moving=bench.moving)
    after = bench.errors(state)
    share, floor = (0.95, 0.0) if kind in GRADIENTS else (0.1, 2e-3)
    for name in names:
        expect(
            after[name] <= share * before[name] + floor,
            cls,
            f"{what}: the error of '{name}' goes from {before[name]:.4f} to {after[name]:.4f} in {FRAMES} frames "
            f"at {RATE_HZ:g} Hz, though its target can be reached",
        )
    stacks.aim(stack, bench.goal, goal)
    again = bench.begin(anchor)
    check_same(cls, first, bench.run(again, what, moving=bench.moving), f"{what}: solved again after reset()")
    settled = bench.begin(anchor)
    attempt(cls, f"settle() on {what}", lambda: bench.solver.settle(stack, settled))
    check_configuration(cls, bench.robot, stack, settled, f"{what}, settle()")
    end(bench.solver)


def _check_strictness(cls: type[Solver[Any]], config: Mapping[str, Any] | None, robot: RobotModel) -> None:
    """Pull with a lower task that cannot be met: a hard or prioritised one above it must not give way."""
    if "order" not in cls.config_type.model_fields:
        return
    for kind, strictness in cls.serves.items():
        if strictness is Strictness.WEIGHTED or kind in GRADIENTS:
            continue
        low = "right_hand" if K.POSITION in cls.serves else "com"
        high = [n for n in EXAMPLES[kind] if n != low]
        bench = _Bench(cls, config, robot, [high, [low]])
        if not high or low not in bench.stack:
            continue
        state = bench.begin("left_foot")
        stacks.aim(bench.stack, bench.goal, near_standing(bench.goal, np.random.default_rng(7), 0.15))
        bench.stack[low].target[:] += (0.6, -0.8, 0.5)
        what = f"{strictness} {kind} above an unreachable '{low}'"
        try:
            bench.run(state, what, 2 * FRAMES)
        except AssertionError as error:
            if strictness is Strictness.HARD and isinstance(error.__cause__, NoSolution):
                continue
            raise
        allowed = UNDISTURBED * (0.1 if strictness is Strictness.HARD else 1.0)
        for name in (n for n in high if n in bench.stack):
            error_now = bench.errors(state)[name]
            expect(
                error_now <= allowed,
                cls,
                f"{what}: '{name}' ends {error_now:.4f} off its target, more than {allowed:g} [m or rad]; "
                "a lower level disturbs it",
            )
        end(bench.solver)


def _check_out_of_reach(bench: _Bench) -> None:
    """Ask for what cannot be reached, and change the anchor under way: limits, anchor and coupling hold."""
    state, rng, stack = bench.begin("left_foot"), np.random.default_rng(11), bench.stack
    what = "targets out of reach" + (", coupled joints" if bench.robot.coupling is not None else "")
    for i in range(FRAMES):
        if i % 10 == 0:
            goal = near_standing(bench.goal, rng, 1.0)
            stacks.aim(stack, bench.goal, goal)
            for task in stack:
                if task.kind in (K.POSITION, K.COM):
                    task.target[:] += rng.normal(size=3)
        if i == FRAMES // 2:
            stack.anchor = "right_foot"
            stack.anchor_pose = bench.robot.pose("right_foot")
        if i == FRAMES - 10:
            stack.anchor = ""
        bench.step(state, f"{what}, frame {i}")
    stacks.activate(stack, ())
    bench.step(state, "no active task")
    end(bench.solver)
