"""The Humanoid-Normalized model: scale, planes, arm planes, and what becomes of lost markers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.kinds import Context
from imitor.mapping.normalized import ArmPlane, NormalizedBody
from imitor.mapping.scaling_mapper import SegmentScalingConfig
from imitor.plugins.mappers.normalized_model import NormalizedModel
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.robot.model import RobotModel
from imitor.tasks import TaskStack
from imitor.types import SIDES, HumanFrame, Skeleton

RATE_HZ = 50.0


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return RobotModel.load("hrp2")


def perform(scenario: str, **options: Any) -> tuple[Skeleton, list[HumanFrame]]:
    source = Performer(PerformerConfig(scenario=scenario, rate_hz=RATE_HZ, **options))
    source.start()
    return source.skeleton, list(source.frames())


def play(robot: RobotModel, scenario: str, **options: Any) -> list[dict[str, np.ndarray]]:
    """Return the targets of each frame by task."""
    skeleton, frames = perform(scenario, **options)
    return follow(robot, skeleton, frames)


def follow(robot: RobotModel, skeleton: Skeleton, frames: list[HumanFrame]) -> list[dict[str, np.ndarray]]:
    mapper = NormalizedModel(SegmentScalingConfig(), Context(robot, skeleton, 1 / RATE_HZ))
    stack = TaskStack(robot.n)
    mapper.declare(stack)
    stack.compile()
    mapper.start()
    mapper.reset()
    robot.update(robot.standing)
    out = []
    for frame in frames:
        mapper.step(frame, stack)
        out.append({task.name: task.target.copy() for task in stack})
    return out


@pytest.mark.parametrize("name", ["hrp2", "unitree_g1", "romeo", "talos"])
def test_the_rest_pose_of_the_human_is_the_standing_posture_of_the_robot(name: str) -> None:
    robot = RobotModel.load(name)
    targets = play(robot, "t_pose")[0]
    robot.update(robot.standing)
    offset = targets["head"] - 0.5 * (targets["left_foot"] + targets["right_foot"])[:3, 3]
    feet = 0.5 * (robot.position("left_foot") + robot.position("right_foot"))
    knees = 0.05 * robot.com[2]  # robots that stand straight get room for the knees
    assert np.abs(offset - (robot.position("head") - feet))[:2].max() < 0.01
    assert -knees < offset[2] - (robot.position("head") - feet)[2] < 0.01
    for part in ("head", "chest", "waist"):
        assert targets[f"{part}_vector"] @ [1, 0, 0] > 0.995


@settings(max_examples=8, deadline=None)
@given(height=st.floats(1.3, 2.1))
def test_the_size_of_the_human_does_not_matter(robot: RobotModel, height: float) -> None:
    reference = play(robot, "slow_dance", height_m=1.75)
    other = play(robot, "slow_dance", height_m=height)
    for a, b in list(zip(reference, other, strict=True))[::25]:
        for name in ("head", "left_wrist", "right_wrist"):
            p, q = (t[name] if t[name].ndim == 1 else t[name][:3, 3] for t in (a, b))
            feet = [0.5 * (t["left_foot"] + t["right_foot"])[:3, 3] for t in (a, b)]
            assert np.linalg.norm((p - feet[0]) - (q - feet[1])) < 0.01


def test_markers_and_orientations_give_the_same_planes(robot: RobotModel) -> None:
    plain = play(robot, "slow_dance")
    marked = play(robot, "slow_dance", markers="41")
    for a, b in zip(plain, marked, strict=True):
        for part in ("head", "chest", "waist"):
            assert a[f"{part}_vector"] @ b[f"{part}_vector"] > np.cos(0.06)


def test_lost_markers_leave_the_plane_as_it_was(robot: RobotModel) -> None:
    skeleton, frames = perform("slow_dance", markers="41")
    seen = [i for i, name in enumerate(skeleton.marker_names) if "HD" not in name]
    whole = follow(robot, skeleton, frames)
    for frame in frames[200:230]:
        assert frame.marker_valid is not None
        valid = np.zeros(len(skeleton.marker_names), dtype=bool)
        valid[seen] = True
        frame.marker_valid = valid
    lost = follow(robot, skeleton, frames)
    for k in range(200, 230):
        np.testing.assert_array_equal(lost[k]["head_vector"], whole[199]["head_vector"])
        np.testing.assert_array_equal(lost[k]["chest_vector"], whole[k]["chest_vector"])
    np.testing.assert_array_equal(lost[230]["head_vector"], whole[230]["head_vector"])


unit = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(upper=unit, forearm=unit)
def test_the_arm_plane_is_a_rotation_with_the_forearm_and_the_elbow_axis(
    upper: np.ndarray, forearm: np.ndarray
) -> None:
    upper, forearm = upper / np.linalg.norm(upper), forearm / np.linalg.norm(forearm)
    arm = ArmPlane()
    axes = arm.step(upper, forearm)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-9)
    assert np.linalg.det(axes) > 0
    np.testing.assert_allclose(axes[:, 2], forearm, atol=1e-12)
    for _ in range(200):
        axes = arm.step(upper, forearm)
    normal = np.cross(upper, forearm)
    if np.linalg.norm(normal) > 0.2:  # a bent arm shows its plane
        assert axes[:, 1] @ normal / np.linalg.norm(normal) > 0.99


def test_wrists_stay_within_reach_of_the_arms(robot: RobotModel) -> None:
    lengths = robot.segment_lengths()
    skeleton, frames = perform("t_pose")
    body = NormalizedBody(robot, skeleton, 1 / RATE_HZ)
    ankles = (robot.position("left_ankle").copy(), robot.position("right_ankle").copy())
    for frame in frames[:5]:
        body.body.take(frame)
        body.step(frame, frame.support, ankles, np.array([True, True]))
        for i, side in enumerate(SIDES):
            arm = lengths[f"{side}_upper_arm"] + lengths[f"{side}_forearm"]
            sign = 1 if i == 0 else -1
            across = body.mid_shoulder + sign * np.array([0.0, 0.5 * lengths["shoulders"], 0.0])
            reach = np.linalg.norm(body.wrist[i, :3, 3] - across)
            assert 0.9 * arm < reach < 0.98 * arm
