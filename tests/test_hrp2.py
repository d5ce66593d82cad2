"""HRP-2: the model against published figures and an independent model's kinematics, in MuJoCo, imitating."""

from __future__ import annotations

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.metrics.polygon import convex_hull, margin
from imitor.registry import Registry
from imitor.robot.check import check_card
from imitor.robot.describe import height_m
from imitor.robot.model import RobotModel
from imitor.testing import make_robot
from imitor.types import Array
from robot_facts import (
    assert_same_bodies,
    assert_same_kinematics,
    links,
    motors,
    mujoco_model,
    sole_corners_of_bodies,
)

ROOT = Path(__file__).resolve().parents[1]
URDF = ROOT / "plugins" / "robots" / "models" / "hrp2.urdf"
LOW_WAIST = np.array([0.0, 0.0, 0.003])  # the reference keeps the waist joints 3 mm lower [m]
UPPER = ("CHEST", "HEAD", "LARM", "RARM")


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return make_robot("hrp2")


@pytest.fixture(scope="module")
def urdf() -> ET.Element:
    return ET.parse(URDF).getroot()


@pytest.fixture
def reference(shared: Path) -> Path:
    folder = shared / "robots_reference" / "hrp2"
    if not folder.is_dir():
        pytest.skip(f"no reference model at {folder}")
    return folder


def other_side(name: str) -> str:
    swap = {"L": "R", "R": "L"}
    return swap[name[0]] + name[1:] if name.startswith(("LLEG", "RLEG", "LARM", "RARM")) else name


def random_configuration(robot: RobotModel, rng: np.random.Generator) -> Array:
    q = robot.standing.copy()
    q[7:] = rng.uniform(robot.lower, robot.upper)
    return q


# ---------------------------------------------------------------- the file and its figures


def test_the_file_is_in_step_with_its_tables() -> None:
    command = [sys.executable, str(ROOT / "tools" / "make_hrp2.py"), "--check"]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr


def test_size_is_the_published_one(robot: RobotModel, urdf: ET.Element) -> None:
    assert len(motors(urdf)) == 30
    assert robot.mass_kg == pytest.approx(56.037, abs=1e-3)
    from imitor.robot.describe import collision_or_reason

    assert 1.53 < height_m(robot, collision_or_reason(robot)) < 1.57


def test_joints_are_those_of_the_reference(reference: Path, urdf: ET.Element) -> None:
    ours, theirs = motors(urdf), motors(ET.parse(reference / "hrp2_from_rob.urdf").getroot())
    assert set(ours) == set(theirs)
    for name, joint in ours.items():
        np.testing.assert_allclose(joint["limits"], theirs[name]["limits"], atol=1e-6, err_msg=name)
        np.testing.assert_allclose(joint["axis"], theirs[name]["axis"], atol=1e-12, err_msg=name)
        expected = theirs[name]["origin"] + (LOW_WAIST if name == "CHEST_JOINT0" else 0.0)
        if name == "RARM_JOINT6":  # digits swapped there: as the left one here
            expected = ours["LARM_JOINT6"]["origin"]
        np.testing.assert_allclose(joint["origin"], expected, atol=1e-9, err_msg=name)


def test_masses_are_those_of_the_reference(reference: Path, urdf: ET.Element) -> None:
    theirs = links(ET.parse(reference / "hrp2_from_rob.urdf").getroot())
    ours = links(urdf)
    assert set(ours) == set(theirs)
    for name, (mass, centre, inertia) in ours.items():
        assert mass == pytest.approx(theirs[name][0], abs=6e-6), name
        if name == "RARM_LINK4":  # not the left one's mirror image there, 6 mm off
            continue
        np.testing.assert_allclose(centre, theirs[name][1], atol=6e-6, err_msg=name)
        np.testing.assert_allclose(inertia, theirs[name][2], atol=5e-6, err_msg=name)


def test_half_sitting_is_the_published_one(robot: RobotModel) -> None:
    robot.update(robot.standing)
    sole = robot.sole_corners()
    assert robot.standing[2] - sole[..., 2].min() == pytest.approx(0.648702, abs=1e-6)
    waist = robot.position("waist")
    for side, y in (("left", 0.095), ("right", -0.095)):
        at = robot.position(f"{side}_ankle") - waist
        np.testing.assert_allclose(at, [0.0095, y, 0.105 - 0.648702], atol=2e-5)
    # 3 mm more under the arms, the head and the chest than in the source of the published 0.8085 m
    np.testing.assert_allclose((robot.com - waist)[:2], [0.0129, 0.0016], atol=2e-4)
    assert robot.com[2] - sole[..., 2].min() == pytest.approx(0.8085 + 0.0012, abs=3e-4)


# ---------------------------------------------------------------- kinematics


def test_frames_and_centre_of_mass_meet_the_reference(reference: Path, robot: RobotModel) -> None:
    import pinocchio as pin

    facts = json.loads((reference / "fk_com_reference.json").read_text(encoding="utf-8"))
    model, data = robot.full_model, robot.full_model.createData()
    masses = {name: mass for name, (mass, _, _) in links(ET.parse(URDF).getroot()).items()}
    lifted = sum(m for name, m in masses.items() if name.startswith(UPPER)) / sum(masses.values())
    assert len(facts["configurations"]) == 7
    for given in facts["configurations"]:
        q = pin.neutral(model)
        for name, value in given["joints"].items():
            q[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, q)
        # The right forearm's end is the left one's mirror image here, and so are the fingers' places.
        com = np.array(given["com"]) + lifted * LOW_WAIST
        np.testing.assert_allclose(pin.centerOfMass(model, data, q), com, atol=1e-4)
        for role, frame in given["frames"].items():
            pose = data.oMf[model.getFrameId(frame["link"], pin.FrameType.BODY)]
            lift = LOW_WAIST if frame["link"].startswith(UPPER) else 0.0
            expected = np.array(frame["position"]) + lift
            np.testing.assert_allclose(pose.translation, expected, atol=1e-6, err_msg=role)
            np.testing.assert_allclose(pose.rotation, frame["rotation"], atol=1e-6, err_msg=role)


def test_left_and_right_are_mirror_images(robot: RobotModel) -> None:
    rng = np.random.default_rng(4)
    twin = [robot.joint_index(other_side(name)) for name in robot.joint_names]
    axis = {name: joint["axis"] for name, joint in motors(ET.parse(URDF).getroot()).items()}
    sign = np.array([1.0 if axis[name][1] else -1.0 for name in robot.joint_names])
    np.testing.assert_allclose(robot.lower, np.where(sign > 0, robot.lower[twin], -robot.upper[twin]))
    for _ in range(20):
        q = random_configuration(robot, rng)
        mirrored = q.copy()
        mirrored[7:] = sign * q[7:][twin]
        robot.update(q)
        points = {role: robot.position(role).copy() for role in robot.roles}
        robot.update(mirrored)
        for role, point in points.items():
            side, _, rest = role.partition("_")
            swapped = {"left": "right_", "right": "left_"}.get(side)
            image = robot.position(swapped + rest if swapped else role)
            np.testing.assert_allclose(image, point * [1, -1, 1], atol=1e-12, err_msg=role)
    robot.update(robot.standing)


def test_lengths_are_the_published_ones(robot: RobotModel) -> None:
    lengths = robot.segment_lengths()
    published = {
        "left_upper_arm": 0.250, "left_forearm": 0.250, "left_thigh": 0.300, "left_shank": 0.3020,
        "shoulders": 0.500, "hips": 0.120, "torso": np.hypot(0.5317, 0.040), "ankle_height": 0.105,
    }  # fmt: skip
    for name, length in published.items():
        assert lengths[name] == pytest.approx(length, abs=5e-5), name


# ---------------------------------------------------------------- MuJoCo and FCL


@pytest.fixture(scope="module")
def in_mujoco() -> Any:
    return mujoco_model(URDF)


def test_mujoco_has_the_same_kinematics(robot: RobotModel, in_mujoco: Any) -> None:
    assert in_mujoco.nu == 0 and in_mujoco.njnt == 1 + 30
    rng = np.random.default_rng(7)
    assert_same_kinematics(robot, in_mujoco, [random_configuration(robot, rng) for _ in range(10)])


def test_mujoco_has_every_body_that_fcl_has(robot: RobotModel, in_mujoco: Any) -> None:
    assert_same_bodies(robot, in_mujoco)


def test_torque_limits_reach_the_simulation(robot: RobotModel, in_mujoco: Any) -> None:
    for name, joint in motors(ET.parse(URDF).getroot()).items():
        assert in_mujoco.jnt_actfrcrange[in_mujoco.joint(name).id][1] == pytest.approx(float(joint["torque"]))


def test_feet_touch_the_floor_where_the_card_says(robot: RobotModel) -> None:
    touched = convex_hull(sole_corners_of_bodies(robot, "LLEG_LINK5", 0.105))
    polygon = convex_hull([(float(x), float(y)) for x, y in robot.sole[0, :, :2]])
    np.testing.assert_allclose(sorted(touched), sorted(polygon), atol=1e-9)


# ---------------------------------------------------------------- card


def test_the_card_has_no_findings_to_act_on() -> None:
    found = check_card("hrp2", Registry(entry_points=False))
    assert [f.message for f in found if f.level != "note"] == []


def test_it_stands_flat_and_balanced(robot: RobotModel) -> None:
    robot.update(robot.standing)
    corners = robot.sole_corners()
    assert np.ptp(corners[..., 2]) < 1e-7
    outline = convex_hull([(float(x), float(y)) for x, y in corners[..., :2].reshape(-1, 2)])
    assert margin((float(robot.com[0]), float(robot.com[1])), outline) > 0.10
