"""The steps of a change of support, the reference that follows its goal, and where a foot can land."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.balance.follower import Follower
from imitor.balance.landing import LandingRegion, _Explorer, landing_region
from imitor.balance.offset import heading_of, tilt_left, upright, yaw
from imitor.balance.transition import IN_THE_AIR, TABLE_I, Step, TransitionMachine
from imitor.robot.model import RobotModel
from imitor.types import Support

SUPPORTS = (Support(True, True), Support(True, False), Support(False, True), Support(False, False), None)


@given(
    st.lists(st.tuples(st.sampled_from(SUPPORTS), st.booleans(), st.booleans(), st.booleans()), max_size=80)
)
def test_a_foot_lifts_only_after_the_com_has_arrived_over_the_other(
    frames: list[tuple[Support | None, bool, bool, bool]],
) -> None:
    machine = TransitionMachine()
    for support, com_there, foot_up, foot_down in frames:
        before, stance = machine.step, machine.stance
        machine.advance(support, com_there=com_there, foot_up=foot_up, foot_down=foot_down)
        if before not in IN_THE_AIR and machine.step in IN_THE_AIR:
            assert before is Step.SHIFT and com_there and machine.stance == stance
            assert support is None or support.none or support.left == (stance == 0)
        if before in IN_THE_AIR:  # on one leg the leg stays; it ends on the ground
            assert machine.stance == stance
            assert machine.step in IN_THE_AIR or (before is Step.LOWER and foot_down)
        assert machine.entered == (machine.step is not before)
        assert machine.free == (1 - machine.stance if machine.step in IN_THE_AIR else None)
        assert machine.anchor == (machine.stance if machine.step in IN_THE_AIR else 1)


@given(st.sampled_from([0, 1]))
def test_a_step_goes_through_table_one_and_back(side: int) -> None:
    machine = TransitionMachine()
    alone = Support(side == 0, side == 1)
    seen = []
    for support in [alone] * 4 + [Support(True, True)] * 4:
        machine.advance(support, com_there=True, foot_up=True, foot_down=True)
        seen.append(machine.step)
    assert seen == [
        Step.SHIFT, Step.LIFT, Step.SINGLE, Step.SINGLE, Step.LOWER, Step.CENTRE, Step.DOUBLE, Step.DOUBLE,
    ]  # fmt: skip
    assert {step for step in Step if TABLE_I[step].ends} == {Step.DOUBLE, Step.SINGLE}


@given(
    st.lists(st.floats(-1, 1), min_size=2, max_size=2),
    st.floats(0.05, 1.0),
    st.floats(0.1, 5.0),
    st.floats(0.005, 0.05),
)
def test_a_reference_keeps_its_limits_and_comes_to_rest(
    goal: list[float], speed: float, acceleration: float, dt: float
) -> None:
    follower = Follower(speed, acceleration, dt)
    follower.reset(np.zeros(2))
    target, before = np.array(goal), np.zeros(2)
    longest = np.linalg.norm(target) / speed + 4 * np.sqrt(np.linalg.norm(target) / acceleration) + 10 * dt
    last = 0.0
    for _ in range(int(longest / dt) + 5):
        at = follower.step(target).copy()
        velocity = follower.velocity.copy()
        assert np.linalg.norm(velocity) <= speed + 1e-9
        assert np.linalg.norm(velocity - before) <= acceleration * dt + 1e-9
        along = float(at @ target) / max(float(np.linalg.norm(target)), 1e-12)
        over = acceleration * dt * dt + 1e-9  # one frame's change of speed
        assert last - over <= along <= np.linalg.norm(target) + over
        before, last = velocity, along
    assert follower.rests_at(target, 1e-6 + acceleration * dt * dt)


@given(st.floats(-3, 3), st.floats(-1.4, 1.4), st.floats(-3, 3), st.floats(0, 2))
def test_a_tilt_is_taken_off_without_a_turn(heading: float, tilt: float, towards: float, turn: float) -> None:
    axis = np.array([np.cos(towards), np.sin(towards), 0.0])
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    R = (np.eye(3) + np.sin(tilt) * K + (1 - np.cos(tilt)) * K @ K) @ yaw(heading)
    assert np.cos(heading_of(R) - heading) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(tilt_left(R, 0.0) @ yaw(heading_of(R)), R, atol=1e-7)
    left = tilt_left(R, turn)
    assert np.arccos(np.clip(left[2, 2], -1, 1)) == pytest.approx(max(abs(tilt) - turn, 0.0), abs=1e-6)
    np.testing.assert_allclose(upright(R[:, 2]) @ R, yaw(heading_of(R)), atol=1e-7)


@pytest.fixture(scope="module")
def nao() -> RobotModel:
    return RobotModel.load("nao_v4")


@pytest.fixture(scope="module")
def region(nao: RobotModel) -> LandingRegion:
    return landing_region(nao, free_yaw=True)


def test_nao_can_step_as_far_as_in_the_paper(region: LandingRegion) -> None:
    for side, sign in ((0, 1.0), (1, -1.0)):
        assert region.contains(np.array([0.0, sign * 0.1]), side)  # where it stands
        assert region.contains(np.array([0.137, sign * 0.11]), side)  # figure 8: 137 mm ahead
        assert not region.contains(np.array([0.0, sign * 0.04]), side)  # one sole on the other
        assert not region.contains(np.array([0.0, -sign * 0.1]), side)  # legs crossed
        assert not region.contains(np.array([0.3, sign * 0.1]), side)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.sampled_from([0, 1]))
def test_the_nearest_place_lies_in_the_region(region: LandingRegion, x: float, y: float, side: int) -> None:
    point = np.array([x, y])
    found = region.nearest(point, side)
    if region.contains(point, side):
        np.testing.assert_array_equal(found, point)
    else:
        middle = np.array([0.0, 0.1 if side == 0 else -0.1])
        assert region.contains(found + 1e-3 * (middle - found), side)
        assert np.linalg.norm(found - point) <= np.linalg.norm(middle - point)


@settings(max_examples=12, deadline=None)
@given(share=st.floats(0.05, 0.95), angle=st.floats(0, 2 * np.pi))
def test_places_between_the_rays_can_be_reached_too(
    nao: RobotModel, region: LandingRegion, share: float, angle: float
) -> None:
    explorer = _Explorer(nao.twin(), True)
    out = np.array([np.cos(angle), np.sin(angle)])
    reach = max(r for r in np.linspace(0.0, 0.3, 61) if region.contains(explorer._centre + r * out, 0))
    q = explorer._start.copy()
    for s in np.linspace(0.2, 1.0, 5):
        found = explorer._reached(q, explorer._centre + s * share * reach * out)
        assert found is not None
        q = found
