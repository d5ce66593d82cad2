"""The preset penna_poubel_2014 on NAO: what the paper promises, frame by frame, and what happens with bad input."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.balance.transition import Step
from imitor.metrics.polygon import convex_hull, margin
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import ROLE_INDEX, SIDES, HumanFrame, Support

TOUCH_M = 0.003


def preset(**sets: Any) -> Pipeline:
    registry = Registry(entry_points=False)
    spec = load_pipeline("penna_poubel_2014", registry, sets=[f"{k}={v}" for k, v in sets.items()])
    return Pipeline(spec, registry)


def stabilizer(pipeline: Pipeline) -> Any:
    return next(c for _, c in pipeline.stages if c.name == "support_transition")


def com_margin(pipeline: Pipeline, touch: float = TOUCH_M) -> float:
    """Return the margin of the CoM in the hull of the sole corners that touch the floor [m]."""
    robot = pipeline.robot
    corners = robot.sole_corners().reshape(-1, 3)
    touching = [tuple(c[:2]) for c in corners if c[2] <= touch]
    return float(margin(tuple(robot.com[:2]), convex_hull(touching)))


def stance_margin(pipeline: Pipeline, foot: int) -> float:
    robot = pipeline.robot
    return float(
        margin(tuple(robot.com[:2]), convex_hull([tuple(c[:2]) for c in robot.sole_corners()[foot]]))
    )


@pytest.fixture(scope="module")
def steps() -> list[dict[str, Any]]:
    """The step forward, frame by frame."""
    pipeline = preset(**{"source.scenario": "step_forward"})
    machine, out = stabilizer(pipeline).footsteps.machine, []
    for record in pipeline.records():
        out.append(
            {
                "time": record.time_s,
                "step": machine.step,
                "contact": record.state.contact.copy(),
                "feet": [pipeline.robot.position(f"{s}_foot").copy() for s in SIDES],
                "corners": pipeline.robot.sole_corners(),
                "margin": com_margin(pipeline),
                "landing": stabilizer(pipeline).footsteps.landing.copy(),
                "anchor": record.stack.anchor,
                "hands": bool(record.stack["left_hand"].active[0]),
            }
        )
    return out


def test_a_step_forward_goes_through_every_step_in_order(steps: list[dict[str, Any]]) -> None:
    order = [f["step"] for i, f in enumerate(steps) if i == 0 or steps[i - 1]["step"] is not f["step"]]
    assert order == [
        Step.DOUBLE, Step.SHIFT, Step.LIFT, Step.SINGLE, Step.LOWER, Step.CENTRE, Step.DOUBLE,
    ]  # fmt: skip
    for frame in steps:
        assert frame["anchor"] == "right_foot"  # P10
        assert frame["hands"] == (frame["step"] in (Step.DOUBLE, Step.SINGLE))  # table I
        up = frame["step"] in (Step.LIFT, Step.SINGLE, Step.LOWER)
        assert frame["contact"].tolist() == [not up, True]


def test_it_is_statically_stable_in_every_frame(steps: list[dict[str, Any]]) -> None:
    assert min(f["margin"] for f in steps) >= 0.005
    assert sum(not f["contact"].all() for f in steps) > 60


def test_the_foot_lands_flat_where_it_should_and_does_not_slide(steps: list[dict[str, Any]]) -> None:
    down = next(i for i, f in enumerate(steps) if f["step"] is Step.CENTRE)
    landed = steps[down]
    assert np.linalg.norm(landed["feet"][0][:2] - landed["landing"]) <= 0.005
    assert np.abs(landed["corners"][0, :, 2]).max() <= 0.002
    for after in steps[down:]:
        assert np.linalg.norm(after["feet"][0][:2] - landed["feet"][0][:2]) <= 0.01
    assert landed["feet"][0][0] - steps[0]["feet"][0][0] > 0.05
    for frame in steps:
        np.testing.assert_allclose(frame["feet"][1], steps[0]["feet"][1], atol=1e-6)  # anchored


def test_transitions_take_less_than_three_seconds(steps: list[dict[str, Any]]) -> None:
    def begin(step: Step) -> float:
        return float(next(f["time"] for f in steps if f["step"] is step))

    done = next(f["time"] for f in reversed(steps) if f["step"] is Step.CENTRE)
    assert begin(Step.SINGLE) - begin(Step.SHIFT) <= 3.0
    assert done - begin(Step.LOWER) <= 3.0


# ---------------------------------------------------------------------- any order of supports


@pytest.fixture(scope="module")
def stander() -> Iterator[tuple[Pipeline, HumanFrame]]:
    pipeline = preset(**{"source.scenario": "slow_dance", "rate_hz": 30})
    yield pipeline, next(iter(pipeline.source.frames()))
    pipeline.close()


PHASES = st.lists(
    st.tuples(
        st.sampled_from(
            [Support(True, True), Support(True, False), Support(False, True), Support(False, False)]
        ),
        st.floats(0.05, 2.5),
    ),
    min_size=1,
    max_size=6,
)


@settings(max_examples=12, deadline=None)
@given(phases=PHASES)
def test_a_foot_never_lifts_before_the_com_is_over_the_other(
    stander: tuple[Pipeline, HumanFrame], phases: list[tuple[Support, float]]
) -> None:
    pipeline, first = stander
    pipeline.reset()
    time_s = 0.0
    for support, seconds in phases:
        for _ in range(max(1, round(seconds * 30))):
            pipeline.step(dataclasses.replace(first, time_s=time_s, support=support))
            time_s += 1 / 30
            contact = pipeline.state.contact
            assert contact.any()
            if not contact.all():
                assert stance_margin(pipeline, int(contact[1])) >= 0.005
            assert com_margin(pipeline) >= 0.005


# ---------------------------------------------------------------------- recordings


@pytest.mark.shared
@pytest.mark.parametrize(
    "name",
    [
        "cmu_bvh/49_18.bvh",
        "cmu_bvh/07_04.bvh",
        "kinect_v2_irds/216_18_7_3_1_stand.csv",
        "kinect_v1_precog/Seq1_8.csv",
    ],
)
def test_recordings_are_statically_stable_in_every_frame(shared: Path, name: str) -> None:
    registry = Registry(entry_points=False)
    spec = load_pipeline("penna_poubel_2014", registry, input=shared / "mocap" / name)
    pipeline = Pipeline(spec, registry)
    for record in pipeline.records():
        assert com_margin(pipeline) >= 0.005
        assert record.state.contact.any()
    pipeline.close()


# ---------------------------------------------------------------------- bad input


def copied(frame: HumanFrame) -> HumanFrame:
    return dataclasses.replace(frame, position=frame.position.copy(), valid=frame.valid.copy())


def without(*roles: str) -> Any:
    index = [ROLE_INDEX[r] for r in roles]

    def change(i: int, frame: HumanFrame) -> HumanFrame:
        if i >= 15:
            frame.valid[index] = False
            frame.position[index] = np.nan
        return frame

    return change


def lifted(i: int, frame: HumanFrame) -> HumanFrame:
    return dataclasses.replace(frame, support=Support(False, False)) if 20 <= i < 60 else frame


def on_one_leg(i: int, frame: HumanFrame) -> HumanFrame:
    return dataclasses.replace(frame, support=Support(True, False))


def sitting(i: int, frame: HumanFrame) -> HumanFrame:
    """Hips at the height of the knees, in half a second."""
    share = min(i / 15, 1.0)
    knee = frame.position[ROLE_INDEX["left_knee"], 2]
    drop = share * (frame.position[ROLE_INDEX["pelvis"], 2] - knee)
    upper = frame.position[:, 2] > knee + 0.05
    frame.position[upper, 2] -= drop
    frame.position[upper, 0] -= share * 0.35
    assert frame.com is not None
    return dataclasses.replace(frame, com=frame.com - [0.1 * share, 0.0, 0.8 * drop])


def lying(i: int, frame: HumanFrame) -> HumanFrame:
    """Turned about the ankles to the back, in one second."""
    angle = min(i / 30, 1.0) * np.pi / 2
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    pivot = np.array([0.0, 0.0, 0.1])
    return dataclasses.replace(
        frame, position=(frame.position - pivot) @ R.T + pivot, com=(frame.com - pivot) @ R.T + pivot
    )


@pytest.mark.parametrize(
    "change",
    [
        without("left_ankle", "left_knee"),
        without("left_hip", "right_hip", "pelvis"),
        without(*(f"{s}_{r}" for s in SIDES for r in ("ankle", "knee", "hip", "wrist", "elbow", "shoulder"))),
        lifted,
        on_one_leg,
        sitting,
        lying,
    ],
    ids=["leg lost", "hips lost", "all lost", "flight", "starts on one leg", "sits down", "lies down"],
)
def test_bad_input_gives_no_unstable_command(change: Any) -> None:
    pipeline = preset(**{"source.scenario": "weight_shift_foot_lift", "rate_hz": 30})
    before = None
    frames = list(pipeline.source.frames())[:: round(pipeline.source.rate_hz / 30)]
    for i, frame in enumerate(frames[: 5 * 30]):
        pipeline.step(dataclasses.replace(change(i, copied(frame)), time_s=i / 30))
        q = pipeline.state.q
        assert np.isfinite(q).all()
        assert (q[7:] >= pipeline.robot.lower - 1e-9).all() and (q[7:] <= pipeline.robot.upper + 1e-9).all()
        if before is not None:
            assert (np.abs(q[7:] - before[7:]) <= pipeline.robot.speed / 30 + 1e-9).all()
        assert com_margin(pipeline) >= 0.005
        before = q.copy()
    pipeline.close()


def test_the_body_stands_where_the_human_does() -> None:
    """Feet and hands start in the human's place, wherever the recording has it."""
    pipeline = preset(**{"source.scenario": "slow_dance", "rate_hz": 30})
    first = next(iter(pipeline.source.frames()))
    away = np.array([1.0, 0.5, 0.0])
    moved = dataclasses.replace(first, position=first.position + away, com=first.com + away)
    feet, hands = [], []
    for frame in (first, moved):
        pipeline.reset()
        pipeline.step(frame)
        feet.append([p[:2, 3].copy() for p in stabilizer(pipeline).footsteps.place])
        hands.append(pipeline.robot.position("left_hand") - pipeline.stack["left_hand"].target)
    shift = np.diff(np.array(feet), axis=0)[0]
    np.testing.assert_allclose(shift[0], shift[1], atol=1e-6)
    assert np.linalg.norm(shift[0]) > 0.2
    assert max(np.linalg.norm(h) for h in hands) < 0.005
    pipeline.close()
