"""Transition to contact: limits scaled locally, the person's hand path at the grip, no step on the way; smoothing."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.contact.grips import Grips
from imitor.contact.local_limits import LocalLimits
from imitor.contact.placement import REACHED, Workspace
from imitor.errors import ImitorError, RunError, SpecError
from imitor.pipeline import Pipeline
from imitor.plugins.stabilizers.savitzky_golay import weights
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import ROLE_INDEX, SIDES

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


def in_contact(*sets: str, frames: int | None = None) -> tuple[Pipeline, dict[str, np.ndarray]]:
    """Run the preset; return, frame by frame, what hands of robot and person do, (T, 2, ...), and the joints."""
    registry = Registry(entry_points=False)
    pipeline = Pipeline(load_pipeline("tomic_2018", registry, sets=list(sets)), registry)
    stage: Any = {c.name: c for _, c in pipeline.stages}
    person = stage["virtual_marker_fit"].imitation.model.robot
    names = ("off", "turn", "share", "target", "held", "joints", "contact")
    rows: dict[str, list[Any]] = {name: [] for name in names}
    roles = [f"{side}_hand" for side in SIDES]
    robot = pipeline.robot
    for record in pipeline.records(frames):
        rows["share"].append(stage["contact_transition"].share.copy())
        rows["off"].append([np.linalg.norm(robot.position(r) - person.position(r)) for r in roles])
        rows["turn"].append(
            [np.linalg.norm(pin.log3(person.rotation(r).T @ robot.rotation(r))) for r in roles]
        )
        rows["target"].append([pipeline.stack[r].target[:3, 3].copy() for r in roles])
        rows["held"].append(pipeline.stack.held >= 0)
        rows["joints"].append(record.state.q[7:].copy())
        rows["contact"].append(record.state.contact.copy())
    pipeline.close()
    return pipeline, {name: np.array(values) for name, values in rows.items()}


def test_without_a_scene_there_is_no_contact() -> None:
    _, rows = in_contact("environment=[]", frames=400)
    assert not rows["share"].any() and not rows["held"].any()


def test_a_real_recording_is_not_in_the_performers_place(shared: Path) -> None:
    """A seated person who raises the arms: slowly enough for ROMEO's joints the hands are where they shall be."""
    file = shared / "mocap" / "art_targets_keraal" / "G3-Vicon-CTK-P1T1-Unknown-C-0.txt"
    registry = Registry(entry_points=False)
    spec = load_pipeline("tomic_2018", registry, input=file, sets=["speed=0.25"])
    assert spec.environment == []
    assert [m.partition(",")[0] for m in spec.dropped] == ["environment: without drawer"]
    pipeline = Pipeline(spec, registry)
    robot = pipeline.robot
    off, turned, held, lowest = [], [], 0, np.inf
    for record in pipeline.records():
        held += record.state.status != 0
        lowest = min(lowest, robot.sole_corners()[..., 2].min())
        for s in SIDES:
            hand = robot.position(f"{s}_hand")
            off.append(np.linalg.norm(pipeline.stack[f"{s}_hand"].target[:3, 3] - hand))
            for near, far in (("shoulder", "elbow"), ("elbow", "wrist")):
                a, b = (record.human.position[ROLE_INDEX[f"{s}_{joint}"]] for joint in (near, far))
                turned.append(_angle(b - a, robot.position(f"{s}_{far}") - robot.position(f"{s}_{near}")))
    pipeline.close()
    assert held == 0 and abs(lowest) < 0.001  # it stands on the floor, though held by the pelvis
    assert np.sqrt(np.mean(np.square(off))) < 0.01
    aside = np.array(turned).reshape(-1, 2, 2)[600:840]  # the arms are held aside, further than ROMEO's reach
    assert aside[..., 0].max() < 55.0 and aside[..., 1].max() < 10.0


def test_a_recording_may_be_made_in_the_performers_place(shared: Path) -> None:
    file = shared / "mocap" / "art_targets_keraal" / "G3-Vicon-CTK-P1T1-Unknown-C-0.txt"
    registry = Registry(entry_points=False)
    sets = [f"environment.{name}.only_with=null" for name in ("drawer", "table", "table_leg")]
    pipeline = Pipeline(load_pipeline("tomic_2018", registry, input=file, sets=sets), registry)
    with pytest.raises(RunError, match="begins inside 'table'"):
        next(iter(pipeline.records()))


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    """Return the angle between two vectors [deg]."""
    cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def test_in_contact_the_hands_are_the_persons_and_nothing_jumps() -> None:
    pipeline, seen = in_contact()
    full = (seen["share"] >= 1.0).all(axis=1)
    assert full.sum() > 400
    assert seen["off"][full].max() < 0.002
    assert np.degrees(seen["turn"][full].max()) < 1.0
    assert seen["off"][~full].max() > 0.05  # elsewhere the robot has its own size
    assert (seen["held"] <= (seen["share"] >= 1.0)).all()
    assert 400 < seen["held"].all(axis=1).sum() < full.sum()
    velocity = 100.0 * np.diff(seen["target"], axis=0)
    assert np.abs(velocity).max() < 1.5
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.08
    assert (seen["joints"] >= pipeline.robot.lower - 1e-9).all()
    assert (seen["joints"] <= pipeline.robot.upper + 1e-9).all()
    assert not seen["contact"].any()  # the pelvis is held over the ground


# ------------------------------------------------------------------ workspace and placement (T11)

THUMBS_UP = (-1.5708, -0.161, 0.034)
"""How the performer's left hand is turned at the drawer's handle [rad]."""


def test_both_hands_mirror_one_another() -> None:
    grips = Grips([{"name": "a", "position_m": [0.5, 0.0, 1.0]}], "a", (0.0, 0.2, 0.1), (-0.1, 0.0, 0.0))
    poses = grips.poses((0.3, -0.2, 0.5), 0.03)
    mirror = np.diag([1.0, -1.0, 1.0])
    for left, right in poses:
        np.testing.assert_allclose(mirror @ left[:3, :3] @ mirror, right[:3, :3], atol=1e-12)
        np.testing.assert_allclose(mirror @ left[:3, 3], right[:3, 3], atol=1e-12)
    np.testing.assert_allclose(poses[0][0][:3, :3], pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), atol=1e-12)
    places = np.array([left[:3, 3] for left, _ in poses])
    np.testing.assert_allclose(places.min(axis=0), [0.37, 0.17, 1.07], atol=1e-12)
    np.testing.assert_allclose(places.max(axis=0), [0.53, 0.23, 1.13], atol=1e-12)


@pytest.mark.slow
def test_from_where_the_drawer_is_out_of_reach_a_placement_is_found_that_does_the_task(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """At the person's place ROMEO cannot follow the hands; where the search puts it, it can."""
    _, seen = in_contact("contact.placement_m=[0, 0, 0]", frames=620)
    full = (seen["share"] >= 1.0).all(axis=1)
    assert full.sum() > 50
    assert seen["off"][full].max() > 0.01
    caplog.set_level("INFO", logger="imitor")
    search = ("placement_m=null", f"grip_rpy_rad={list(THUMBS_UP)}", "rise_m=0.1", "search_m=0.2")
    pipeline, seen = in_contact(*(f"contact.{s}" for s in search), frames=620)
    stage: Any = {c.name: c for _, c in pipeline.stages}["contact_transition"]
    shift = stage.placement
    assert 0.05 < np.linalg.norm(shift) < 0.2
    told = [round(float(x), 3) for x in shift]
    assert f"contact_transition: 'handle' is in the workspace from placement_m: {told}" in caplog.messages
    full = (seen["share"] >= 1.0).all(axis=1)
    assert full.sum() > 50
    assert seen["off"][full].max() < 0.002
    assert np.degrees(seen["turn"][full].max()) < 1.0
    # the workspace says the same of both places
    workspace = Workspace(pipeline.robot)
    poses = stage.grips.poses(THUMBS_UP, stage.config.room_m)
    found = pipeline.stack.anchor_pose.copy()
    assert workspace.miss(found, poses) <= REACHED
    before = found.copy()
    before[:3, 3] -= found[:3, :3] @ shift
    assert workspace.miss(before, poses) > REACHED


def test_no_placement_is_made_up_where_none_reaches() -> None:
    sets = ("placement_m=null", "grip_offset_m=[0, 0.18, 1.0]", "search_m=0.05", "rise_m=0.0")
    with pytest.raises(RunError) as caught:
        in_contact(*(f"contact.{s}" for s in sets), frames=1)
    assert re.fullmatch(
        r".*stages\[1\] contact: 'handle' is out of the robot's workspace from every placement up to 0\.05 m fore and "
        r"aft and 0\.0 m up: at best, \[.*\], a hand misses by 0\.\d+ m or rad; raise search_m or rise_m, lower "
        r"room_m, move the object, or give placement_m\. The frames before are kept\.",
        str(caught.value),
    ), caught.value


def test_a_hand_that_holds_has_the_persons_path() -> None:
    registry = Registry(entry_points=False)
    with pytest.raises(SpecError, match="grasp_m should be at most held_m"):
        load_pipeline("tomic_2018", registry, sets=["contact.grasp_m=0.05"])
