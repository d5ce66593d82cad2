"""Support by height: thresholds, hysteresis, speed, lost points, and the truth of the performer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor import HumanFrame, Support
from imitor.kinds import Context
from imitor.plugins.filters.support_by_height import SupportByHeight, SupportByHeightConfig
from imitor.testing import make_context, make_frames, make_skeleton
from imitor.types import N_ROLES, ROLE_INDEX

CONTEXT = make_context()
SKELETON = make_skeleton()
ANKLE, TOE = SKELETON.ankle_height_m, SKELETON.toe_height_m


def made(context: Context = CONTEXT, **options: Any) -> SupportByHeight:
    options = {"dwell_s": 0.0, "window_s": 0.0, **options}
    made = SupportByHeight(SupportByHeightConfig(**options), context)
    made.start()
    return made


def frame(
    left: float, right: float = 0.0, *, toes: float | None = None, x: float = 0.0, time_s: float = 0.0
) -> HumanFrame:
    """A human whose feet are so much higher than when they stand; ``toes`` for other heights of the left toe."""
    position = np.full((N_ROLES, 3), 1.0)
    for side, height in (("left", left), ("right", right)):
        position[ROLE_INDEX[f"{side}_ankle"]] = x, 0.0, ANKLE + height
        position[ROLE_INDEX[f"{side}_toe"]] = x, 0.0, TOE + height
    if toes is not None:
        position[ROLE_INDEX["left_toe"], 2] = TOE + toes
    return HumanFrame(time_s, position, np.ones(N_ROLES, dtype=bool))


def left_contact(component: SupportByHeight, *frames: HumanFrame) -> list[bool]:
    out = []
    for f in frames:
        support = component.step(f).support
        assert support is not None
        out.append(support.left)
    return out


@given(
    heights=st.lists(st.floats(-0.02, 0.2), min_size=1, max_size=40), threshold=st.floats(0.01, 0.1),
    hysteresis=st.floats(0.0, 0.05),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_contact_begins_below_and_ends_above(
    heights: list[float], threshold: float, hysteresis: float
) -> None:
    component = made(threshold_m=threshold, hysteresis_m=hysteresis)
    stood = False
    for height, contact in zip(heights, left_contact(component, *(frame(h) for h in heights)), strict=True):
        level = threshold + (hysteresis if stood else 0.0)
        if abs(height - level) > 1e-9:
            assert contact == (height < level)
        stood = contact


@given(heights=st.lists(st.floats(-0.02, 0.2), min_size=1, max_size=30))
@settings(max_examples=100, deadline=None)
def test_left_and_right_are_alike(heights: list[float]) -> None:
    one, other = made(), made()
    for height in heights:
        a, b = one.step(frame(height, 0.3)).support, other.step(frame(0.3, height)).support
        assert a is not None and b is not None
        assert (a.left, a.right) == (b.right, b.left)


def test_flat_wants_both_points_and_lowest_one() -> None:
    assert left_contact(made(points="flat"), frame(0.08, toes=0.0)) == [False]
    assert left_contact(made(points="lowest"), frame(0.08, toes=0.0)) == [True]


def test_a_fast_foot_does_not_come_into_contact() -> None:
    component = made(speed_m_s=0.5, speed_hysteresis=2.0)
    dt = component.dt_s
    speeds = [0.0, 0.0, 0.9, 1.1, 0.9, 0.4]  # contact, kept at twice the speed, lost, not yet back, back
    x = np.cumsum(np.array(speeds) * dt)
    frames = [frame(0.0, x=float(x[i]), time_s=i * dt) for i in range(len(speeds))]
    assert left_contact(component, *frames) == [True, True, True, False, False, True]


def test_without_a_speed_a_sliding_foot_stands() -> None:
    frames = [frame(0.0, x=float(i)) for i in range(4)]
    assert left_contact(made(), *frames) == [True] * 4


@pytest.mark.parametrize("lost", ["left_ankle", "left_toe"])
@pytest.mark.parametrize("stood", [True, False])
def test_a_lost_foot_stays_as_it_was(lost: str, stood: bool) -> None:
    component = made()
    first, unseen = frame(0.0 if stood else 0.3), frame(0.3 if stood else 0.0)
    unseen.position[ROLE_INDEX[lost]] = np.nan
    unseen.valid[ROLE_INDEX[lost]] = False
    assert left_contact(component, first, unseen) == [stood, stood]


def test_a_skeleton_without_toes_uses_the_ankles() -> None:
    roles = SKELETON.roles - {"left_toe", "right_toe"}
    context = replace(CONTEXT, skeleton=replace(SKELETON, roles=roles))
    bare = frame(0.0, 0.3)
    bare.position[[ROLE_INDEX["left_toe"], ROLE_INDEX["right_toe"]]] = np.nan
    support = made(context).step(bare).support
    assert support == Support(True, False)


def test_a_skeleton_with_one_toe_only_is_used_as_far_as_it_goes() -> None:
    context = replace(CONTEXT, skeleton=replace(SKELETON, roles=SKELETON.roles - {"right_toe"}))
    bare = frame(0.0, 0.0)
    bare.position[ROLE_INDEX["right_toe"]] = np.nan
    assert made(context).step(bare).support == Support(True, True)


def test_the_support_of_the_source_is_kept_unless_told_otherwise() -> None:
    known = frame(0.3, 0.3)
    known.support = Support(True, False)
    assert made().step(replace(known)).support == Support(True, False)
    assert made(keep=False).step(replace(known)).support == Support(False, False)


def test_reset_forgets_the_contact() -> None:
    component = made(threshold_m=0.04, hysteresis_m=0.02)
    assert left_contact(component, frame(0.0), frame(0.05)) == [True, True]
    component.reset()
    assert left_contact(component, frame(0.05)) == [False]


@pytest.mark.parametrize("scenario", ["stand", "squat", "step_forward", "weight_shift_foot_lift", "walk"])
def test_it_finds_the_performers_support(scenario: str) -> None:
    component = made(speed_m_s=0.4)
    wrong = total = 0
    for f in make_frames(scenario, rate_hz=60.0):
        truth, f.support = f.support, None
        found = component.step(f).support
        assert truth is not None and found is not None
        wrong += (found.left != truth.left) + (found.right != truth.right)
        total += 2
    assert wrong <= 0.12 * total


def test_who_was_never_seen_stands() -> None:
    unseen = frame(0.3, 0.3)
    unseen.position[:] = np.nan
    unseen.valid[:] = False
    assert made().step(unseen).support == Support(True, True)


@given(heights=st.lists(st.floats(-0.02, 0.2), min_size=2, max_size=60))
@settings(max_examples=100, deadline=None)
def test_a_contact_dwells(heights: list[float]) -> None:
    component = made(dwell_s=0.05)
    contact = left_contact(component, *(frame(h) for h in heights))
    switches = np.flatnonzero(np.diff(np.array(contact, dtype=int)))
    assert (np.diff(switches) * component.dt_s >= 0.05 - 1e-9).all()


def test_noise_is_not_speed() -> None:
    """A standing foot with 3 mm of white noise at 120 Hz seems to move at 0.9 m/s from frame to frame."""
    component = SupportByHeight(SupportByHeightConfig(speed_m_s=0.4), replace(CONTEXT, dt_s=1 / 120))
    component.start()
    rng = np.random.default_rng(0)
    contact = left_contact(component, *(frame(0.0, x=float(x)) for x in 0.003 * rng.normal(size=600)))
    assert all(contact[1:])
