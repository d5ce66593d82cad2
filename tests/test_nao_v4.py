"""NAO v4: the model against published figures and an independent model's kinematics, in MuJoCo, coupled, imitating."""

from __future__ import annotations

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.kinds import RunInfo
from imitor.metrics.collision import full_configurations, robot_collision_model
from imitor.metrics.polygon import convex_hull, margin
from imitor.pipeline import Pipeline
from imitor.record import Motion, Recorder
from imitor.registry import Registry
from imitor.robot.check import check_card
from imitor.robot.model import RobotModel
from imitor.spec import load_pipeline
from imitor.testing import make_robot
from imitor.types import SEGMENTS
from robot_facts import (
    assert_same_bodies,
    assert_same_kinematics,
    links,
    motors,
    mujoco_model,
    sole_corners_of_bodies,
)

ROOT = Path(__file__).resolve().parents[1]
URDF = ROOT / "plugins" / "robots" / "models" / "nao_v4.urdf"
CAPTURES = ("cmu_bvh/02_01.bvh", "bvh_other/Male1_B3_Walk.bvh", "bvh_rokoko/jesse_dance.bvh")
PUBLISHED_KG = 5.195350051  # "Masses - V4", the sum as printed


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return make_robot("nao_v4")


@pytest.fixture(scope="module")
def urdf() -> ET.Element:
    return ET.parse(URDF).getroot()


@pytest.fixture
def reference(shared: Path) -> Path:
    folder = shared / "robots_reference" / "nao_v40"
    if not folder.is_dir():
        pytest.skip(f"no reference model at {folder}")
    return folder


def other_side(name: str) -> str:
    swap = {"L": "R", "R": "L", "l_": "r_", "r_": "l_"}
    for begin, end in swap.items():
        if name.startswith(begin):
            return end + name.removeprefix(begin)
    return name


def coupled_configuration(robot: RobotModel, rng: np.random.Generator) -> np.ndarray:
    assert robot.coupling is not None
    q = robot.standing.copy()
    joints = rng.uniform(robot.lower, robot.upper)
    q[7:] = robot.coupling @ joints[robot.coupling.argmax(axis=0)]
    return q


# ---------------------------------------------------------------- the file and its figures


def test_the_file_is_in_step_with_its_tables() -> None:
    made = subprocess.run(
        [sys.executable, ROOT / "tools" / "make_nao_v4.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr


def test_masses_sum_to_the_published_one(robot: RobotModel) -> None:
    assert robot.mass_kg == pytest.approx(PUBLISHED_KG, abs=1e-6)


def test_joints_are_those_of_the_reference(reference: Path, urdf: ET.Element) -> None:
    ours, theirs = motors(urdf), motors(ET.parse(reference / "nao_v40.urdf").getroot())
    assert len(ours) == 24
    assert set(theirs) - set(ours) == {"LHand", "RHand"}  # an opening, not an angle: left out
    for name, joint in ours.items():
        for key in ("origin", "limits", "speed"):
            np.testing.assert_allclose(joint[key], theirs[name][key], atol=1e-12, err_msg=f"{name} {key}")
        np.testing.assert_allclose(joint["axis"], theirs[name]["axis"], atol=1e-9, err_msg=name)
        # The sides are rounded differently there; here the right one is the left one's.
        np.testing.assert_allclose(joint["torque"], theirs[name]["torque"], atol=6e-4, err_msg=name)


def test_masses_are_those_of_the_reference(reference: Path, urdf: ET.Element) -> None:
    theirs = links(ET.parse(reference / "nao_v40.urdf").getroot())
    for name, (mass, centre, inertia) in links(urdf).items():
        twin = theirs[name.removesuffix("Link")]
        assert mass == twin[0], name
        np.testing.assert_allclose(centre, twin[1], atol=1e-12, err_msg=name)
        if name[0] not in "Rr":  # the right side's tensors are the left one's mirror images here, not there
            np.testing.assert_allclose(inertia, twin[2], atol=1e-12, err_msg=name)


def test_loaded_limits_are_the_files(robot: RobotModel, urdf: ET.Element) -> None:
    for name, joint in motors(urdf).items():
        i = robot.joint_index(name)
        assert (robot.lower[i], robot.upper[i]) == pytest.approx(tuple(joint["limits"]))
        assert robot.speed[i] == pytest.approx(float(joint["speed"]))


# ---------------------------------------------------------------- kinematics


def test_frames_and_centre_of_mass_meet_the_reference(reference: Path, robot: RobotModel) -> None:
    import pinocchio as pin

    facts = json.loads((reference / "fk_com_reference.json").read_text(encoding="utf-8"))
    model, data = robot.full_model, robot.full_model.createData()
    for given in facts["configurations"]:
        q = pin.neutral(model)
        for name, value in given["joints"].items():
            if model.existJointName(name):
                q[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, q)
        # The reference weighs 52 mg more: the fingers and other trifles that it gives a mass for form's sake.
        np.testing.assert_allclose(pin.centerOfMass(model, data, q), given["com"], atol=2e-6)
        for role, frame in given["frames"].items():
            pose = data.oMf[model.getFrameId(frame["link"], pin.FrameType.BODY)]
            # The reference has the right hand 12.13 mm below the wrist, digits swapped; published are 12.31 mm.
            far = 2e-4 if role == "r_hand" else 1e-8
            np.testing.assert_allclose(pose.translation, frame["position"], atol=far, err_msg=role)
            if not role.endswith("hand"):  # the reference turns the hand by its opening
                np.testing.assert_allclose(pose.rotation, frame["rotation"], atol=1e-8, err_msg=role)


def test_left_and_right_are_mirror_images(urdf: ET.Element) -> None:
    flip, products = np.array([1.0, -1.0, 1.0]), np.array([1, -1, 1, 1, -1, 1])
    weights = links(urdf)
    for name, (mass, centre, inertia) in weights.items():
        if other_side(name) == name:
            continue
        twin = weights[other_side(name)]
        assert mass == twin[0]
        np.testing.assert_array_equal(centre, flip * twin[1], err_msg=name)
        np.testing.assert_array_equal(inertia, products * twin[2], err_msg=name)
    joints = motors(urdf)
    for name, joint in joints.items():
        twin_joint = joints[other_side(name)]
        if name == other_side(name):
            continue
        np.testing.assert_array_equal(joint["origin"], flip * twin_joint["origin"], err_msg=name)
        across = joint["axis"][1] != 0  # a turn about y is the same on both sides, about x or z the other way
        if not name.endswith("AnklePitch"):  # the published ranges differ
            expected = twin_joint["limits"] if across else -twin_joint["limits"][::-1]
            np.testing.assert_array_equal(joint["limits"], expected, err_msg=name)


def test_mirrored_joints_give_mirrored_points(robot: RobotModel) -> None:
    rng = np.random.default_rng(4)
    turned = ("Roll", "Yaw")  # HipYawPitch ends otherwise: the same on both sides
    sign = np.array([-1.0 if name.endswith(turned) else 1.0 for name in robot.joint_names])
    twin = [robot.joint_index(other_side(name)) for name in robot.joint_names]
    for _ in range(20):
        q = coupled_configuration(robot, rng)
        mirrored = q.copy()
        mirrored[7:] = sign * q[7:][twin]
        robot.update(q)
        points = {role: robot.position(role).copy() for role in robot.roles}
        com = robot.com.copy()
        robot.update(mirrored)
        for role, point in points.items():
            side, _, rest = role.partition("_")
            swapped = {"left": "right_", "right": "left_"}.get(side)
            image = robot.position(swapped + rest if swapped else role)
            np.testing.assert_allclose(image, point * [1, -1, 1], atol=1e-12, err_msg=role)
        np.testing.assert_allclose(
            robot.com[[0, 2]], com[[0, 2]], atol=1e-4
        )  # torso and head are not symmetric
    robot.update(robot.standing)


def test_lengths_are_the_published_ones(robot: RobotModel) -> None:
    lengths = robot.segment_lengths()
    published = {
        "left_upper_arm": 0.10607, "left_forearm": 0.05595, "left_thigh": 0.100, "left_shank": 0.1029,
        "shoulders": 0.196, "hips": 0.100, "torso": 0.185,
    }  # fmt: skip
    for name, length in published.items():
        assert lengths[name] == pytest.approx(length, abs=1e-5), name


# ---------------------------------------------------------------- MuJoCo


@pytest.fixture(scope="module")
def in_mujoco() -> Any:
    return mujoco_model(URDF)


def test_mujoco_has_the_same_kinematics(robot: RobotModel, in_mujoco: Any) -> None:
    assert in_mujoco.nu == 0 and in_mujoco.njnt == 1 + robot.n
    assert in_mujoco.neq == 1  # both hips by one motor
    rng = np.random.default_rng(7)
    assert_same_kinematics(robot, in_mujoco, [coupled_configuration(robot, rng) for _ in range(10)])


def test_mujoco_has_every_body_that_fcl_has(robot: RobotModel, in_mujoco: Any) -> None:
    assert_same_bodies(robot, in_mujoco)


def test_feet_touch_the_floor_where_the_card_says(robot: RobotModel) -> None:
    touched = convex_hull(sole_corners_of_bodies(robot, "l_ankle", 0.04511))
    polygon = convex_hull([(float(x), float(y)) for x, y in robot.sole[0, :, :2]])
    np.testing.assert_allclose(sorted(touched), sorted(polygon), atol=1e-9)
    sensors = [(0.07025, 0.0299), (0.07025, -0.0231), (-0.03025, 0.0299), (-0.02965, -0.0191)]
    assert min(margin(sensor, polygon) for sensor in sensors) > 0.0


# ---------------------------------------------------------------- card


def test_the_card_has_no_errors() -> None:
    found = check_card("nao_v4", Registry(entry_points=False))
    assert [f.message for f in found if f.level == "error"] == []
    # Published speeds are all without load; only the wrists' are that high.
    assert [f.message for f in found if f.level == "warning" and "WristYaw" not in f.message] == []


def test_it_stands_flat_and_balanced(robot: RobotModel) -> None:
    robot.update(robot.standing)
    corners = robot.sole_corners()
    assert np.ptp(corners[..., 2]) < 1e-9
    outline = convex_hull([(float(x), float(y)) for x, y in corners[..., :2].reshape(-1, 2)])
    assert margin((float(robot.com[0]), float(robot.com[1])), outline) > 0.04
    for foot in corners:  # the CoM is about over the middle of the soles, front to back
        assert abs(robot.com[0] - foot[:, 0].mean()) < 0.02


def test_nothing_touches_when_standing(robot: RobotModel) -> None:
    import pinocchio as pin

    collision = robot_collision_model(robot)
    geometry = collision.geometry
    q = full_configurations(collision.model, robot.locked, robot.joint_names, robot.standing[None])[0]
    geometry.removeAllCollisionPairs()
    geometry.addAllCollisionPairs()
    data, results = collision.model.createData(), geometry.createData()
    pin.computeCollisions(collision.model, data, geometry, results, q, False)
    joined = {("LThigh", "LTibia"), ("LForeArm", "l_wrist"), ("LBicep", "LForeArm"), ("LTibia", "l_ankle")}
    joined |= {(other_side(a), other_side(b)) for a, b in joined}
    pairs = list(zip(collision.pairs, results.collisionResults, strict=True))
    assert len(pairs) > 100
    touching = {tuple(sorted(pair)) for pair, result in pairs if result.isCollision()}
    assert touching <= {tuple(sorted(pair)) for pair in joined}


def test_it_collides_where_it_must(robot: RobotModel) -> None:
    collision = robot_collision_model(robot)
    q = robot.standing.copy()
    for name, value in {"LHipRoll": -0.379, "RHipRoll": 0.379, "LKneePitch": 0.0, "RKneePitch": 0.0}.items():
        q[7 + robot.joint_index(name)] = value
    full = full_configurations(collision.model, robot.locked, robot.joint_names, q[None])[0]
    hit = {frozenset(pair) for _, pair in collision.collisions(full)}
    assert {frozenset(("LTibia", "RTibia")), frozenset(("l_ankle", "r_ankle"))} <= hit


def test_reference_vectors_are_those_of_its_t_pose(robot: RobotModel) -> None:
    q = robot.standing.copy()
    q[7:] = robot.joint_values(robot.card.t_pose, "t_pose")
    robot.update(q)
    for side, across in (("left", 1.0), ("right", -1.0)):
        for segment, vector in robot.card.reference_vectors.items():
            a, b = SEGMENTS[f"{side}_{segment}"]
            limb = robot.position(b) - robot.position(a)
            expected = np.array(vector) * [1.0, across, 1.0]
            np.testing.assert_allclose(limb / np.linalg.norm(limb), expected, atol=1e-4)
    robot.update(robot.standing)


# ---------------------------------------------------------------- coupling and imitation


def played(frames: int, **changes: Any) -> tuple[Motion, RobotModel]:
    registry = Registry(entry_points=False)
    pipeline = Pipeline(load_pipeline("retarget", registry, robot="nao_v4", **changes), registry)
    recorder = Recorder(
        RunInfo(
            Path(), pipeline.robot, pipeline.skeleton, pipeline.rate_hz, pipeline.stack, pipeline.n_frames
        )
    )
    for record in pipeline.records(frames):
        recorder.add(record)
    pipeline.close()
    return recorder.motion(), pipeline.robot


def test_one_motor_turns_both_hips(robot: RobotModel) -> None:
    assert robot.coupling is not None and robot.coupling.shape == (24, 23)
    rng = np.random.default_rng(1)
    left, right = robot.joint_index("LHipYawPitch"), robot.joint_index("RHipYawPitch")
    v = robot.coupling @ rng.normal(size=23)
    assert v[left] == v[right] != 0.0
    q = robot.standing.copy()
    q[7:][[left, right]] = -0.5
    robot.update(q)
    knees = [robot.position(f"{side}_knee").copy() for side in ("left", "right")]
    np.testing.assert_allclose(knees[0], knees[1] * [1, -1, 1], atol=1e-12)  # opposite yaw, same pitch
    robot.update(robot.standing)


@pytest.mark.parametrize("solver", ["prioritized", "placo"])
def test_solvers_keep_both_hips_equal(solver: str) -> None:
    motion, robot = played(60, uses=[f"solve={solver}"], sets=["source.scenario=step_forward", "rate_hz=15"])
    joints = motion.configurations()[:, 7:]
    left, right = (joints[:, robot.joint_index(f"{side}HipYawPitch")] for side in "LR")
    assert len(joints) == 60
    np.testing.assert_allclose(left, right, atol=1e-9)
    assert np.ptp(left) > 1e-3  # or nothing was tried


def within_limits(motion: Motion, robot: RobotModel) -> Iterator[bool]:
    joints = motion.configurations()[:, 7:]
    yield bool(np.isfinite(motion.configurations()).all())
    yield bool((joints >= robot.lower - 1e-6).all() and (joints <= robot.upper + 1e-6).all())
    steps = np.abs(np.diff(joints, axis=0)) / np.diff(motion.time_s)[:, None]
    yield bool((steps <= robot.speed * (1 + 1e-6)).all())


@pytest.mark.parametrize("file", CAPTURES)
def test_captures_are_imitated_within_limits(shared: Path, file: str) -> None:
    motion, robot = played(400, input=shared / "mocap" / file)
    assert len(motion.time_s) > 100
    assert list(within_limits(motion, robot)) == [True, True, True]
