"""Static balance over the whole of koenemann_2014: whatever the human does, the robot stands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imitor.balance.stance import Stance, footprint, moved_inside
from imitor.metrics.polygon import convex_hull, margin
from imitor.pipeline import Pipeline
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import ROLE_INDEX, Array, BoolArray, HumanFrame, Support

RATE_HZ = 30.0
TOUCH_M = 0.003
LEAST_M = 0.005
UPPER = [
    i for role, i in ROLE_INDEX.items() if not role.endswith(("knee", "ankle", "heel", "toe", "toe_tip"))
]


def leg(side: str) -> list[int]:
    return [ROLE_INDEX[f"{side}_{role}"] for role in ("ankle", "heel", "toe", "toe_tip")]


@dataclass
class Played:
    """What the robot did, frame by frame."""

    margin: Array
    contact: BoolArray
    sole: Array
    over: Array  # margin of the CoM in each sole [m]
    q: Array
    held: BoolArray


@pytest.fixture(scope="module")
def pipeline() -> Iterator[Pipeline]:
    """The preset on nao_v4."""
    registry = Registry(entry_points=False)
    built = Pipeline(load_pipeline("koenemann_2014", registry, sets=["source.scenario=stand"]), registry)
    yield built
    built.close()


def played(pipeline: Pipeline, frames: Iterable[HumanFrame]) -> Played:
    """Play frames and measure the robot on its own feet."""
    pipeline.reset()
    robot, rows = pipeline.robot, []
    for frame in frames:
        pipeline.step(frame)
        soles = robot.sole_corners()
        touching = [(float(x), float(y)) for x, y, z in soles.reshape(-1, 3) if z <= TOUCH_M]
        com = (float(robot.com[0]), float(robot.com[1]))
        stance = Stance.of(robot)
        state = pipeline.state
        rows.append(
            (
                margin(com, convex_hull(touching)) if touching else -1.0,
                state.contact.copy(), soles, [stance.margin_m(i) for i in range(2)],
                state.q.copy(), state.status == 1,
            )
        )  # fmt: skip
    return Played(*(np.array(column) for column in zip(*rows, strict=True)))


def check_stands(pipeline: Pipeline, done: Played) -> None:
    """Stable, on its feet, within limits, and no foot lifts before the CoM is over the other one."""
    robot = pipeline.robot
    assert done.margin.min() >= LEAST_M
    assert done.contact.any(axis=1).all()
    assert done.sole[..., 2].min() > -TOUCH_M
    joints = done.q[:, 7:]
    assert (joints >= robot.lower - 1e-9).all()
    assert (joints <= robot.upper + 1e-9).all()
    assert (np.abs(np.diff(joints, axis=0)) <= robot.speed / RATE_HZ + 1e-9).all()
    lifts = done.contact[:-1] & ~done.contact[1:]
    for frame, foot in np.argwhere(lifts):
        assert done.over[frame, 1 - foot] >= LEAST_M
    stands = done.contact & (np.abs(done.sole[..., 2]).max(axis=2) < TOUCH_M)  # and is not just coming down
    standing = stands[1:] & stands[:-1]
    slid = np.linalg.norm(np.diff(done.sole.mean(axis=2)[..., :2], axis=0), axis=2) * RATE_HZ
    assert (
        slid[standing].max(initial=0.0) < 0.5
    )  # slide_m_s, and feet that part because their ankles would touch


def human(scenario: str) -> list[HumanFrame]:
    """Return a scenario as a capture without support and CoM has it: positions alone."""
    source = Performer(PerformerConfig(scenario=scenario, rate_hz=RATE_HZ))
    source.start()
    return [HumanFrame(f.time_s, f.position.copy(), f.valid.copy()) for f in source.frames()]


def standing(seconds: float) -> list[HumanFrame]:
    first = human("stand")[0]
    n = round(seconds * RATE_HZ)
    return [HumanFrame(i / RATE_HZ, first.position.copy(), first.valid.copy()) for i in range(n)]


def ramp(n: int, begin_s: float, end_s: float) -> Array:
    t = np.clip((np.arange(n) / RATE_HZ - begin_s) / (end_s - begin_s), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


# ---------------------------------------------------------------------- declared behaviour on bad input


def test_points_lost_the_robot_keeps_its_pose_and_goes_on(pipeline: Pipeline) -> None:
    frames = human("single_leg_balance")
    lost = slice(100, 160)  # on one leg for a part of it
    for frame in frames[lost]:
        frame.position[:], frame.valid[:] = np.nan, False
    done = played(pipeline, frames)
    check_stands(pipeline, done)
    still = np.abs(np.diff(done.q[lost, 7:][40:], axis=0)).max()
    assert still < 0.01
    assert (done.contact.sum(axis=1) == 1).sum() > 60


def test_a_jump_leaves_the_robot_on_its_feet(pipeline: Pipeline) -> None:
    frames = standing(4.0)
    for frame in frames:
        t = frame.time_s - 2.0
        frame.position[:, 2] += max(0.0, 0.3 - 4.9 * (t - 0.25) ** 2) if 0.0 < t < 0.5 else 0.0
    done = played(pipeline, frames)
    check_stands(pipeline, done)
    assert done.contact.all()


def test_a_start_on_one_leg_begins_on_two(pipeline: Pipeline) -> None:
    frames = human("single_leg_balance")
    begin = next(i for i, f in enumerate(frames) if f.position[leg("right"), 2].min() > 0.15)
    frames = [HumanFrame(f.time_s - frames[begin].time_s, f.position, f.valid) for f in frames[begin:]]
    done = played(pipeline, frames)
    check_stands(pipeline, done)
    assert done.contact[0].all()
    assert (done.contact[45:60].sum(axis=1) == 1).all()


def test_sitting_down_stays_within_the_feet(pipeline: Pipeline) -> None:
    frames = standing(5.0)
    for frame, share in zip(frames, ramp(len(frames), 1.0, 2.5), strict=True):
        angle = share * np.pi / 2
        frame.position[UPPER] += 0.43 * np.array([-np.sin(angle), 0.0, np.cos(angle) - 1.0])
    done = played(pipeline, frames)
    check_stands(pipeline, done)


def test_lying_down_leaves_the_robot_on_its_feet(pipeline: Pipeline) -> None:
    frames = standing(5.0)
    for frame, share in zip(frames, ramp(len(frames), 1.0, 2.5), strict=True):
        c, s = np.cos(share * np.pi / 2), np.sin(share * np.pi / 2)
        x, z = frame.position[:, 0].copy(), frame.position[:, 2].copy()
        frame.position[:, 0], frame.position[:, 2] = c * x - s * z, s * x + c * z + 0.12 * share
    done = played(pipeline, frames)
    check_stands(pipeline, done)


# ---------------------------------------------------------------------- recordings

CAPTURES = (
    "cmu_bvh/49_18.bvh",
    "cmu_bvh/07_04.bvh",
    "kinect_v2_irds/216_18_7_3_1_stand.csv",
    "kinect_v1_precog/Seq1_8.csv",
)


@pytest.mark.parametrize("name", CAPTURES)
def test_every_frame_of_a_recording_is_stable(shared: Path, name: str) -> None:
    registry = Registry(entry_points=False)
    built = Pipeline(
        load_pipeline("koenemann_2014", registry, input=shared / "mocap" / name, sets=["settle_s=0.5"]),
        registry,
    )
    try:
        check_stands(built, played(built, built._human_frames(built.source.frames())))
        assert built.guard.report.scaled == 0
    finally:
        built.close()


# ---------------------------------------------------------------------- properties

STEPS = st.lists(
    st.tuples(
        st.sampled_from(["both", "left", "right", "none"]),
        st.integers(3, 30),
        st.floats(-0.15, 0.35),
        st.floats(0.05, 0.4),
        st.floats(-0.12, 0.12),
    ),
    min_size=2,
    max_size=5,
)


@given(steps=STEPS)
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_foot_never_lifts_before_the_com_is_over_the_other(
    pipeline: Pipeline, steps: Sequence[tuple[str, int, float, float, float]]
) -> None:
    template = standing(0.1)[0]
    frames: list[HumanFrame] = []
    for support, count, forward, up, aside in steps:
        position = template.position.copy()
        position[UPPER, 1] += aside
        for side in ("left", "right"):
            if support not in (side, "both"):
                position[[*leg(side), ROLE_INDEX[f"{side}_knee"]]] += (forward, 0.0, up)
        for _ in range(count):
            frame = HumanFrame(len(frames) / RATE_HZ, position.copy(), template.valid.copy())
            frame.support = Support(support in ("left", "both"), support in ("right", "both"))
            frames.append(frame)
    check_stands(pipeline, played(pipeline, frames))


@given(
    point=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    margin_m=st.floats(0.0, 0.04),
    size=st.tuples(st.floats(0.1, 0.5), st.floats(0.1, 0.5)),
)
def test_a_point_is_moved_inside_by_the_margin_and_no_further(
    point: tuple[float, float], margin_m: float, size: tuple[float, float]
) -> None:
    hull = convex_hull([(x * size[0], y * size[1]) for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
    moved = moved_inside(point, hull, margin_m)
    if margin(point, hull) >= margin_m:
        assert moved == point
    else:
        assert margin(moved, hull) == pytest.approx(margin_m, abs=1e-9)


# ---------------------------------------------------------------------- the post-processor alone


def test_a_pose_that_stands_is_left_to_the_last_bit(pipeline: Pipeline) -> None:
    stage: Any = next(c for _, c in pipeline.stages if c.name == "static_balance")
    pipeline.reset()
    for frame in standing(1.0):
        pipeline.step(frame)
    state, stack = pipeline.state, pipeline.stack
    before = state.q.copy()
    stage.step(stack, state)
    np.testing.assert_array_equal(state.q, before)


def test_a_pose_that_falls_is_corrected_on_its_feet(pipeline: Pipeline) -> None:
    stage: Any = next(c for _, c in pipeline.stages if c.name == "static_balance")
    pipeline.reset()
    for frame in standing(1.0):
        pipeline.step(frame)
    state, stack, robot = pipeline.state, pipeline.stack, pipeline.robot
    feet = [robot.pose(f"{side}_foot") for side in ("left", "right")]
    for side in "LR":  # lean forwards over the toes
        state.q[7 + robot.joint_index(f"{side}AnklePitch")] -= 0.4
    robot.update(state.q)
    robot.place(state.q, stack.anchor, stack.anchor_pose)
    hull = footprint(list(robot.sole_corners()))
    assert margin((float(robot.com[0]), float(robot.com[1])), hull) < LEAST_M
    changed = stage.changed
    stage.step(stack, state)
    assert stage.changed == changed + 1
    stance = Stance.of(robot)
    assert all(stance.down)
    for foot, side in zip(feet, ("left", "right"), strict=True):
        np.testing.assert_allclose(robot.position(f"{side}_foot")[:2], foot[:2, 3], atol=2e-3)
    hull = footprint(list(robot.sole_corners()))
    assert margin((float(robot.com[0]), float(robot.com[1])), hull) >= LEAST_M
