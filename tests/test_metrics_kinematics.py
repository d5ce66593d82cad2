"""The kinematics that measures, against two other engines."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.errors import RobotError, UnknownJoint
from imitor.metrics.kinematics import Kinematics, fresh_model, rotations_of
from imitor.robot.model import RobotModel
from small_humanoid import SmallHumanoid, moving, still

CARDS = ("unitree_g1", "romeo", "talos")


def random_configurations(robot: RobotModel, frames: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = np.tile(robot.standing, (frames, 1))
    q[:, :3] += rng.normal(0, 0.5, (frames, 3))
    q[:, 3:7] = rng.normal(0, 1, (frames, 4))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    q[:, 7:] = rng.uniform(robot.lower, robot.upper, (frames, robot.n))
    return q


def measuring(robot: RobotModel) -> Kinematics:
    return Kinematics(robot.card, fresh_model(robot.card, robot.files))


@pytest.mark.parametrize("name", CARDS)
def test_points_agree_with_the_robot_model(name: str) -> None:
    robot = RobotModel.load(name)
    q = random_configurations(robot, 10)
    motion, _ = moving(robot, q)
    path = measuring(robot).follow(motion)
    for k in range(len(q)):
        robot.update(q[k])
        for role in robot.card.sided_roles():
            np.testing.assert_allclose(path.point[role][k], robot.position(role), atol=1e-12)
        np.testing.assert_allclose(path.com[k], robot.com, atol=1e-12)
        np.testing.assert_allclose(path.sole[k], robot.sole_corners(), atol=1e-12)


def mujoco_model(urdf: Path) -> Any:
    """Compile a URDF as a floating kinematic tree: no fused links, no meshes."""
    import mujoco

    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", urdf.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = re.sub(r"<mujoco>.*?</mujoco>", "", text, flags=re.DOTALL)
    options = 'fusestatic="false" balanceinertia="true" boundmass="1e-6" boundinertia="1e-9"'
    text = re.sub(r"(<robot\b[^>]*>)", rf"\1<mujoco><compiler {options}/></mujoco>", text, count=1)
    spec = mujoco.MjSpec.from_string(text)
    spec.worldbody.first_body().add_freejoint()
    return spec.compile()


def test_points_agree_with_mujoco() -> None:
    import mujoco

    robot = RobotModel.load("unitree_g1")
    motion, _ = moving(robot, random_configurations(robot, 10, seed=2))
    path = measuring(robot).follow(motion)
    model = mujoco_model(robot.files.model)
    data = mujoco.MjData(model)
    bodies = {
        role: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
        for role, link in robot.card.sided_roles().items()
    }
    bodies = {role: body for role, body in bodies.items() if body > 0}
    assert {"left_wrist", "right_ankle", "left_hand", "head", "right_hip"} <= bodies.keys()
    columns = [model.joint(name).qposadr[0] for name in motion.joint_names]
    for k in range(len(motion)):
        data.qpos[:3], data.qpos[3:7] = motion.root_position_m[k], motion.root_quaternion_wxyz[k]
        data.qpos[columns] = motion.joint_position_rad[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for role, body in bodies.items():
            np.testing.assert_allclose(path.point[role][k], data.xpos[body], atol=1e-9, err_msg=role)
        np.testing.assert_allclose(path.com[k], data.subtree_com[0], atol=1e-5)


@pytest.mark.parametrize("mjcf", [False, True], ids=["urdf", "mjcf"])
def test_small_humanoid_by_hand(tmp_path: Path, mjcf: bool) -> None:
    robot = RobotModel.load(str(SmallHumanoid().write(tmp_path, mjcf=mjcf)))
    motion, _ = still(robot, 2)
    elbow = list(motion.joint_names).index("left_elbow")
    motion.joint_position_rad[1, elbow] = -np.pi / 2  # forearm forward
    path = measuring(robot).follow(motion)
    np.testing.assert_allclose(
        path.point["left_wrist"][0], [0.0, 0.15, 0.70 + 0.30 - 0.22 - 0.18], atol=1e-12
    )
    np.testing.assert_allclose(path.point["left_wrist"][1], [0.18, 0.15, 0.70 + 0.30 - 0.22], atol=1e-12)
    np.testing.assert_allclose(path.point["mid_hip"][0], [0.0, 0.0, 0.65], atol=1e-12)
    np.testing.assert_allclose(path.sole_centre[0], [[0.04, 0.08, 0.0], [0.04, -0.08, 0.0]], atol=1e-12)


def test_rotation_of_a_quaternion_that_is_not_normalised() -> None:
    half = np.pi / 4
    R = rotations_of(3.0 * np.array([[np.cos(half), 0.0, 0.0, np.sin(half)]]))[0]
    np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


def test_locked_joints_stay_where_the_card_says(tmp_path: Path) -> None:
    human = SmallHumanoid()
    human.card["locked"] = {"left_elbow": -1.0}
    robot = RobotModel.load(str(human.write(tmp_path)))
    motion, _ = still(robot, 1)
    forearm = measuring(robot).follow(motion)
    vector = forearm.point["left_wrist"][0] - forearm.point["left_elbow"][0]
    np.testing.assert_allclose(vector, 0.18 * np.array([np.sin(1.0), 0.0, -np.cos(1.0)]), atol=1e-12)


def test_unknown_and_missing_joints_are_named(tmp_path: Path) -> None:
    robot = RobotModel.load(str(SmallHumanoid().write(tmp_path)))
    motion, _ = still(robot, 1)
    kinematics = measuring(robot)
    motion.joint_names = ["left_knie" if n == "left_knee" else n for n in motion.joint_names]
    with pytest.raises(UnknownJoint, match="no link or joint 'left_knie'; did you mean 'left_knee'"):
        kinematics.follow(motion)
    keep = [i for i, n in enumerate(motion.joint_names) if n != "left_knie"]
    motion.joint_names = [motion.joint_names[i] for i in keep]
    motion.joint_position_rad = motion.joint_position_rad[:, keep]
    with pytest.raises(RobotError, match="no positions for left_knee of robot 'small'"):
        kinematics.follow(motion)
