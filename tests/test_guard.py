"""The guard: whatever is wanted, what leaves it is finite, within limits, speed and acceleration, anchor held."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.robot.model import RobotModel
from imitor.safety.guard import Guard
from imitor.tasks import TaskStack
from imitor.testing import make_robot
from imitor.types import STATUS, Configuration
from small_humanoid import SmallHumanoid

DT = 0.02
SIZES = st.sampled_from([1e-3, 1e-2, 0.1, 1.0, 10.0])
SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=20, deadline=None)


@pytest.fixture(scope="module")
def plain() -> RobotModel:
    """A robot without acceleration limits."""
    return make_robot()


@pytest.fixture(scope="module")
def accelerating(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """A robot whose joints accelerate with 100 rad/s^2 at most."""
    return make_robot(str(SmallHumanoid().write(tmp_path_factory.mktemp("small"))))


def new_stack(robot: RobotModel, anchor: str = "left_foot") -> TaskStack:
    stack = TaskStack(robot.n)
    stack.compile()
    robot.update(robot.standing)
    stack.anchor = anchor
    stack.anchor_pose = robot.pose("left_foot")
    return stack


def want(robot: RobotModel, stack: TaskStack, state: Configuration, joints: np.ndarray) -> None:
    """Make a wanted configuration as a solver leaves it: within limits, on the anchor, robot updated."""
    state.q[7:] = np.clip(joints, robot.lower, robot.upper)
    robot.update(state.q)
    if stack.anchor:
        robot.place(state.q, stack.anchor, stack.anchor_pose)


def anchor_error(robot: RobotModel, stack: TaskStack, q: np.ndarray) -> float:
    robot.update(q)
    return float(np.abs(robot.pose(stack.anchor) - stack.anchor_pose).max())


def walk(robot: RobotModel, seed: int, size: float, kind: str, n: int = 150) -> None:
    """Want random steps, jumps, limits or no number at all, and check every command."""
    rng = np.random.default_rng(seed)
    guard, stack = Guard(robot, DT), new_stack(robot)
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    last = last_step = None
    joints = robot.standing[7:]
    for k in range(n):
        state.status = 0
        if kind == "limits":
            if k % 40 == 0:
                joints = np.where(rng.random(robot.n) < 0.5, robot.lower, robot.upper)
        else:
            joints = state.q[7:] + size * rng.normal(size=robot.n)
        want(robot, stack, state, joints)
        bad = kind == "broken" and rng.random() < 0.2
        if bad:
            state.q[rng.integers(robot.nq)] = rng.choice([np.nan, np.inf, -np.inf])
        guard.apply(stack, state)
        q = state.q
        assert np.isfinite(q).all()
        assert abs(np.linalg.norm(q[3:7]) - 1) < 1e-9
        assert (q[7:] >= robot.lower).all() and (q[7:] <= robot.upper).all()
        assert (STATUS[state.status] == "held") == bad
        reached = {role: robot.pose(role) for role in ("left_foot", "right_foot", "head")}
        assert anchor_error(robot, stack, q) < 1e-9
        for role, pose in reached.items():  # the robot was left at the command
            np.testing.assert_allclose(robot.pose(role), pose, atol=1e-9)
        if last is not None:
            step = q[7:] - last
            assert (np.abs(step) <= robot.speed * DT + 1e-9).all()
            allowed = robot.acceleration * DT * DT
            if last_step is not None:
                assert (np.abs(step - last_step) <= allowed + 1e-9).all()
            assert_can_stop(q[7:], step, allowed, robot)
            last_step = step
        else:
            last_step = np.zeros(robot.n)
        last = q[7:].copy()


def assert_can_stop(joints: np.ndarray, step: np.ndarray, allowed: np.ndarray, robot: RobotModel) -> None:
    """Brake as hard as allowed from here: no joint may reach beyond its limits."""
    if not np.isfinite(allowed).all():
        return
    at, moving = joints.copy(), step.copy()
    while np.abs(moving).max() > 1e-12:
        moving = np.sign(moving) * np.maximum(np.abs(moving) - allowed, 0.0)
        at = at + moving
    assert (at <= robot.upper + 1e-9).all() and (at >= robot.lower - 1e-9).all()


@pytest.mark.parametrize("kind", ["steps", "limits", "broken"])
@given(seed=SEEDS, size=SIZES)
@FEW
def test_every_command_is_safe(plain: RobotModel, kind: str, seed: int, size: float) -> None:
    walk(plain, seed, size, kind)


@pytest.mark.parametrize("kind", ["steps", "limits", "broken"])
@given(seed=SEEDS, size=SIZES)
@FEW
def test_every_command_is_safe_with_acceleration_limits(
    accelerating: RobotModel, kind: str, seed: int, size: float
) -> None:
    walk(accelerating, seed, size, kind)


@given(seed=SEEDS)
@FEW
def test_what_is_safe_is_not_changed(plain: RobotModel, seed: int) -> None:
    robot, rng = plain, np.random.default_rng(seed)
    guard, stack = Guard(robot, DT), new_stack(robot)
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    for _ in range(20):
        want(robot, stack, state, state.q[7:] + rng.uniform(-0.99, 0.99, robot.n) * robot.speed * DT)
        wanted = state.q.copy()
        guard.apply(stack, state)
        np.testing.assert_array_equal(state.q, wanted)
        assert state.status == 0
    assert (guard.report.scaled, guard.report.not_finite) == (0, 0)


def test_a_motion_within_acceleration_limits_is_not_changed(accelerating: RobotModel) -> None:
    robot = accelerating
    guard, stack = Guard(robot, DT), new_stack(robot)
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    middle = 0.5 * (robot.lower + robot.upper)
    amplitude, pulse = 0.3 * (robot.upper - robot.lower), 3.0  # at most 13 rad/s^2
    for k in range(200):
        want(robot, stack, state, middle - amplitude * np.cos(pulse * k * DT))
        wanted = state.q.copy()
        guard.apply(stack, state)
        np.testing.assert_array_equal(state.q, wanted)
    assert guard.report.scaled == 0


@given(seed=SEEDS, size=st.floats(0.5, 5.0))
@FEW
def test_a_step_too_large_is_scaled_as_a_whole(plain: RobotModel, seed: int, size: float) -> None:
    robot, rng = plain, np.random.default_rng(seed)
    guard, stack = Guard(robot, DT), new_stack(robot)
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    guard.apply(stack, state)
    want(robot, stack, state, robot.standing[7:] + size * rng.normal(size=robot.n))
    wanted = state.q[7:] - robot.standing[7:]
    guard.apply(stack, state)
    sent = state.q[7:] - robot.standing[7:]
    share = (np.abs(sent) / (robot.speed * DT)).max()
    assert share == pytest.approx(1.0)  # the fastest joint at its speed limit, all in proportion
    np.testing.assert_allclose(sent / np.linalg.norm(sent), wanted / np.linalg.norm(wanted), atol=1e-9)
    assert guard.report.scaled == 1


def test_a_free_base_is_slowed_with_the_joints(plain: RobotModel) -> None:
    robot = plain
    guard, stack = Guard(robot, DT), new_stack(robot, anchor="")
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    guard.apply(stack, state)
    state.q[0] += 1.0
    state.q[7 + robot.joint_index("left_knee_joint")] += (
        2 * robot.speed[robot.joint_index("left_knee_joint")] * DT
    )
    robot.update(state.q)
    guard.apply(stack, state)
    assert state.q[0] == pytest.approx(0.5)


def test_no_number_at_all_holds_the_last_command(plain: RobotModel) -> None:
    robot = plain
    guard, stack = Guard(robot, DT), new_stack(robot)
    state = Configuration(np.full(robot.nq, np.nan), np.ones(2, dtype=bool))
    guard.apply(stack, state)
    np.testing.assert_array_equal(state.q, robot.standing)
    want(robot, stack, state, robot.standing[7:] + 0.05)
    state.status = 0
    guard.apply(stack, state)
    sent = state.q.copy()
    state.q[:] = np.nan
    guard.apply(stack, state)
    np.testing.assert_array_equal(state.q, sent)
    assert STATUS[state.status] == "held"
    assert guard.report.not_finite == 2


def test_reset_forgets_the_last_command(plain: RobotModel) -> None:
    robot = plain
    guard, stack = Guard(robot, DT), new_stack(robot)
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    guard.apply(stack, state)
    guard.reset()
    want(robot, stack, state, robot.standing[7:] + 1.0)
    wanted = state.q.copy()
    guard.apply(stack, state)
    np.testing.assert_array_equal(state.q, wanted)


def test_it_arrives_at_a_limit_and_stays(accelerating: RobotModel) -> None:
    """A joint that is sent to its limit gets there, softly, and is not stuck before it."""
    robot: RobotModel = accelerating
    guard, stack = Guard(robot, DT), new_stack(robot)
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    for _ in range(300):
        want(robot, stack, state, robot.upper)
        guard.apply(stack, state)
    np.testing.assert_allclose(state.q[7:], robot.upper, atol=1e-6)


def test_coupled_joints_stay_coupled(tmp_path: Path) -> None:
    humanoid = SmallHumanoid()
    humanoid.card["coupled"] = [{"joints": ["left_hip_pitch", "right_hip_pitch"]}]
    robot = make_robot(str(humanoid.write(tmp_path)))
    a, b = robot.joint_index("left_hip_pitch"), robot.joint_index("right_hip_pitch")
    guard, stack = Guard(robot, DT), new_stack(robot)
    state, rng = Configuration(robot.standing.copy(), np.ones(2, dtype=bool)), np.random.default_rng(0)
    assert robot.coupling is not None
    for _ in range(60):
        joints = state.q[7:] + rng.normal(size=robot.n)
        want(robot, stack, state, robot.coupling @ joints[robot.coupling.argmax(axis=0)])
        guard.apply(stack, state)
        assert state.q[7 + a] == pytest.approx(state.q[7 + b], abs=1e-12)
