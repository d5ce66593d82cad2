"""The CoM's offset: single support only once it has arrived, bounded speed, never stuck [koenemann2014] figure 4."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.balance.offset import foot_normal, offset_of, shift_for, upright, yaw, yaw_of
from imitor.balance.support import Mode, OffsetLimits, SupportMachine, mode_of
from imitor.errors import SpecError
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import Support

MODES = st.sampled_from([Mode.DOUBLE, Mode.LEFT, Mode.RIGHT, None])
SEQUENCES = st.lists(st.tuples(MODES, st.integers(1, 60), st.floats(-0.5, 1.5)), min_size=1, max_size=12)
LIMITS = st.builds(
    OffsetLimits,
    speed=st.floats(0.1, 8.0),
    floor=st.floats(0.02, 1.0),
    tolerance=st.floats(0.0, 0.05),
    landing_s=st.floats(0.0, 0.6),
)
RATES = st.sampled_from([1 / 30, 1 / 60, 1 / 120])
POINTS = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array)


@given(limits=LIMITS, dt=RATES, human=SEQUENCES)
@settings(max_examples=150, deadline=None)
def test_a_foot_lifts_only_once_the_offset_has_arrived(
    limits: OffsetLimits, dt: float, human: list[tuple[Mode | None, int, float]]
) -> None:
    machine = SupportMachine(limits, dt)
    for mode, frames, offset in human:
        for _ in range(frames):
            before, stood = machine.offset, machine.mode
            machine.step(mode, offset)
            assert 0.0 <= machine.offset <= 1.0
            moved = abs(machine.offset - before)
            snapped = limits.tolerance if machine.mode is not stood else 0.0
            fastest = max(limits.floor, limits.speed)
            assert moved <= fastest * dt + snapped + 1e-12
            if machine.mode is Mode.LEFT:
                assert machine.offset == 0.0
                assert before <= limits.tolerance
            if machine.mode is Mode.RIGHT:
                assert machine.offset == 1.0
                assert before >= 1.0 - limits.tolerance
            if {stood, machine.mode} == {Mode.LEFT, Mode.RIGHT}:
                pytest.fail("it went from one foot to the other without double support")


@given(limits=LIMITS, dt=RATES, start=SEQUENCES, end=st.sampled_from([Mode.LEFT, Mode.RIGHT]))
@settings(max_examples=80, deadline=None)
def test_it_is_never_stuck(
    limits: OffsetLimits, dt: float, start: list[tuple[Mode | None, int, float]], end: Mode
) -> None:
    machine = SupportMachine(limits, dt)
    for mode, frames, offset in start:
        for _ in range(frames):
            machine.step(mode, offset)
    enough = int(np.ceil((1.0 / limits.floor + 2.0 * limits.landing_s) / dt)) + 5
    for _ in range(enough):
        machine.step(end, 0.5)
    assert machine.mode is end
    for _ in range(enough):
        machine.step(Mode.DOUBLE, 0.5)
    assert machine.mode is Mode.DOUBLE
    assert machine.offset == pytest.approx(0.5, abs=1e-9)


@given(limits=LIMITS, o=st.floats(0, 1))
def test_the_speed_is_a_parabola_over_a_floor(limits: OffsetLimits, o: float) -> None:
    assert limits.at(o) == pytest.approx(max(limits.floor, 4 * limits.speed * o * (1 - o)))
    assert limits.at(o) == pytest.approx(limits.at(1 - o))
    assert limits.at(0.5) >= limits.at(o) >= limits.floor > 0


def test_the_offset_waits_for_the_landing() -> None:
    machine = SupportMachine(OffsetLimits(2.0, 0.25, 0.01, 0.4), 0.1)
    for _ in range(100):
        machine.step(Mode.LEFT, 0.0)
    waited = 0
    machine.step(Mode.DOUBLE, 0.5)
    while machine.offset == 0.0:
        machine.step(Mode.DOUBLE, 0.5)
        waited += 1
    assert waited >= 4


@given(limits=LIMITS, dt=RATES, steps=st.lists(st.tuples(MODES, *[st.booleans()] * 3), max_size=200))
@settings(max_examples=80, deadline=None)
def test_a_foot_lifts_only_under_the_measured_com_and_the_com_leaves_only_a_foot_that_is_down(
    limits: OffsetLimits, dt: float, steps: list[tuple[Mode | None, bool, bool, bool]]
) -> None:
    machine = SupportMachine(limits, dt)
    landing = False
    for human, left, right, down in steps:
        stood, before = machine.mode, machine.offset
        machine.step(human, 0.5, over=(left, right).__getitem__, down=partial(bool, down))
        if stood is Mode.DOUBLE and machine.mode is not Mode.DOUBLE:
            assert left if machine.mode is Mode.LEFT else right
            assert not landing
        landing = (landing or stood is not Mode.DOUBLE) and machine.mode is Mode.DOUBLE and not down
        if landing:
            assert machine.offset == before


def test_flight_changes_nothing() -> None:
    machine = SupportMachine(OffsetLimits(2.0, 0.25, 0.01, 0.4), 0.1)
    machine.step(mode_of(Support(False, False)), 0.0)
    assert (machine.offset, machine.mode) == (0.5, Mode.DOUBLE)


@given(a=POINTS, b=POINTS, o=st.floats(-2, 2), height=st.floats(0.1, 2))
def test_offset_inverts_the_point_on_the_line(a: np.ndarray, b: np.ndarray, o: float, height: float) -> None:
    if np.linalg.norm(b - a) < 0.05:
        return
    aside = np.cross(b - a, [0.3, 0.5, 0.7])
    assert offset_of(a + o * (b - a) + height * aside, a, b) == pytest.approx(o, abs=1e-6)


@given(o=st.floats(0, 1), x=st.floats(-0.05, 0.05), y=st.floats(-0.08, 0.08), z=st.floats(0.2, 0.4))
def test_the_shifted_foot_meets_the_offset(o: float, x: float, y: float, z: float) -> None:
    left, right, com = np.array([0.02, 0.06, 0.0]), np.array([-0.02, -0.05, 0.01]), np.array([x, y, z])
    share = shift_for(com, left, right, o)
    if share == 0.0:
        return
    moved = left + share * (com - left)
    assert offset_of(com, moved, right) == pytest.approx(o, abs=1e-6)
    normal = foot_normal(com, moved, right, o)
    assert abs(normal @ (right - moved)) < 1e-6  # soles in one plane
    shift = 1e-6  # by finite differences: the residual crosses 0 at the share found
    residual = [offset_of(com, left + s * (com - left), right) - o for s in (share - shift, share + shift)]
    assert residual[0] * residual[1] <= 1e-18


@given(n=POINTS)
def test_upright_takes_the_normal_to_the_vertical(n: np.ndarray) -> None:
    length = np.linalg.norm(n)
    if length < 0.1:
        return
    R = upright(n / length)
    np.testing.assert_allclose(R @ (n / length), [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-6)


@given(angle=st.floats(-3.1, 3.1))
def test_yaw_and_back(angle: float) -> None:
    assert yaw_of(yaw(angle)) == pytest.approx(angle)


@pytest.mark.parametrize("scenario", ["single_leg_balance", "two_steps_and_reach"])
def test_support_really_changes(scenario: str) -> None:
    spec = load_pipeline("koenemann_2014", Registry(entry_points=False), sets=[f"source.scenario={scenario}"])
    pipeline = Pipeline(spec, Registry(entry_points=False))
    stage: Any = next(c for _, c in pipeline.stages if c.name == "com_offset")
    human, robot, offsets = 0, 0, []
    for record in pipeline.records():
        support = record.human.support
        assert support is not None
        human += support.left != support.right
        robot += int(record.state.contact.sum() == 1)
        offsets.append((stage.human_offset, stage.machine.offset))
    assert human > 30
    assert robot >= 0.9 * human
    assert min(o for _, o in offsets) == 0.0
    pipeline.close()


def test_the_target_is_at_the_offset_whatever_the_heights_of_the_feet() -> None:
    """A posture has one foot higher while the human lifts it, before the robot does."""
    spec = load_pipeline("koenemann_2014", Registry(entry_points=False))
    pipeline = Pipeline(spec, Registry(entry_points=False))
    stage: Any = next(c for _, c in pipeline.stages if c.name == "com_offset")
    frame = next(pipeline.records(1)).human
    q = pipeline.robot.standing.copy()
    q[7 + pipeline.robot.joint_index("RKneePitch")] += 0.8
    pipeline.state.q[:] = q
    pipeline.robot.update(q)
    left, right = (pipeline.robot.position(f"{side}_foot").copy() for side in ("left", "right"))
    assert right[2] - left[2] > 0.03
    stage.step(frame, pipeline.stack, pipeline.state)
    offset = offset_of(pipeline.stack["com"].target, left, right)
    assert offset == pytest.approx(stage.machine.offset, abs=1e-9)
    pipeline.close()


def test_it_needs_a_configuration() -> None:
    text = """
imitor: 1
robot: nao_v4
source: {use: performer, scenario: wave}
stages:
  - filter: support_by_height
  - filter: human_com
  - mapper: tpose_offset
  - stabilizer: com_offset
  - solver: damped_least_squares
sinks: []
"""
    from imitor.spec.load import load_text

    with pytest.raises(SpecError, match="needs a configuration, but no solver stands before it"):
        load_text(text, Registry(entry_points=False))
