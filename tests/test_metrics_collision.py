"""Self-collision: pairs, depth, and the hulls kept on disk."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor import metrics
from imitor.cache import cache_folder
from imitor.metrics.collision import CollisionModel, collision_model, robot_collision_model
from imitor.metrics.kinematics import fresh_model
from imitor.robot.card import RobotCard
from imitor.robot.files import ModelFiles
from imitor.robot.model import RobotModel
from small_humanoid import SmallHumanoid, moving, still

SLIDES = """
<robot name="slides">
  <link name="base">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry>{base}</geometry></collision></link>
  <link name="carrier"/>
  <link name="tip"><collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
  <joint name="x" type="prismatic"><parent link="base"/><child link="carrier"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="y" type="prismatic"><parent link="carrier"/><child link="tip"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>
"""
BOX = '<box size="0.2 0.2 0.2"/>'


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A hull cache of this test's own."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("IMITOR_CACHE", str(folder))
    return folder


def slides(tmp_path: Path, base: str = BOX, **card: Any) -> CollisionModel:
    """Return two links on sliding joints, with no joint between them, that start apart."""
    path = tmp_path / "slides.urdf"
    path.write_text(SLIDES.format(base=base), encoding="utf-8")
    made = RobotCard.model_validate(
        {
            "imitor_robot": 1, "title": "Slides", "licence": "CC0-1.0", "model": {"file": "slides.urdf"},
            "roles": {},
            "soles": {"frame": "base", "polygon_m": [[0, 0], [1, 0], [0, 1]]}, "name": "slides", **card,
        }
    )  # fmt: skip
    files = ModelFiles(path, None, (tmp_path,))
    return collision_model(made, files, fresh_model(made, files), at(0.5))


def at(x: float, y: float = 0.0) -> np.ndarray:
    return np.array([0, 0, 0, 0, 0, 0, 1, x, y], dtype=float)


def test_depth_is_that_of_the_overlap(tmp_path: Path) -> None:
    model = slides(tmp_path)
    assert model.pairs == [("base", "tip")]
    assert model.collisions(at(0.21)) == []
    assert model.collisions(at(0.1995)) == []  # half a millimetre does not count
    ((depth, links),) = model.collisions(at(0.19))
    assert depth == pytest.approx(0.01, abs=1e-6)
    assert links == ("base", "tip")
    ((depth, _),) = model.collisions(at(0.0, 0.17))
    assert depth == pytest.approx(0.03, abs=1e-6)


def test_pairs_that_the_card_skips(tmp_path: Path) -> None:
    assert (
        slides(tmp_path, collision={"skip": [["tip", "base"]], "reason": "They are made to meet."}).pairs
        == []
    )


def test_pairs_that_overlap_when_standing_are_left_out(tmp_path: Path) -> None:
    wide = '<box size="1.2 0.2 0.2"/>'
    model = slides(tmp_path, wide)
    assert model.pairs == []
    assert model.rule == "without the pairs that overlap in the standing posture"


def l_shape(folder: Path, reach: float) -> str:
    """Write a mesh of an L, 0.2 m high, and return its URDF geometry; the hull fills its notch."""
    import trimesh

    foot = trimesh.creation.box(
        (reach, 0.2, 0.05), trimesh.transformations.translation_matrix((reach / 2, 0, -0.075))
    )
    leg = trimesh.creation.box((0.05, 0.2, 0.2), trimesh.transformations.translation_matrix((0.025, 0, 0)))
    trimesh.util.concatenate([foot, leg]).export(folder / "l.stl")
    return '<mesh filename="l.stl"/>'


def test_meshes_become_hulls_once(tmp_path: Path, cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="imitor")
    mesh = l_shape(tmp_path, 0.1)
    first = slides(tmp_path, mesh)
    assert [r.getMessage() for r in caplog.records] == ["robot 'slides': preparing collision hulls (once)"]
    deep = first.collisions(at(0.19))
    assert first.collisions(at(0.201)) == []
    assert deep[0][0] == pytest.approx(0.01, abs=1e-6)
    again = slides(tmp_path, mesh)
    assert len(caplog.records) == 1
    assert again.collisions(at(0.19)) == deep
    assert cache_folder() == cache


def test_a_changed_mesh_and_a_damaged_file_are_prepared_again(
    tmp_path: Path, cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, logger="imitor")
    assert slides(tmp_path, l_shape(tmp_path, 0.1)).collisions(at(0.25)) == []
    assert slides(tmp_path, l_shape(tmp_path, 0.3)).collisions(at(0.25))
    assert len(caplog.records) == 2
    (kept,) = (cache / "hulls").glob("*.bin")
    kept.write_bytes(kept.read_bytes()[:-100])
    assert slides(tmp_path, '<mesh filename="l.stl"/>').collisions(at(0.25))
    assert len(caplog.records) == 3


def test_a_cache_that_cannot_be_written_only_warns(
    tmp_path: Path, cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cache.write_text("a file in the way", encoding="utf-8")
    assert slides(tmp_path, l_shape(tmp_path, 0.1)).collisions(at(0.19))
    assert "collision hulls are not kept" in caplog.text


def test_a_missing_mesh_is_a_reason(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="its collision meshes cannot be read"):
        slides(tmp_path, '<mesh filename="nowhere.stl"/>')


def test_srdf_pairs_and_neighbours_are_left_out() -> None:
    romeo = robot_collision_model(RobotModel.load("romeo"))
    assert len(romeo.pairs) == 70
    assert romeo.rule == "without the pairs that the SRDF disables"
    standing = RobotModel.load("romeo").standing
    assert romeo.collisions(standing) == []


def test_g1_collides_with_crossed_arms_and_not_when_standing() -> None:
    robot = RobotModel.load("unitree_g1")
    model = robot_collision_model(robot)
    assert model.collisions(robot.standing) == []
    assert ("torso_link", "left_shoulder_pitch_link") not in model.pairs  # neighbours
    q = robot.standing.copy()
    q[7 + robot.joint_index("left_shoulder_roll_joint")] = -0.6
    links = {link for _, pair in model.collisions(q) for link in pair}
    assert any(link.startswith("left_") for link in links)


def test_frames_are_thinned_and_counted(tmp_path: Path) -> None:
    robot = RobotModel.load(str(SmallHumanoid().write(tmp_path)))
    q = np.tile(robot.standing, (40, 1))
    q[20:, 7 + robot.joint_index("left_shoulder_roll")] = -0.6
    motion, reference = moving(robot, q)
    all_frames = metrics.evaluate(motion, reference, robot, collision_every=1)["figures"][
        "self_collision_frames"
    ]
    assert (all_frames["count"], all_frames["share"], all_frames["frames"]) == (20, 0.5, 40)
    assert "left_" in all_frames["pair"]
    assert all_frames["depth_m"] > 0.001
    motion.time_s = reference.time_s = motion.time_s / 4  # 200 Hz
    thinned = metrics.evaluate(motion, reference, robot)["figures"]["self_collision_frames"]
    assert (thinned["every"], thinned["frames"], thinned["count"]) == (4, 10, 5)


def test_a_robot_without_collision_geometry_says_so(tmp_path: Path) -> None:
    human = SmallHumanoid()
    for link in human.links:
        link.box = (0.0, 0.0, 0.0)
    robot = RobotModel.load(str(human.write(tmp_path)))
    report = metrics.evaluate(*still(robot, 2), robot)
    assert (
        report["not_measured"]["self_collision_frames"]
        == "robot 'small': its model has no collision geometry"
    )
