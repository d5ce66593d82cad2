"""The preset montecillo_2010 on HRP-2: errors of table 1, priorities, and the CoM ahead of a foot's lift."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.balance.stance import footprint
from imitor.metrics.polygon import margin
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import SIDES

ORDER = (
    "[[left_foot, right_foot, left_ankle, right_ankle], [com], [head], [left_sole, right_sole], [left_wrist], "
    "[right_wrist], [chest_vector], [waist_vector], [head_vector]]"
)


def preset(*sets: str) -> Pipeline:
    registry = Registry(entry_points=False)
    return Pipeline(load_pipeline("montecillo_2010", registry, sets=list(sets)), registry)


def stage(pipeline: Pipeline, name: str) -> Any:
    return next(c for _, c in pipeline.stages if c.name == name)


def deviations(*sets: str) -> dict[str, np.ndarray]:
    """Return the errors of the positions, frame by frame, after settling."""
    pipeline = preset(*sets)
    robot, rows = pipeline.robot, []
    for record in pipeline.records():
        if record.time_s < 2.0:
            continue
        stack = record.stack
        row = [np.linalg.norm((robot.com - stack["com"].target)[:2])]
        row.append(np.linalg.norm(robot.position("head") - stack["head"].target))
        for side in SIDES:
            row.append(np.linalg.norm(robot.position(f"{side}_wrist") - stack[f"{side}_wrist"].target[:3, 3]))
        rows.append(row)
    return dict(zip(("com", "head", "left_wrist", "right_wrist"), np.array(rows).T, strict=True))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("scenario", ["slow_dance", "weight_shift_foot_lift"])
def test_positions_are_as_near_as_in_table_1(scenario: str) -> None:
    errors = deviations(f"source.scenario={scenario}")
    assert rms(errors["com"]) < 1e-3
    assert np.median(errors["head"]) < 1e-3
    assert rms(errors["head"]) < 5e-3
    assert rms(errors["left_wrist"]) < 0.02
    assert rms(errors["right_wrist"]) < 0.05


def test_lower_tasks_leave_the_higher_ones_alone() -> None:
    with_all = deviations("source.scenario=slow_dance", f"solve.order={ORDER}")
    alone = deviations("source.scenario=slow_dance", f"solve.order={ORDER[: ORDER.index(', [left_sole')]}]")
    assert rms(with_all["com"]) < rms(alone["com"]) + 3e-4
    assert rms(with_all["head"]) < rms(alone["head"]) + 1e-3
    assert rms(alone["left_wrist"]) > 0.05  # they were something to add


@settings(max_examples=10, deadline=None)
@given(
    speed=st.floats(0.5, 4.0),
    side=st.sampled_from(["left", "right"]),
    scenario=st.sampled_from(["weight_shift_foot_lift", "walk_in_place", "step_forward"]),
    seed=st.integers(0, 3),
)
def test_the_com_is_over_the_support_foot_before_the_other_lifts(
    speed: float, side: str, scenario: str, seed: int
) -> None:
    pipeline = preset(
        f"source.scenario={scenario}", f"source.speed={speed}", f"source.side={side}",
        "source.noise_std_m=0.002", f"source.seed={seed}",
    )  # fmt: skip
    robot, gate = pipeline.robot, stage(pipeline, "com_anticipation")
    before, target = np.ones(2, dtype=bool), None
    inside = [1.0, 1.0]
    most = gate.config.com_speed_m_s / pipeline.rate_hz + 1e-9
    for record in pipeline.records():
        contact = record.state.contact
        for i in range(2):
            if before[i] and not contact[i]:
                assert inside[1 - i] >= gate.config.margin_m - 1e-9
        assert contact.any()
        com = record.stack["com"].target[:2].copy()
        assert target is None or np.linalg.norm(com - target) <= most  # no step when the support changes
        target, before = com, contact.copy()
        floor = (float(robot.com[0]), float(robot.com[1]))
        inside = [margin(floor, footprint([sole])) for sole in robot.sole_corners()]
        standing = footprint([s for s, on in zip(robot.sole_corners(), contact, strict=True) if on])
        assert record.time_s < 0.5 or margin(floor, standing) > 0.0


def test_the_law_does_not_depend_on_the_rate() -> None:
    paths = {}
    for rate in (50, 100, 200):
        pipeline = preset(
            "source.scenario=slow_dance", f"rate_hz={rate}", f"source.rate_hz={rate}", "settle_s=0"
        )
        gate = stage(pipeline, "com_anticipation")
        paths[rate] = np.array([gate.goal.copy() for _ in pipeline.records()])[:: rate // 50]
    n = min(len(p) for p in paths.values())
    assert np.ptp(paths[100][:, 1]) > 0.02
    for rate in (50, 200):
        assert np.abs(paths[rate][:n] - paths[100][:n]).max() < 4e-3


@pytest.mark.parametrize(("speed", "least_s"), [(1.0, 0.8), (2.0, 0.4), (3.0, 0.2)])
def test_the_com_goes_ahead_of_the_lift(speed: float, least_s: float) -> None:
    """The robot's CoM is over the foot that stays this long before the other lifts, and stays there until it does."""
    pipeline = preset("source.scenario=weight_shift_foot_lift", f"source.speed={speed}")
    rows = []
    for record in pipeline.records():
        robot = pipeline.robot
        soles = robot.sole_corners()
        floor = (float(robot.com[0]), float(robot.com[1]))
        rows.append((record.time_s, *record.state.contact, *(margin(floor, footprint([s])) for s in soles)))
    table = np.array(rows)
    lift = int(np.flatnonzero(~(table[:, 1] * table[:, 2]).astype(bool))[0])
    stance = 0 if table[lift, 1] else 1
    over = table[:, 3 + stance] > 0.025
    first = int(np.flatnonzero(over[:lift])[0])
    assert table[lift, 0] - table[first, 0] > least_s
    assert over[first:lift].all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nao_v4", "romeo", "talos", "unitree_g1"])
def test_every_robot_lifts_its_foot_in_balance(name: str) -> None:
    registry = Registry(entry_points=False)
    sets = ["source.scenario=weight_shift_foot_lift"]
    pipeline = Pipeline(load_pipeline("montecillo_2010", registry, robot=name, sets=sets), registry)
    robot, gate = pipeline.robot, stage(pipeline, "com_anticipation")
    contacts, before, inside = [], np.ones(2, dtype=bool), [1.0, 1.0]
    for record in pipeline.records():
        contact = np.asarray(record.state.contact).copy()
        for i in range(2):
            if before[i] and not contact[i]:
                assert inside[1 - i] >= gate.config.margin_m - 1e-9
        soles, floor = robot.sole_corners(), (float(robot.com[0]), float(robot.com[1]))
        standing = [s for s, on in zip(soles, contact, strict=True) if on]
        assert record.time_s < 0.5 or margin(floor, footprint(standing)) > 0.02
        assert max(abs(float(s[:, 2].min())) for s in standing) < 0.01
        inside, before = [margin(floor, footprint([s])) for s in soles], contact
        contacts.append(bool(contact.all()))
    assert 200 < contacts.count(False) < 900  # it stood on one foot
    assert all(contacts[-100:])  # and has set the other down again
