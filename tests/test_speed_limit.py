"""The speed limit: free ends move no faster than it, a standing foot's target is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.plugins.stabilizers.speed_limit import SpeedLimit, SpeedLimitConfig
from imitor.robot.model import RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.testing import make_context, make_frames, make_robot
from imitor.types import Configuration

DT = 1.0 / 30.0


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return make_robot()


def make(robot: RobotModel, speed: float, kind: TaskKind) -> tuple[SpeedLimit, TaskStack, Configuration]:
    stack = TaskStack(robot.n)
    for name in ("left_hand", "left_foot", "right_foot"):
        stack.declare(name, kind, frame=name)
    stack.compile()
    stage = SpeedLimit(SpeedLimitConfig(speed_m_s=speed), make_context(robot))
    stage.reset()
    return stage, stack, Configuration(robot.standing.copy(), np.ones(2, dtype=bool))


@given(
    seed=st.integers(0, 2**31),
    speed=st.floats(0.05, 5.0),
    kind=st.sampled_from([TaskKind.POSITION, TaskKind.POSE]),
)
@settings(max_examples=40, deadline=None)
def test_free_ends_are_no_faster(robot: RobotModel, seed: int, speed: float, kind: TaskKind) -> None:
    rng = np.random.default_rng(seed)
    stage, stack, state = make(robot, speed, kind)
    frame = make_frames("wave", 1)[0]
    last: dict[str, np.ndarray] = {}
    for _ in range(20):
        stack.contact[:] = (True, rng.random() < 0.5)
        wanted = {}
        for task in stack:
            place = task.target if kind is TaskKind.POSITION else task.target[:3, 3]
            place[:] = wanted[task.name] = rng.normal(size=3)
        stage.step(frame, stack, state)
        for task in stack:
            place = (task.target if kind is TaskKind.POSITION else task.target[:3, 3]).copy()
            if task.name == "left_foot" or (task.name == "right_foot" and stack.contact[1]):
                np.testing.assert_array_equal(place, wanted[task.name])
            elif task.name in last:
                step = place - last[task.name]
                assert np.linalg.norm(step) <= speed * DT + 1e-12
                towards = wanted[task.name] - last[task.name]
                assert step @ towards >= 0.0
            last[task.name] = place


def test_a_still_target_is_reached(robot: RobotModel) -> None:
    stage, stack, state = make(robot, 0.5, TaskKind.POSITION)
    frame = make_frames("wave", 1)[0]
    stack["left_hand"].target[:] = 0.0
    stage.step(frame, stack, state)
    for k in range(1, 41):
        stack["left_hand"].target[:] = (0.3, 0.0, 0.4)
        stage.step(frame, stack, state)
        assert np.linalg.norm(stack["left_hand"].target) == pytest.approx(min(k * 0.5 * DT, 0.5))


def test_reset_forgets(robot: RobotModel) -> None:
    stage, stack, state = make(robot, 0.1, TaskKind.POSITION)
    frame = make_frames("wave", 1)[0]
    stage.step(frame, stack, state)
    stage.reset()
    stack["left_hand"].target[:] = 9.0
    stage.step(frame, stack, state)
    assert (stack["left_hand"].target == 9.0).all()
