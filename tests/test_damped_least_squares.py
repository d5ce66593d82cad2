"""Damped least squares per chain: weights, blocks, chains, tolerance, coupled joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.errors import ImitorError
from imitor.ik.anchored import AnchoredRows
from imitor.ik.limbs import CHAINS, DampedStep, LimitWeights, Progress, chain_joints
from imitor.plugins.solvers.damped_least_squares import DampedLeastSquares, DampedLeastSquaresConfig
from imitor.robot.model import RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.testing import make_context, make_robot
from imitor.types import Configuration

HANDS, FEET = ("left_hand", "right_hand"), ("left_foot", "right_foot")


@pytest.fixture(scope="module", params=["nao_v4", "unitree_g1"])
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return make_robot(request.param)


def make(robot: RobotModel, **options: Any) -> tuple[DampedLeastSquares, TaskStack, Configuration]:
    stack = TaskStack(robot.n)
    for name in HANDS:
        stack.declare(name, TaskKind.POSITION, frame=name, relative_to="chest")
    for name in FEET:
        stack.declare(name, TaskKind.POSITION, frame=name, relative_to="waist")
    stack.compile()
    solver = DampedLeastSquares(DampedLeastSquaresConfig(**options), make_context(robot))
    solver.prepare(stack)
    solver.reset()
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    robot.update(state.q)
    return solver, stack, state


def aim(robot: RobotModel, stack: TaskStack, q: np.ndarray) -> None:
    """Write the targets that a configuration meets."""
    robot.update(q)
    for t in stack:
        at = robot.position(t.frame) - robot.position(t.relative_to)
        t.target[:] = at @ robot.rotation(t.relative_to)
    robot.update(robot.standing)


def near(robot: RobotModel, seed: int, chains: tuple[str, ...], size: float = 0.15) -> np.ndarray:
    q, moved = robot.standing.copy(), np.any([chain_joints(robot)[c] for c in chains], axis=0)
    step = np.random.default_rng(seed).uniform(-size, size, robot.n) * moved
    margin = 0.1 * (robot.upper - robot.lower)
    inside = np.clip(q[7:] + step, robot.lower + margin, robot.upper - margin)
    q[7:] = np.where(moved, inside, q[7:])
    return q


def error(robot: RobotModel, stack: TaskStack, names: tuple[str, ...]) -> float:
    out = []
    for t in (stack[n] for n in names):
        at = (robot.position(t.frame) - robot.position(t.relative_to)) @ robot.rotation(t.relative_to)
        out.append(float(np.linalg.norm(at - t.target)))
    return max(out)


@given(seed=st.integers(0, 2**31), n=st.integers(1, 6), damping=st.floats(0.05, 1.0))
@settings(max_examples=50, deadline=None)
def test_the_step_is_the_weighted_optimum(seed: int, n: int, damping: float) -> None:
    rng = np.random.default_rng(seed)
    J, e, inverse = rng.normal(size=(n, 7)), rng.normal(size=n), rng.uniform(0.1, 1.0, 7)
    W = np.diag(1.0 / inverse)
    expected = np.linalg.solve(J.T @ J + damping**2 * W, J.T @ e)  # minimises |J v - e|^2 + damping^2 v'Wv
    np.testing.assert_allclose(DampedStep(n, 7)(J, e, inverse, damping**2), expected, atol=1e-8)


@given(seed=st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_stacked_limbs_are_solved_each_by_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocks = [(rng.normal(size=(3, 5)), rng.normal(size=3), rng.uniform(0.1, 1, 5)) for _ in range(4)]
    J = np.zeros((12, 20))
    for i, (block, _, _) in enumerate(blocks):
        J[3 * i : 3 * i + 3, 5 * i : 5 * i + 5] = block
    whole = DampedStep(12, 20)(
        J, np.concatenate([b[1] for b in blocks]), np.concatenate([b[2] for b in blocks]), 0.09
    )
    each = np.concatenate([DampedStep(3, 5)(*block, 0.09) for block in blocks])
    np.testing.assert_allclose(whole, each, atol=1e-12)


@given(share=st.floats(0.05, 0.95), step=st.floats(1e-4, 0.02))
def test_a_joint_slows_towards_a_limit_only(share: float, step: float) -> None:
    lower, upper = np.array([-1.0]), np.array([2.0])
    outward = 1.0 if share > 0.5 else -1.0
    q = lower + share * (upper - lower)
    for direction, slowed in ((outward, True), (-outward, False)):
        weights = LimitWeights(lower, upper)
        weights.inverse(q)
        if abs(share - 0.5) * 3.0 < step and not slowed:
            continue  # it crosses the middle
        inverse = float(weights.inverse(q + direction * step)[0])
        assert (inverse < 1.0) if slowed else (inverse == 1.0)


def test_a_joint_held_at_its_limit_stays_slow_and_is_free_once_it_leaves() -> None:
    weights = LimitWeights(np.array([-1.0]), np.array([2.0]))
    for q in (1.9, 2.0):
        weights.inverse(np.array([q]))
    assert float(weights.inverse(np.array([2.0]))[0]) < 1e-3
    assert float(weights.inverse(np.array([2.0 - 1e-6]))[0]) == 1.0


def test_the_weight_is_the_slope_of_the_limit_function() -> None:
    lower, upper, q, h = np.array([-1.0]), np.array([2.0]), np.array([1.3]), 1e-6

    def H(x: np.ndarray) -> float:
        return float((upper - lower)[0] ** 2 / (4 * (upper - x)[0] * (x - lower)[0]))

    slope = abs(H(q + h) - H(q - h)) / (2 * h)
    weights = LimitWeights(lower, upper)
    weights.inverse(q - 0.1)
    assert 1.0 / weights.inverse(q)[0] == pytest.approx(1.0 + slope, rel=1e-5)


@pytest.mark.parametrize("name", ["nao_v4", "unitree_g1", "romeo", "talos"])
def test_every_joint_belongs_to_one_chain(name: str) -> None:
    robot = make_robot(name)
    chains = chain_joints(robot)
    assert set(chains) == set(CHAINS)
    assert (np.sum(list(chains.values()), axis=0) == 1).all()
    shared = [n for n, s in zip(robot.joint_names, chains["shared"], strict=True) if s]
    assert shared == (["LHipYawPitch", "RHipYawPitch"] if name == "nao_v4" else [])
    assert chains["left_leg"].sum() == chains["right_leg"].sum() == (5 if name == "nao_v4" else 6)


@given(seed=st.integers(0, 2**31))
@settings(max_examples=10, deadline=None)
def test_reachable_targets_are_reached_within_tolerance(robot: RobotModel, seed: int) -> None:
    tolerance = {"position_m": 0.001, "orientation_rad": 0.033}
    solver, stack, state = make(robot, iterations=2000, tolerance=tolerance, speed_limits=False)
    aim(robot, stack, near(robot, seed, ("left_arm", "right_arm", "left_leg", "right_leg")))
    for _ in range(3):  # a stalled frame goes on in the next
        solver.step(stack, state)
    assert error(robot, stack, HANDS + FEET) < 0.003
    assert solver.spent < 2000


def test_only_the_chains_named_move(robot: RobotModel) -> None:
    solver, stack, state = make(robot, chains=["left_leg", "right_leg"])
    aim(robot, stack, near(robot, 3, ("left_arm", "right_arm", "left_leg", "right_leg")))
    solver.step(stack, state)
    chains = chain_joints(robot)
    legs = chains["left_leg"] | chains["right_leg"]
    moved = state.q[7:] != robot.standing[7:]
    assert moved[legs].any()
    assert not moved[~legs].any()


def test_a_limb_does_not_disturb_another(robot: RobotModel) -> None:
    solver, stack, state = make(robot)
    goal = near(robot, 5, ("left_arm",))
    aim(robot, stack, goal)
    solver.step(stack, state)
    moved = np.abs(state.q[7:] - robot.standing[7:]) > 1e-9
    assert moved.any()
    assert not moved[~chain_joints(robot)["left_arm"]].any()


def test_fixed_iterations_are_done_and_legs_have_fewer(robot: RobotModel) -> None:
    solver, stack, state = make(robot, iterations={"arms": 30, "legs": 5})
    aim(robot, stack, near(robot, 7, ("left_leg", "right_leg"), 0.3))
    solver.step(stack, state)
    assert solver.spent == 30
    after_5, stack_5, state_5 = make(robot, iterations=5)
    aim(robot, stack_5, near(robot, 7, ("left_leg", "right_leg"), 0.3))
    after_5.step(stack_5, state_5)
    legs = chain_joints(robot)["left_leg"] | chain_joints(robot)["right_leg"]
    np.testing.assert_allclose(state.q[7:][legs], state_5.q[7:][legs], atol=1e-12)


@pytest.mark.parametrize("tolerance", [None, {"position_m": 0.001, "orientation_rad": 0.033}])
def test_the_quick_loop_takes_the_same_steps(
    robot: RobotModel, tolerance: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    chains, out = ["left_arm", "right_arm", "left_leg", "right_leg"], []
    for quick in (True, False):
        if not quick:
            monkeypatch.setattr(AnchoredRows, "fits", staticmethod(lambda *_: False))
        solver, stack, state = make(robot, chains=chains, tolerance=tolerance)
        aim(robot, stack, near(robot, 11, tuple(chains), 0.2))
        robot.update(state.q)
        stack.anchor, stack.anchor_pose[:] = "waist", robot.pose("waist")
        for _ in range(3):
            solver.step(stack, state)
        out.append(state.q.copy())
        assert np.abs(state.q[7:] - robot.standing[7:]).max() > 0.02
    np.testing.assert_allclose(out[0], out[1], atol=1e-9 if tolerance is None else 2e-2)


FEET_ON_THE_GROUND = [("left_foot", "waist"), ("right_foot", "waist")]


def on_the_ground(
    robot: RobotModel, poses: bool, **options: Any
) -> tuple[DampedLeastSquares, TaskStack, Configuration]:
    """Return a solver for a robot that stands on its left foot: feet, their soles and the trunk, weighted."""
    stack = TaskStack(robot.n)
    for name, carrier in FEET_ON_THE_GROUND:
        if poses:
            stack.declare(name, TaskKind.POSE, frame=name)
        else:
            stack.declare(name, TaskKind.POSITION, frame=name, relative_to=carrier)
            stack.declare(f"{name}_sole", TaskKind.ORIENTATION, frame=name)
    stack.declare("waist", TaskKind.ORIENTATION, frame="waist")
    stack.compile()
    weights = {"waist": 0.5, "right_foot": 2.0}
    solver = DampedLeastSquares(DampedLeastSquaresConfig(weights=weights, **options), make_context(robot))
    solver.prepare(stack)
    solver.reset()
    q = near(robot, 4, ("left_leg", "right_leg"), 0.25)
    robot.update(q)
    for t in stack:
        turn = robot.rotation(t.frame)
        if t.kind is TaskKind.POSE:
            t.target[:] = robot.pose(t.frame)
            t.mask[:] = (True, True, True, True, True, False)
        elif t.kind is TaskKind.ORIENTATION:
            t.target[:] = turn
            t.mask[:] = (True, True, False)
        else:
            at = robot.position(t.frame) - robot.position(t.relative_to)
            t.target[:] = at @ robot.rotation(t.relative_to)
    stack["waist"].gain[0] = 0.8
    stack.anchor, stack.anchor_pose[:] = "left_foot", robot.pose("left_foot")
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    robot.update(state.q)
    return solver, stack, state


@pytest.mark.parametrize("poses", [False, True])
@pytest.mark.parametrize("chains", [["left_leg", "right_leg"], ["left_leg", "right_leg", "shared", "trunk"]])
def test_the_base_may_stay_while_the_joints_iterate(
    robot: RobotModel, poses: bool, chains: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Targets in the world, seen from the anchor, give the steps of a base that is placed in every iteration."""
    out = []
    for quick in (True, False):
        if not quick:
            monkeypatch.setattr(AnchoredRows, "fits", staticmethod(lambda *_: False))
        solver, stack, state = on_the_ground(robot, poses, chains=chains, iterations=7)
        for _ in range(2):
            solver.step(stack, state)
            assert robot.is_at("left_foot", stack.anchor_pose)
        assert solver.spent == 7
        assert np.abs(state.q[7:] - robot.standing[7:]).max() > 0.02
        out.append(state.q.copy())
    np.testing.assert_allclose(out[0], out[1], atol=1e-9)


def test_coupled_joints_stay_coupled() -> None:
    nao = make_robot("nao_v4")
    for chains in (["left_leg", "right_leg"], ["left_leg", "right_leg", "shared"]):
        solver, stack, state = make(nao, chains=chains, iterations=50)
        aim(nao, stack, near(nao, 2, ("left_leg", "right_leg"), 0.4))
        solver.step(stack, state)
        left, right = (state.q[7 + nao.joint_index(f"{s}HipYawPitch")] for s in "LR")
        assert left == right
        assert (left != nao.standing[7 + nao.joint_index("LHipYawPitch")]) == ("shared" in chains)


def test_speed_limits_hold(robot: RobotModel) -> None:
    solver, stack, state = make(robot)
    for task in stack:
        task.target[:] += 5.0
    before = state.q[7:].copy()
    solver.step(stack, state)
    assert (np.abs(state.q[7:] - before) <= robot.speed / 30.0 + 1e-12).all()


def test_a_task_of_another_kind_is_refused(robot: RobotModel) -> None:
    stack = TaskStack(robot.n)
    stack.declare("com", TaskKind.COM)
    stack.compile()
    solver = DampedLeastSquares(DampedLeastSquaresConfig(order=[["com"]]), make_context(robot))
    with pytest.raises(ImitorError, match="'com' is a com task; it serves position, orientation"):
        solver.prepare(stack)


def iterations(errors: list[float]) -> int:
    """Return after how many iterations a course of errors, of which 1 is allowed, ends."""
    progress = Progress(0.004, 0.98, 5)
    return next((i for i, e in enumerate(errors) if progress.ends(np.array([e]))), len(errors))


def test_iterations_end_within_the_tolerance_or_where_they_bring_nothing() -> None:
    assert iterations([9.0, 3.0, 0.9, 0.3]) == 2  # within
    assert iterations([9.0, 3.0, 2.999, 2.998]) == 2  # hardly falls
    assert iterations([9.0 * 0.95**k for k in range(20)]) == 20  # slow, but it goes on
    assert iterations([9.0, *(9.0 + 0.1 * k for k in range(1, 20))]) == 5  # rises
    assert iterations([43.0, 19.0, 40.0, 25.0, 18.0, 5.0, 0.5]) == 6  # comes back in time
