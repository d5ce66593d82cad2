"""What `imitor show ROBOT` says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imitor.registry import Registry
from imitor.robot.card import load_card
from imitor.robot.describe import Section, collision_or_reason, describe, height_m, sections
from imitor.robot.model import RobotModel
from small_humanoid import FOREARM, SmallHumanoid

REGISTRY = Registry(entry_points=False)


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path_factory.getbasetemp() / "hulls"))


def section(robot: RobotModel, title: str) -> dict[str, tuple[str, ...]]:
    rows = next(s.rows for s in sections(robot) if s.title.startswith(title))
    return {row[0]: tuple(row[1:]) for row in rows}


def test_facts_of_the_small_humanoid(tmp_path: Path) -> None:
    human = SmallHumanoid()
    human.card["locked"] = {"waist_yaw": 0.25}
    human.card["coupled"] = [{"joints": ["left_hip_roll", "right_hip_roll"]}]
    human.card["standing"] = {"left_elbow": -0.3}
    robot = RobotModel.load(str(human.write(tmp_path)))
    overview = section(robot, "small: Small humanoid of boxes")
    assert overview["licence"] == ("CC0-1.0",)
    assert overview["joints"] == ("16 moved, 1 not moved",)
    assert overview["independent"] == ("15",)
    assert overview["mass"] == ("24.80 kg",)
    assert overview["height"] == ("1.26 m",)  # 0.70 m to the pelvis, 0.05 + 0.35 to the head, 0.16 of it
    assert "overlap in the standing posture" in overview["collision pairs"][0]
    assert section(robot, "Roles")["left_elbow"] == ("left_forearm",)
    assert section(robot, "Segment lengths")["left_forearm"] == (
        "0.1800 m",
        f"{FOREARM / (0.146 * 1.75):.0%}",
    )
    assert section(robot, "Soles")["size"] == ("0.180 m long, 0.080 m wide",)
    assert section(robot, "Soles")["under the ankle"] == ("0.0500 m",)
    knee = section(robot, "Joints")["left_knee"]
    assert [" ".join(cell.split()) for cell in knee] == ["0.000 to 2.300", "0.0 to 131.8", "8.00", "0.000"]
    assert section(robot, "Joints")["left_elbow"][3] == "-0.300"
    assert section(robot, "Joints that one motor moves") == {"left_hip_roll, right_hip_roll": ()}
    assert section(robot, "Joints that are not moved") == {"waist_yaw": ("0.250 rad",)}
    assert section(robot, "Sources") == {"Made up.": ()}


@pytest.mark.parametrize(
    ("name", "height", "pairs"), [("unitree_g1", 1.32, 579), ("romeo", 1.40, 70), ("talos", 1.76, 883)]
)
def test_known_robots(name: str, height: float, pairs: int) -> None:
    robot = RobotModel.load(name)
    q = robot.standing.copy()
    collision = collision_or_reason(robot)
    assert not isinstance(collision, str)
    assert height_m(robot, collision) == pytest.approx(height, abs=0.02)
    assert len(collision.pairs) == pairs
    np.testing.assert_array_equal(robot.standing, q)
    text = describe(load_card(name, REGISTRY))
    assert text.startswith(f"{name}: {robot.card.title}\n")
    assert all(joint in text for joint in robot.joint_names)
    assert robot.card.licence in text


def test_a_robot_without_collision_geometry(tmp_path: Path) -> None:
    human = SmallHumanoid()
    for link in human.links:
        link.box = (0.0, 0.0, 0.0)
    robot = RobotModel.load(str(human.write(tmp_path)))
    overview = section(robot, "small")
    assert overview["collision pairs"] == ("its model has no collision geometry",)
    assert overview["height"] == ("1.10 m (to the highest role: there is no collision geometry)",)


def test_a_section_is_a_table_of_aligned_columns() -> None:
    text = str(Section("Lengths", [("a", "1"), ("long name", "22")], ("segment", "m")))
    assert text == "Lengths\n  segment    m\n  a          1\n  long name  22"
