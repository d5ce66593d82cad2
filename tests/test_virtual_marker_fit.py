"""Fit of virtual markers: analytic derivatives, calibration, exact recovery, hands before the rest, lost points."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor import HumanFrame, TaskStack, testing
from imitor.errors import ImitorError
from imitor.kinds import Context
from imitor.mapping.marker_imitation import MarkerImitation, analytic_step
from imitor.mapping.marker_mapper import MarkerMapper
from imitor.mapping.segment_factors import segment_factors
from imitor.mapping.virtual_markers import Weights
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, Array, Skeleton

FULL = Weights()


@cache
def romeo() -> RobotModel:
    return testing.make_robot("romeo")


@cache
def person(scenario: str = "open_close_drawer", **options: Any) -> tuple[tuple[HumanFrame, ...], Skeleton]:
    """Return the frames of a performer in markers who first holds the calibration pose, and the skeleton."""
    kind = Registry(entry_points=False).get("source", "performer")
    source: Any = kind(
        kind.config_type.model_validate(
            {"scenario": scenario, "targets": True, "arms_forward_s": 1.0, "rate_hz": 50.0, **options}
        )
    )
    source.start()
    return tuple(source.frames()), source.skeleton


def imitation(weights: Weights = FULL, trunk: Any = "prismatic", **options: Any) -> MarkerImitation:
    frames, skeleton = person(**options)
    made = MarkerImitation(romeo(), skeleton.target_names, trunk, {}, weights, analytic_step, 1)
    made.calibrate(frames[:50])
    made.reset()
    return made


def mapper(name: str, **options: Any) -> tuple[MarkerMapper[Any], TaskStack, tuple[HumanFrame, ...]]:
    frames, skeleton = person(**options)
    kind: Any = Registry(entry_points=False).get("mapper", name)
    made = kind(kind.config_type(pose={}), Context(romeo(), skeleton, 0.02))
    stack = TaskStack(romeo().n)
    made.declare(stack)
    stack.compile()
    made.start()
    made.calibrate(frames[:50])
    made.reset()
    return made, stack, frames


@given(st.integers(0, 10_000), st.sampled_from(["prismatic", "free"]))
@settings(max_examples=25, deadline=None)
def test_the_derivative_is_that_of_the_criterion(seed: int, trunk: str) -> None:
    """Eq. 10 against central differences, at random configurations far from the targets."""
    made = imitation(trunk=trunk)
    criterion, model = made.criterion, made.model
    rng = np.random.default_rng(seed)
    goal, real = criterion.targets(person()[0][200])
    model.move(rng.normal(0.0, 0.4, model.columns.size))
    start = model.q.copy()

    def error(nudge: Array) -> Array:
        model.q[:] = start
        model.move(nudge)
        model.update()
        return criterion.rows(goal, real)[0]

    error(np.zeros(model.columns.size))
    analytic = criterion.rows(goal, real)[1]
    h = 1e-6
    for k in range(model.columns.size):
        nudge = np.zeros(model.columns.size)
        nudge[k] = h
        numeric = (error(nudge) - error(-nudge)) / (2 * h)
        np.testing.assert_allclose(analytic[:, k], numeric, atol=2e-7)


def test_the_model_has_three_shifts_and_the_arms() -> None:
    free = imitation().model.columns
    assert free[:3].tolist() == [0, 1, 2]
    names = [romeo().joint_names[c - 6] for c in free[3:]]
    assert len(names) == 15
    assert all("Trunk" in n or "Shoulder" in n or "Elbow" in n or "Wrist" in n for n in names)


def test_the_scaled_robot_has_the_lengths_of_the_person() -> None:
    frames, _ = person()
    scaled = romeo().scaled(segment_factors(romeo(), frames[:50]))
    lengths = scaled.segment_lengths()
    for name, human in (("left_upper_arm", 0.186), ("right_forearm", 0.146), ("shoulders", 0.220)):
        assert lengths[name] == pytest.approx(human * 1.75, abs=1e-9)
    assert lengths["left_hand"] == pytest.approx(0.050 * 1.75, abs=1e-9)


def test_left_and_right_are_scaled_alike() -> None:
    frames, _ = person()
    longer = []
    for f in frames[:20]:
        position = f.position.copy()
        position[ROLE_INDEX["left_elbow"]] += 0.1 * (
            position[ROLE_INDEX["left_elbow"]] - position[ROLE_INDEX["left_shoulder"]]
        )
        longer.append(replace(f, position=position))
    factors = segment_factors(romeo(), longer)
    assert factors["left_upper_arm"] == pytest.approx(factors["right_upper_arm"], abs=1e-12)
    assert factors["left_upper_arm"] == pytest.approx(1.05 * 0.186 * 1.75 / 0.205, abs=1e-6)


def test_markers_of_the_scaled_robot_itself_are_followed_exactly() -> None:
    """A person who is the scaled robot: after a step from nearby the error is of second order."""
    made = imitation()
    criterion, model = made.criterion, made.model
    rng = np.random.default_rng(1)
    model.move(rng.normal(0.0, 0.3, model.columns.size))
    model.update()
    there, truth = model.points(), model.q.copy()
    real = np.array(
        [
            np.block(
                [[model.robot.data.oMi[j].rotation @ v[:3, :3], np.zeros((3, 1))], [np.zeros((1, 3)), 1.0]]
            )
            for j, v in zip(criterion.carrier, criterion.virtual, strict=True)
        ]
    )
    away = rng.normal(0.0, 0.02, model.columns.size)
    model.move(away)
    model.update()
    before = np.linalg.norm(model.points() - there)
    for expected in (0.1, 0.01):
        model.move(analytic_step(criterion, there, real))
        model.update()
        assert np.linalg.norm(model.points() - there) < expected * before
    np.testing.assert_allclose(model.q, truth, atol=1e-3)


def hand_errors(
    made: MarkerMapper[Any], stack: TaskStack, frames: tuple[HumanFrame, ...]
) -> tuple[Array, ...]:
    """Return distances of hand joints, shoulders and elbows, and markers from the recorded ones."""
    criterion = made.imitation.criterion
    out = []
    for f in frames:
        made.step(f, stack)
        criterion.model.update()
        goal, _ = criterion.targets(f)
        out.append(np.linalg.norm(goal - criterion.model.points(), axis=1))
    distance = np.array(out)[50:]
    n_m, n_j = len(criterion.arms.markers), len(criterion.arms.joints)
    return distance[:, n_m + n_j :], distance[:, n_m : n_m + n_j], distance[:, :n_m]


CAPTURED = {"noise_std_m": 0.0005, "skin_motion_m": 0.010, "joint_motion_m": 0.002, "seed": 3}


def test_hands_are_within_4_mm_in_the_drawer_task_and_the_arms_within_25() -> None:
    hands, joints, _ = hand_errors(*mapper("virtual_marker_fit", **CAPTURED))
    assert hands.max() < 0.004
    assert joints.max() < 0.025


def test_hands_are_better_and_markers_worse_than_with_markers_alone() -> None:
    hands, _, markers = hand_errors(*mapper("virtual_marker_fit", **CAPTURED))
    other_hands, _, other_markers = hand_errors(*mapper("marker_fit", **CAPTURED))
    assert hands.mean() < 0.3 * other_hands.mean()
    assert other_markers.mean() < markers.mean()


def test_without_error_of_capture_markers_alone_still_find_the_arms() -> None:
    hands, _, markers = hand_errors(*mapper("marker_fit"))
    assert markers.mean() < 0.01
    assert hands.mean() < 0.06


def test_lost_markers_leave_the_rest_and_nothing_seen_leaves_all() -> None:
    made, stack, frames = mapper("virtual_marker_fit")
    for f in frames[:150]:
        made.step(f, stack)
    blind = replace(
        frames[150],
        position=np.full_like(frames[150].position, np.nan),
        target=np.full_like(frames[150].target, np.nan),
    )
    before = stack.flat_target.copy()
    made.step(blind, stack)
    np.testing.assert_allclose(stack.flat_target, before, atol=1e-12)
    one_lost = frames[150].target.copy()  # type: ignore[union-attr]
    one_lost[0] = np.nan
    made.step(replace(frames[150], target=one_lost), stack)
    assert np.isfinite(stack.flat_target).all()


def test_no_markers_in_the_calibration_is_told() -> None:
    frames, skeleton = person()
    made = MarkerImitation(romeo(), skeleton.target_names, "prismatic", {}, FULL, analytic_step, 1)
    with pytest.raises(ImitorError, match="not all markers of the arms"):
        made.calibrate([replace(f, target=None, target_valid=None) for f in frames[:10]])
    with pytest.raises(ImitorError, match="Elbw"):
        MarkerImitation(romeo(), skeleton.target_names, "prismatic", {"LElbw": 1.0}, FULL, analytic_step, 1)


@pytest.mark.parametrize("name", ["virtual_marker_fit", "marker_fit"])
def test_a_robot_that_is_held_at_its_pelvis_stands_on_no_foot(name: str) -> None:
    made, stack, frames = mapper(name)
    assert stack.contact.all()  # as of any stack
    made.step(frames[0], stack)
    assert stack.anchor == "waist"
    assert stack.contact.tolist() == [False, False]
