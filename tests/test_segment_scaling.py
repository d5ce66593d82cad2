"""Segment scaling: the robot's lengths, the human's directions, wherever and whichever way the human stands."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.errors import SourceError
from imitor.mapping.scaled_body import POINTS, ScaledBody
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.spec import load_pipeline
from imitor.testing import make_frames, make_robot, make_skeleton
from imitor.types import ROLE_INDEX, ROLES, SEGMENTS, SIDES, HumanFrame, Skeleton

ROBOTS = ("unitree_g1", "romeo", "talos")
SEEDS = st.integers(0, 2**32 - 1)
ENDS = {
    **SEGMENTS,
    "hips": ("right_hip", "left_hip"),
    "shoulders": ("right_shoulder", "left_shoulder"),
    "head": ("mid_shoulder", "head"),
    **{f"{side}_hand": (f"{side}_wrist", f"{side}_hand") for side in SIDES},
}
MIRROR = [
    ROLE_INDEX[r.replace("left_", "x_").replace("right_", "left_").replace("x_", "right_")] for r in ROLES
]


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return make_robot(request.param)


def random_frame(seed: int) -> HumanFrame:
    """Points anywhere within a few metres: no pose is assumed."""
    position = np.random.default_rng(seed).normal(size=(len(ROLES), 3))
    return HumanFrame(0.0, position, np.ones(len(ROLES), dtype=bool))


def human_point(frame: HumanFrame, name: str) -> np.ndarray:
    if name.startswith("mid_"):
        return np.asarray(np.mean([human_point(frame, f"{side}_{name[4:]}") for side in SIDES], axis=0))
    return np.asarray(frame.position[ROLE_INDEX[name]])


def scaled_point(body: ScaledBody, name: str) -> np.ndarray:
    return np.asarray(body.relative[POINTS.index(name)])


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_lengths_are_the_robots_and_directions_the_humans(robot: RobotModel, seed: int) -> None:
    body, frame = ScaledBody(robot, make_skeleton(), 0.01), random_frame(seed)
    body.take(frame)
    lengths = robot.segment_lengths()
    for name, (a, b) in ENDS.items():
        d = scaled_point(body, b) - scaled_point(body, a)
        human = human_point(frame, b) - human_point(frame, a)
        expected = lengths[name] * human / np.linalg.norm(human)
        if name in body.segments and name in lengths:
            np.testing.assert_allclose(d, expected, atol=1e-12, err_msg=name)
            unit = body.direction[body.segments.index(name)]
            np.testing.assert_allclose(unit, human / np.linalg.norm(human), atol=1e-12)
    assert body.seen.all()


@given(seed=SEEDS, yaw=st.floats(-np.pi, np.pi), x=st.floats(-20, 20), y=st.floats(-20, 20))
@settings(max_examples=40, deadline=None)
def test_turning_and_moving_the_human_turns_and_moves_the_body(
    robot: RobotModel, seed: int, yaw: float, x: float, y: float
) -> None:
    R = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([x, y, 0.0])
    one, other = ScaledBody(robot, make_skeleton(), 0.01), ScaledBody(robot, make_skeleton(), 0.01)
    frame = random_frame(seed)
    one.take(frame)
    other.take(HumanFrame(0.0, frame.position @ R.T + shift, frame.valid))
    np.testing.assert_allclose(other.relative, one.relative @ R.T, atol=1e-9)
    np.testing.assert_allclose(other.mid_hip, R @ one.mid_hip + shift, atol=1e-9)
    assert other.leg_ratio == pytest.approx(one.leg_ratio)


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_the_mirrored_human_gives_the_mirrored_body(robot: RobotModel, seed: int) -> None:
    lengths = robot.segment_lengths()
    one, other = ScaledBody(robot, make_skeleton(), 0.01), ScaledBody(robot, make_skeleton(), 0.01)
    frame = random_frame(seed)
    one.take(frame)
    other.take(HumanFrame(0.0, (frame.position * [1.0, -1.0, 1.0])[MIRROR], frame.valid))
    for point in POINTS:
        twin = point.replace("left_", "x_").replace("right_", "left_").replace("x_", "right_")
        difference = scaled_point(other, twin) - scaled_point(one, point) * [1.0, -1.0, 1.0]
        limbs = ("upper_arm", "forearm", "thigh", "shank")
        uneven = max(abs(lengths[f"left_{s}"] - lengths[f"right_{s}"]) for s in limbs)
        assert np.abs(difference).max() <= 4 * uneven + 1e-9, point


@given(seed=SEEDS, scale=st.floats(0.3, 3.0))
@settings(max_examples=20, deadline=None)
def test_the_size_of_the_human_does_not_matter(robot: RobotModel, seed: int, scale: float) -> None:
    one, other = ScaledBody(robot, make_skeleton(), 0.01), ScaledBody(robot, make_skeleton(), 0.01)
    frame = random_frame(seed)
    one.take(frame)
    other.take(HumanFrame(0.0, scale * frame.position, frame.valid))
    np.testing.assert_allclose(other.relative, one.relative, atol=1e-9)
    assert other.leg_ratio == pytest.approx(one.leg_ratio / scale)


@given(seed=SEEDS, lost=st.sets(st.sampled_from(ROLES), max_size=8))
@settings(max_examples=60, deadline=None)
def test_lost_points_keep_the_last_direction(robot: RobotModel, seed: int, lost: set[str]) -> None:
    body = ScaledBody(robot, make_skeleton(), 0.01)
    first, second = random_frame(seed), random_frame(seed + 1)
    body.take(first)
    before = body.direction.copy()
    index = [ROLE_INDEX[r] for r in lost]
    second.valid[index] = False
    second.position[index] = np.nan
    body.take(second)
    for i, name in enumerate(body.segments):
        ends = {end for end in ENDS[name] if not end.startswith("mid_")}
        ends |= {f"{side}_{end[4:]}" for end in ENDS[name] if end.startswith("mid_") for side in SIDES}
        seen = not lost & ends
        assert body.seen[i] == seen, name
        if seen:
            d = human_point(second, ENDS[name][1]) - human_point(second, ENDS[name][0])
            np.testing.assert_allclose(body.direction[i], d / np.linalg.norm(d), atol=1e-12)
        else:
            np.testing.assert_array_equal(body.direction[i], before[i])
    assert np.isfinite(body.relative).all()


def test_what_was_never_seen_hangs_as_when_standing(robot: RobotModel) -> None:
    body = ScaledBody(robot, make_skeleton(), 0.01)
    nothing = HumanFrame(0.0, np.full((len(ROLES), 3), np.nan), np.zeros(len(ROLES), dtype=bool))
    body.take(nothing)
    assert (scaled_point(body, "left_wrist") - scaled_point(body, "left_shoulder"))[2] < 0
    assert scaled_point(body, "head")[2] > scaled_point(body, "mid_shoulder")[2] > 0
    assert scaled_point(body, "left_hip")[1] > 0 > scaled_point(body, "right_hip")[1]


def test_points_on_top_of_each_other_keep_the_last_direction(robot: RobotModel) -> None:
    body, frame = ScaledBody(robot, make_skeleton(), 0.01), random_frame(1)
    body.take(frame)
    before = body.direction[body.segments.index("left_forearm")].copy()
    frame.position[ROLE_INDEX["left_wrist"]] = frame.position[ROLE_INDEX["left_elbow"]]
    body.take(frame)
    np.testing.assert_array_equal(body.direction[body.segments.index("left_forearm")], before)


def test_a_skeleton_without_elbows_is_refused(robot: RobotModel) -> None:
    s = make_skeleton()
    bare = Skeleton("bare", s.roles - {"left_elbow", "right_elbow"}, s.rest_position, 1.75)
    with pytest.raises(
        SourceError, match=r"bare: the skeleton has no left_elbow, right_elbow; segment scaling needs"
    ):
        ScaledBody(robot, bare, 0.01)


# ---------------------------------------------------------------- feet, in the whole pipeline

SCENARIOS = ("step_forward", "walk", "weight_shift_foot_lift")


def played(robot: str, scenario: str, rate_hz: float = 60.0) -> dict[str, np.ndarray]:
    """Run the preset and return poses of foot tasks and feet, corners, contact, anchors."""
    registry = Registry(entry_points=False)
    sets = [f"source.scenario={scenario}", f"source.rate_hz={rate_hz}"]
    spec = load_pipeline("retarget", registry, robot=robot, sets=sets)
    pipeline = Pipeline(spec, registry)
    out: dict[str, list[Any]] = {
        k: [] for k in ("target", "foot", "contact", "human", "corners", "anchor", "placed")
    }
    for record in pipeline.records():
        stack, model = record.stack, pipeline.robot
        out["target"].append([stack[f"{s}_foot"].target.copy() for s in SIDES])
        out["foot"].append([model.pose(f"{s}_foot") for s in SIDES])
        out["corners"].append(model.sole_corners())
        out["contact"].append(record.state.contact.copy())
        out["placed"].append([bool(stack[f"{s}_foot"].mask[0]) for s in SIDES])
        out["anchor"].append(SIDES.index(stack.anchor[:-5]) if stack.anchor else -1)
        assert record.human.support is not None
        out["human"].append([record.human.support.left, record.human.support.right])
    pipeline.close()
    return {k: np.array(v) for k, v in out.items()}


@pytest.fixture(scope="module")
def performances() -> dict[tuple[str, str], dict[str, np.ndarray]]:
    return {(r, s): played(r, s) for r in ROBOTS for s in SCENARIOS}


@pytest.fixture(params=[(r, s) for r in ROBOTS for s in SCENARIOS], ids="-".join)
def performance(
    request: pytest.FixtureRequest, performances: dict[tuple[str, str], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    return performances[request.param]


def stances(contact: np.ndarray) -> list[slice]:
    """Return the runs of frames in which a foot stands."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], contact.astype(int), [0]])))
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def test_the_robot_stands_on_the_feet_that_the_human_stands_on(performance: dict[str, np.ndarray]) -> None:
    np.testing.assert_array_equal(performance["contact"], performance["human"])


def test_standing_feet_do_not_move(performance: dict[str, np.ndarray]) -> None:
    for i in range(2):
        for stance in stances(performance["contact"][:, i]):
            placed = performance["placed"][stance, i]
            lying = int(np.argmax(placed))  # until it lies flat, a landing foot may shift
            assert lying <= 10 and placed[lying:].all()
            lying += 0 if stance.start == 0 else 20  # and then comes to lie flat
            stance = slice(stance.start + lying, stance.stop)  # noqa: PLW2901
            targets, feet = performance["target"][stance, i], performance["foot"][stance, i]
            np.testing.assert_allclose(targets, targets[:1].repeat(len(targets), axis=0), atol=1e-9)
            off = np.abs(feet[:, :3, 3] - targets[:, :3, 3])[6:].max(axis=0, initial=0.0)
            # A slow robot arrives a little late; a stretched leg lifts the rear foot a little.
            assert off[:2].max() < 2e-3
            assert off[2] < 6e-3
            held = performance["anchor"][stance] == i
            if held.any():
                assert np.abs(feet[held] - targets[held]).max() < 1e-9


def test_one_foot_that_stands_is_the_anchor(performance: dict[str, np.ndarray]) -> None:
    anchor, contact = performance["anchor"], performance["contact"]
    assert (anchor[contact.any(axis=1)] >= 0).all()
    assert all(contact[k, a] for k, a in enumerate(anchor) if a >= 0)


def test_feet_move_without_jumps(performance: dict[str, np.ndarray]) -> None:
    """The targets of the feet, through lift-off and landing: no step of a frame is unlike its neighbours."""
    step = np.linalg.norm(np.diff(performance["target"][:, :, :3, 3], axis=0), axis=2)
    assert step.max() < 3.5 / 60.0  # 3.5 m/s, a human's foot in the same walk 2.7 m/s
    assert np.abs(np.diff(step, axis=0)).max() < 0.04


@pytest.mark.parametrize("robot_name", ROBOTS)
@pytest.mark.parametrize("scenario", ["step_forward", "weight_shift_foot_lift"])
def test_the_robot_follows_slow_feet(
    performances: dict[tuple[str, str], dict[str, np.ndarray]], robot_name: str, scenario: str
) -> None:
    performance = performances[robot_name, scenario]
    step = np.linalg.norm(np.diff(performance["foot"][:, :, :3, 3], axis=0), axis=2)
    assert step.max() < 1.5 / 60.0
    assert np.abs(np.diff(step, axis=0)).max() < 0.02
    assert performance["corners"][..., 2].min() > -5e-3


def test_targets_join_at_lift_off(performance: dict[str, np.ndarray]) -> None:
    """When a foot lifts off, its target leaves from where the foot stood."""
    for i in range(2):
        for stance in stances(performance["contact"][:, i]):
            if stance.stop < len(performance["contact"]):
                a, b = performance["target"][stance.stop - 1, i], performance["target"][stance.stop, i]
                assert np.abs(b[:2, 3] - a[:2, 3]).max() < 0.02


def test_target_soles_never_dip_below_the_floor(
    performances: dict[tuple[str, str], dict[str, np.ndarray]],
) -> None:
    for (name, _), performance in performances.items():
        sole = make_robot(name).sole
        for i in range(2):
            T = performance["target"][:, i]
            corners = np.einsum("tij,kj->tki", T[:, :3, :3], sole[i]) + T[:, None, :3, 3]
            assert corners[..., 2].min() > -1e-9, name


def test_the_performance_does_what_it_is_for() -> None:
    """A step is a step: the robot ends further ahead, by the ratio of the legs."""
    frames = make_frames("step_forward")
    human = frames[-1].position[ROLE_INDEX["pelvis"]] - frames[0].position[ROLE_INDEX["pelvis"]]
    feet = played("unitree_g1", "step_forward", 30.0)["foot"]
    robot_step = feet[-1, :, 0, 3].mean() - feet[0, :, 0, 3].mean()
    assert 0.3 * human[0] < robot_step < human[0]
