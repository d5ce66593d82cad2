"""Transition to contact: limits scaled locally, the person's hand path at the grip, no step on the way; smoothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.contact.grips import Grips
from imitor.contact.local_limits import LocalLimits
from imitor.errors import ImitorError
from imitor.pipeline import Pipeline
from imitor.plugins.stabilizers.savitzky_golay import weights
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import SIDES

LOW, HIGH = np.array([-1.0]), np.array([2.0])


@given(st.floats(-20.0, 20.0), st.floats(0.0, 1.0))
def test_scaling_keeps_order_limits_and_the_middle(x: float, more: float) -> None:
    scale = LocalLimits(LOW, HIGH, 0.1)
    a, b = scale(np.array([x]))[0], scale(np.array([x + more]))[0]
    assert LOW[0] <= a <= b <= HIGH[0]
    assert b - a <= more + 1e-12
    if -0.7 <= x <= 1.7:
        assert a == x


@given(st.integers(1, 4), st.integers(0, 100))
@settings(deadline=None)
def test_smoothing_keeps_polynomials(order: int, seed: int) -> None:
    c = np.random.default_rng(seed).normal(size=order + 1)
    t = np.arange(11.0) - 10.0
    assert weights(11, order, 10) @ np.polyval(c, t) == pytest.approx(c[-1], abs=1e-6)
    assert weights(11, order, 5) @ np.polyval(c, t + 5.0) == pytest.approx(c[-1], abs=1e-6)


def test_a_grip_is_near_anywhere_on_its_travel() -> None:
    grips = Grips([{"name": "handle", "position_m": [0.5, 0.0, 1.0]}], "handle", (0, 0.2, 0), (-0.1, 0, 0))
    assert grips.distance(np.array([0.45, 0.2, 1.0]), 0) == pytest.approx(0.0, abs=1e-12)
    assert grips.distance(np.array([0.35, -0.2, 1.0]), 1) == pytest.approx(0.05)
    with pytest.raises(ImitorError, match="no object 'handel'"):
        Grips([{"name": "handle"}], "handel", (0, 0, 0), (0, 0, 0))


def test_in_contact_the_hands_are_the_persons_and_nothing_jumps() -> None:
    spec = load_pipeline("tomic_2018", Registry(entry_points=False))
    pipeline = Pipeline(spec, Registry(entry_points=False))
    stage: Any = {c.name: c for _, c in pipeline.stages}
    person = stage["virtual_marker_fit"].imitation.model.robot
    off, share, target, joints = [], [], [], []
    for record in pipeline.records():
        share.append(stage["contact_transition"].share.copy())
        roles = [f"{side}_hand" for side in SIDES]
        off.append([np.linalg.norm(pipeline.robot.position(r) - person.position(r)) for r in roles])
        target.append([pipeline.stack[r].target[:3, 3].copy() for r in roles])
        joints.append(record.state.q[7:].copy())
    pipeline.close()
    held = (np.array(share) >= 1.0).all(axis=1)
    assert held.sum() > 400
    assert np.array(off)[held].max() < 0.002
    assert np.array(off)[~held].max() > 0.05  # elsewhere the robot has its own size
    velocity = 100.0 * np.diff(np.array(target), axis=0)
    assert np.abs(velocity).max() < 1.5
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.08
    q = np.array(joints)
    assert (q >= pipeline.robot.lower - 1e-9).all()
    assert (q <= pipeline.robot.upper + 1e-9).all()
