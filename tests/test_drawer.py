"""A drawer: written once, moved by the hands that hold it, seen alike by collisions, pictures and physics."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor import testing
from imitor.cli import main
from imitor.collision.distances import Distances
from imitor.collision.obstacles import graspable, obstacles
from imitor.collision.shapes import robot_shapes
from imitor.contact.grasp import Grasp
from imitor.contact.grips import Grips
from imitor.environment import carriers, read_environment
from imitor.errors import ImitorError, SpecError
from imitor.record import Motion, Recorder, Reference
from imitor.registry import Registry
from imitor.robot.hands import hand_joints
from imitor.robot.model import RobotModel
from imitor.simulation.body import Body, Surroundings
from imitor.simulation.drives import make_drives
from imitor.simulation.playback import play
from imitor.spec import load_text

REGISTRY = Registry(entry_points=False)
SLIDE = {"axis": [-2.0, 0.0, 0.0], "range_m": 0.25, "mass_kg": 2.0, "friction_n": 3.0, "damping_n_s_m": 5.0}
DRAWER: list[dict[str, Any]] = [
    {"name": "table", "shape": "box", "size_m": [0.1, 0.1, 0.1], "position_m": [3.0, 3.0, 0.5]},
    {"name": "drawer", "shape": "box", "size_m": [0.3, 0.4, 0.1], "position_m": [0.8, 0.0, 1.0], "slide": SLIDE},
    {"name": "handle", "shape": "box", "size_m": [0.02, 0.4, 0.02], "position_m": [0.5, 0.0, 1.0],
     "part_of": "drawer", "graspable": True},
]  # fmt: skip
TEXT = """\
imitor: 1
robot: unitree_g1
source: {use: performer, scenario: wave}
environment:
%s
stages:
  - mapper: segment_scaling
  - solver: prioritized
    order: [[left_foot, right_foot]]
"""


@pytest.fixture(scope="module")
def romeo() -> RobotModel:
    return testing.make_robot("romeo")


# ------------------------------------------------------------------ what may be written


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (
            "slide: {axis: [0, 0, 0], range_m: 1}",
            "environment[0].slide: its axis has no direction; [-1, 0, 0] opens towards a robot that faces x",
        ),
        ("slide: {axis: [1, 0, 0]}", "environment[0].slide.range_m: required, but not given"),
        ("part_of: b", "environment[0].part_of: no other object that slides is called 'b'"),
        ("part_of: a", "environment[0].part_of: no other object that slides is called 'a'"),
        (
            "slide: {axis: [1, 0, 0], range_m: 1}, part_of: a",
            "environment[0].part_of: an object with a slide of its own is part of no other",
        ),
    ],
)
def test_a_wrong_slide_is_told_at_its_place(entry: str, expected: str) -> None:
    with pytest.raises(SpecError) as caught:
        load_text(TEXT % f"  - {{name: a, shape: box, size_m: [1, 1, 1], {entry}}}", REGISTRY, "p.yaml")
    assert [f"{p.where}: {p.message}" for p in caught.value.problems] == [expected]


def test_what_is_part_of_a_drawer_moves_with_it() -> None:
    items = read_environment(DRAWER)
    assert carriers(items) == [-1, 1, 1]
    assert items[1].slide is not None
    np.testing.assert_allclose(items[1].slide.direction(), [-1.0, 0.0, 0.0])
    grips = Grips(DRAWER, "handle", (0.0, 0.1, 0.0), None)
    np.testing.assert_allclose(grips.travel, [-0.25, 0.0, 0.0])
    assert (grips.number, grips.moving) == (2, [1, 2])
    assert Grips(DRAWER, "table", (0.0, 0.1, 0.0), None).moving == []


@pytest.mark.parametrize("travel", [(-0.3, 0.0, 0.0), (0.1, 0.0, 0.0), (-0.1, 0.01, 0.0)])
def test_a_travel_that_the_drawer_does_not_have_is_refused(travel: tuple[float, float, float]) -> None:
    with pytest.raises(ImitorError) as caught:
        Grips(DRAWER, "handle", (0.0, 0.1, 0.0), travel)
    assert str(caught.value) == (
        f"travel_m {list(travel)} does not fit 'drawer', which slides 0.25 m along [-1.0, 0.0, 0.0]; "
        "leave travel_m out for all of that"
    )


# ------------------------------------------------------------------ held


def held(path: Any) -> tuple[list[bool], list[float]]:
    """Return whether the left hand holds the handle along a path from its grip, and how far it is open [m]."""
    grasp = Grasp(Grips(DRAWER, "handle", (0.0, 0.1, 0.0), None), 0.01)
    holds, opened = [], []
    for offset in path:
        grasp.step([(0, grasp.grips.closed[0] + offset)])
        holds.append(bool(grasp.holds[0]))
        opened.append(-float(grasp.shift[0]))
    return holds, opened


def test_a_drawer_goes_with_the_hand_that_took_it() -> None:
    holds, opened = held(
        [(-0.2, 0, -0.2), (-0.05, 0, 0), (0, 0, 0), (-0.1, 0, 0), (-0.1, 0, 0.05), (0, 0, 0)]
    )
    assert holds == [
        False,
        False,
        True,
        True,
        False,
        False,
    ]  # on the line of travel, but not at the handle: no
    np.testing.assert_allclose(opened, [0.0, 0.0, 0.0, 0.1, 0.1, 0.1], atol=1e-12)


@given(st.lists(st.tuples(*[st.floats(-0.4, 0.4)] * 3), max_size=12))
def test_a_drawer_never_leaves_its_range_nor_moves_by_itself(path: list[tuple[float, ...]]) -> None:
    holds, opened = held(path)
    assert all(0.0 <= x <= 0.25 + 1e-12 for x in opened)
    for before, after, on in zip([0.0, *opened], opened, holds, strict=False):
        assert on or before == after


# ------------------------------------------------------------------ collisions


def test_distances_follow_an_object_and_hands_may_touch_what_is_graspable(romeo: RobotModel) -> None:
    around = obstacles(DRAWER)
    shapes = robot_shapes(romeo, 0.005, around, graspable(DRAWER))
    assert shapes.n_objects == 3
    hands = hand_joints(romeo)
    links = {
        (shapes.links[b], int(shapes.joint[a]) in hands)
        for a, b in shapes.pairs.tolist()
        if shapes.links[b] in ("drawer", "handle")
    }
    assert links == {("drawer", True), ("drawer", False), ("handle", False)}
    distances = Distances(romeo, shapes)

    def nearest() -> float:
        found, d, _, _ = distances.below(2.0)
        return min(
            float(x) for k, x in zip(found, d, strict=True) if shapes.links[shapes.pairs[k, 1]] == "drawer"
        )

    romeo.update(romeo.standing)
    shift = np.zeros((3, 3))
    closed = nearest()
    shift[1, 0] = 1.0
    distances.move_objects(shift)
    assert nearest() > closed + 0.5
    distances.move_objects(0.0 * shift)
    assert nearest() == pytest.approx(closed, abs=1e-9)


# ------------------------------------------------------------------ physics


def pulled(romeo: RobotModel, *, near: bool = True, **how: Any) -> tuple[Any, Any]:
    """Hold arms forward for two seconds, the hands on a handle of their own height or under one, and pull by sliding.

    The base is held and moved back by 0.1 m in the second between; returns what happened and the body.
    """
    romeo.update(romeo.standing)
    hand = romeo.position("left_hand")
    where = [float(hand[0]), 0.0, float(hand[2]) + (0.0 if near else 0.2)]
    drawer = [dict(DRAWER[1], position_m=[where[0] + 0.5, 0.0, where[2]]), dict(DRAWER[2], position_m=where)]
    drawer[1]["size_m"] = [0.02, 2.2 * float(hand[1]), 0.02]
    drives = make_drives(romeo, kp_per_effort=30.0, kv_per_kp=0.05)
    body = Body(romeo, drives, Surroundings(), environment=drawer, held=True)
    t = np.arange(300) / 100.0
    back = 0.1 * np.clip(t - 1.0, 0.0, 1.0)
    root = np.tile(romeo.standing[:3], (300, 1)) - back[:, None] * [1.0, 0.0, 0.0]
    motion = Motion(
        "romeo", t, romeo.joint_names, np.tile(romeo.standing[7:], (300, 1)), root,
        np.tile([1.0, 0.0, 0.0, 0.0], (300, 1)), np.zeros((300, 2), dtype=bool), ["ok"] * 300,
    )  # fmt: skip
    empty = np.zeros((300, 0))
    shift = -back[:, None, None] * np.array([1.0, 0.0, 0.0]) * np.ones((1, 2, 1))
    holds = np.where((t > 0.2) & (t < 2.5), 1, -1)[:, None] * np.ones(2, dtype=int)
    reference = Reference(
        t, (), np.zeros((300, 0, 3)), empty.astype(bool), np.zeros((300, 2), dtype=bool),
        np.zeros(300, dtype=bool), np.full((300, 3), np.nan), {}, {}, {}, t, 1.7, 0.1, ["drawer", "handle"], shift,
        holds,
    )  # fmt: skip
    return play(body, motion, settle_s=0.1, reference=reference, **how), body


def test_hands_that_hold_a_drawer_pull_it_and_leave_it_there(romeo: RobotModel) -> None:
    trace, body = pulled(romeo, reach_m=0.03)
    opened = -trace.object_shift[:, 0, 0]
    np.testing.assert_array_equal(trace.object_shift[:, 0], trace.object_shift[:, 1])
    assert trace.held[150].tolist() == [1, 1] and trace.held[-1].tolist() == [-1, -1]
    assert opened[90] < 1e-3 and 0.09 < opened[-1] < 0.11
    assert opened[-1] == pytest.approx(opened[260], abs=1e-3)
    assert np.abs(trace.q - trace.q_asked)[:, :3].max() < 1e-3  # the base stays where it is held
    robot_mass = sum(i.mass for i in romeo.model.inertias[1:])
    assert body.weight_n == pytest.approx(9.81 * robot_mass, rel=1e-3)


def test_hands_take_nothing_from_afar_or_when_they_may_not(romeo: RobotModel) -> None:
    for near, reach_m in ((False, 0.03), (True, 0.0)):
        trace, _ = pulled(romeo, near=near, reach_m=reach_m)
        assert (trace.held == -1).all()
        assert np.abs(trace.object_shift).max() < 1e-3


def simulate(out: Path, *more: str) -> dict[str, Any]:
    sets = [x for option in ("settle_s=0.2", *more) for x in ("--set", option)]
    assert main(["run", "tomic_2018", "--simulate", "--quiet", "--out", str(out), *sets]) == 0
    found: dict[str, Any] = json.loads((out / "metrics.json").read_text())["simulation"]
    return found


@pytest.mark.slow
def test_the_simulated_robot_opens_the_drawer_as_the_human_does(tmp_path: Path) -> None:
    found = simulate(tmp_path)
    drawer = found["objects"]["drawer"]
    assert drawer["asked_m"] == pytest.approx(0.1, abs=0.002)  # how far the human pulls it
    assert drawer["opened_share"] >= 0.9
    assert drawer["error_m"]["max"] < 0.01
    assert drawer["left_open_m"] < 0.01  # and shuts it
    assert drawer["held_hand_frames"] >= 0.95 * drawer["asked_held_hand_frames"] > 500
    assert (found["fell"], found["base_held"], found["zmp_inside_share"]) == (False, True, None)
    assert found["base_error_m"]["max"] < 0.001
    with np.load(tmp_path / "simulation.npz") as arrays:
        assert np.abs(arrays["object_shift_m"][:, 0]).max() == pytest.approx(drawer["opened_m"], rel=1e-5)
    reference = Reference.load(tmp_path / "reference.npz")
    assert list(reference.object_names[:2]) == ["drawer", "handle"]
    assert -reference.object_shift_m[:, 0, 0].min() == pytest.approx(drawer["asked_m"], rel=1e-5)
    motion = Motion.load(tmp_path / "motion.npz")
    assert not motion.contact.any()  # the pelvis is held, so no foot stands
    speed = np.abs(np.diff(reference.object_shift_m[:, 0, 0])) * 100.0
    assert speed.max() < 0.5  # it does not jump when it is taken


@pytest.mark.slow
def test_without_grasp_the_drawer_stays_shut(tmp_path: Path) -> None:
    drawer = simulate(tmp_path, "mujoco.grasp=false")["objects"]["drawer"]
    assert drawer["asked_m"] > 0.09
    assert drawer["opened_m"] < 0.002
    assert drawer["held_hand_frames"] == 0


# ------------------------------------------------------------------ pictures


def test_pictures_and_the_viewer_show_where_the_drawer_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from imitor.visual.studio import Studio

    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path / "cache"))
    run = testing.make_run(tmp_path)
    info = dataclasses.replace(run.info, environment=DRAWER)
    recorder = Recorder(info)
    for record in run.records():
        recorder.add(record)
    motion, still = recorder.motion(), recorder.reference()
    assert list(still.object_names) == []  # the run's stack knew of none
    shift = np.zeros((len(motion), 3, 3))
    shift[:, 1:, 0] = -0.2
    moved = dataclasses.replace(still, object_names=["table", "drawer", "handle"], object_shift_m=shift)
    pictures = []
    for reference in (still, moved):
        studio = Studio(
            run.info.robot,
            motion,
            reference,
            np.arange(1),
            size=(160, 120),
            environment=DRAWER,
            shadows=False,
        )
        pictures.append(studio.picture(0).astype(int))
        studio.close()
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 20).sum() > 30


def test_a_run_without_objects_is_read_as_before(tmp_path: Path) -> None:
    t = np.arange(3) / 10.0
    empty = np.zeros((3, 0))
    reference = Reference(
        t, (), np.zeros((3, 0, 3)), empty.astype(bool), np.zeros((3, 2), dtype=bool), np.zeros(3, dtype=bool),
        np.full((3, 3), np.nan), {}, {}, {}, t, 1.7, 0.1,
    )  # fmt: skip
    reference.save(tmp_path / "reference.npz")
    with np.load(tmp_path / "reference.npz") as data:
        old = {n: data[n] for n in data.files if not n.startswith(("object_", "held_"))}
    np.savez(tmp_path / "old.npz", **old)
    read = Reference.load(tmp_path / "old.npz")
    assert read.object_shift_m.shape == (3, 0, 3)
    assert read.held_object.tolist() == [[-1, -1]] * 3
