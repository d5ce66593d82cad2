"""Offsets from the T-pose: eqs. 1-5, where the T-pose comes from, and what turning and moving the human changes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.errors import ImitorError
from imitor.mapping.limb_vectors import HumanLimbs, RobotLimbs, looks_like_t_pose
from imitor.plugins.mappers.tpose_offset import TposeOffset, TposeOffsetConfig
from imitor.robot.model import RobotModel
from imitor.tasks import TaskStack
from imitor.testing import make_context, make_frames, make_robot, make_skeleton
from imitor.types import ROLE_INDEX, HumanFrame, Support

ROBOTS = ("nao_v4", "unitree_g1", "romeo", "talos")
LIMBS = ("left_hand", "right_hand", "left_foot", "right_foot")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return make_robot(request.param)


def make(robot: RobotModel, **options: Any) -> tuple[TposeOffset, TaskStack]:
    mapper, stack = TposeOffset(TposeOffsetConfig(**options), make_context(robot)), TaskStack(robot.n)
    mapper.declare(stack)
    stack.compile()
    mapper.start()
    mapper.reset()
    return mapper, stack


def t_pose() -> HumanFrame:
    position = make_skeleton().rest_position
    frame = HumanFrame(0.0, position, np.asarray(np.isfinite(position).all(axis=1)))
    frame.support = Support(True, True)
    return frame


def targets(stack: TaskStack) -> np.ndarray:
    return np.array([stack[name].target for name in LIMBS])


def test_the_t_pose_gives_the_reference(robot: RobotModel) -> None:
    mapper, stack = make(robot, reach=1.0, leg_reach=1.0)
    mapper.step(t_pose(), stack)
    limbs = RobotLimbs(robot, 1.0, 1.0)
    np.testing.assert_allclose(targets(stack), limbs.origin + limbs.within_reach(limbs.reference), atol=1e-9)


@given(limb=st.integers(0, 3), seed=st.integers(0, 2**31), length=st.floats(0.0, 0.2))
@settings(max_examples=30, deadline=None)
def test_a_change_is_scaled_by_the_limb_ratio(robot: RobotModel, limb: int, seed: int, length: float) -> None:
    mapper, stack = make(robot)
    frame, role = t_pose(), ("left_hand", "right_hand", "left_ankle", "right_ankle")[limb]
    position = frame.position.copy()
    start = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")[limb]
    limb_vector = position[ROLE_INDEX[role]] - position[ROLE_INDEX[start]]
    change = np.random.default_rng(seed).normal(size=3)
    change = -0.3 * limb_vector + length * change / np.linalg.norm(change)  # bent: within reach
    position[ROLE_INDEX[role]] += change
    mapper.step(replace(frame, position=position), stack)
    limbs = RobotLimbs(robot, mapper.config.reach, mapper.config.leg_reach)
    ratio = np.linalg.norm(limbs.reference[limb]) / np.linalg.norm(mapper.human_reference[limb])
    expected = limbs.origin + limbs.within_reach(limbs.reference + np.eye(4)[limb][:, None] * ratio * change)
    np.testing.assert_allclose(targets(stack), expected, atol=1e-9)


@given(yaw=st.floats(-3.1, 3.1), x=st.floats(-20, 20), y=st.floats(-20, 20))
@settings(max_examples=20, deadline=None)
def test_turning_and_moving_the_human_changes_no_target(
    robot: RobotModel, yaw: float, x: float, y: float
) -> None:
    c, s = np.cos(yaw), np.sin(yaw)
    R, shift = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0])
    frame = make_frames("single_leg_balance")[150]
    (one, a), (other, b) = make(robot), make(robot)
    one.step(frame, a)
    other.step(replace(frame, position=frame.position @ R.T + shift), b)
    np.testing.assert_allclose(targets(a), targets(b), atol=1e-9)
    np.testing.assert_allclose(R @ a["waist"].target, b["waist"].target, atol=1e-9)


def test_targets_are_within_reach(robot: RobotModel) -> None:
    mapper, stack = make(robot)
    limbs = RobotLimbs(robot, mapper.config.reach, mapper.config.leg_reach)
    longest = np.linalg.norm(limbs.within_reach(1e3 * limbs.reference), axis=1)
    for frame in make_frames("slow_dance"):
        mapper.step(frame, stack)
        assert (np.linalg.norm(targets(stack) - limbs.origin, axis=1) <= longest + 1e-9).all()


def test_the_foot_that_stands_keeps_its_place(robot: RobotModel) -> None:
    mapper, stack = make(robot)
    places = []
    for frame in make_frames("single_leg_balance")[60:300]:
        mapper.step(frame, stack)
        if frame.support is not None and frame.support.left and not frame.support.right:
            T = stack.anchor_pose
            places.append(T[:3, :3] @ stack["left_foot"].target + T[:3, 3])
    assert len(places) > 100
    np.testing.assert_allclose(places, np.tile(places[0], (len(places), 1)), atol=1e-9)
    assert places[0][2] == pytest.approx(0.0)


def test_the_t_pose_is_found_in_the_recording(robot: RobotModel) -> None:
    mapper, _ = make(robot, calibration="recording")
    position = 1.1 * t_pose().position  # somebody taller than the skeleton says
    mapper.calibrate([*make_frames("wave", 20), replace(t_pose(), position=position)])
    human = HumanLimbs(make_skeleton())
    human.take(replace(t_pose(), position=position))
    np.testing.assert_allclose(mapper.human_reference, human.vectors)


def test_without_a_t_pose_it_says_so_or_takes_the_rest_pose(robot: RobotModel) -> None:
    frames = make_frames("squat", 30)
    mapper, _ = make(robot, calibration="recording")
    with pytest.raises(ImitorError, match="no T-pose in the first 3 s: arms sideways and legs straight"):
        mapper.calibrate(frames)
    other, _ = make(robot)
    before = other.human_reference.copy()
    other.calibrate(frames)
    np.testing.assert_array_equal(other.human_reference, before)


def test_the_reference_can_be_given(robot: RobotModel) -> None:
    given_vectors = {"hand": (0.0, 0.7, 0.0), "foot": (0.0, 0.02, -0.85)}
    mapper, _ = make(robot, calibration="given", reference=given_vectors)
    assert mapper.human_reference.tolist() == [[0, 0.7, 0], [0, -0.7, 0], [0, 0.02, -0.85], [0, -0.02, -0.85]]
    with pytest.raises(ImitorError, match="needs both `hand` and `foot`"):
        make(robot, calibration="given", reference={"hand": (0.0, 0.7, 0.0)})


def test_a_robot_without_t_pose_uses_its_reference_vectors() -> None:
    romeo = make_robot("romeo")
    limbs, lengths = RobotLimbs(romeo, 1.0, 1.0), romeo.segment_lengths()
    arm = lengths["left_upper_arm"] + lengths["left_forearm"] + lengths.get("left_hand", 0.0)
    np.testing.assert_allclose(limbs.reference[0], arm * np.array([0.4462, 0.8949, 0.0]), atol=1e-3)
    np.testing.assert_allclose(limbs.reference[1], limbs.reference[0] * [1, -1, 1], atol=1e-12)


def test_what_a_t_pose_is() -> None:
    vectors = np.array([[0, 0.6, 0.0], [0, -0.6, 0], [0, 0, -0.9], [0, 0, -0.9]])
    assert looks_like_t_pose(vectors, 0.3)
    lowered = vectors.copy()
    lowered[0] = (0.0, 0.42, -0.42)
    assert not looks_like_t_pose(lowered, 0.3)
    assert looks_like_t_pose(lowered, 0.8)
