"""What a URDF says, and the same model in MuJoCo: for tests that compare robot models."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

from imitor.metrics.collision import full_configurations, robot_collision_model
from imitor.robot.model import RobotModel
from imitor.types import Array

COMPILER = (
    '<mujoco><compiler strippath="false" discardvisual="false" fusestatic="false" balanceinertia="true" '
    'boundmass="1e-6" boundinertia="1e-9"/></mujoco>'
)


def numbers(element: ET.Element | None, key: str) -> np.ndarray:
    text = "0 0 0" if element is None else element.get(key, "0 0 0")
    return np.array([float(w) for w in text.split()])


def links(root: ET.Element) -> dict[str, tuple[float, np.ndarray, np.ndarray]]:
    """Return mass [kg], its centre [m] and inertia [kg m^2] of every link that has some."""
    out = {}
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        tensor = inertial.find("inertia")
        assert tensor is not None
        entries = np.array([float(tensor.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")])
        centre = numbers(inertial.find("origin"), "xyz")
        out[link.get("name", "")] = (float(numbers(inertial.find("mass"), "value")[0]), centre, entries)
    return out


def motors(root: ET.Element) -> dict[str, dict[str, np.ndarray]]:
    """Return origin, axis and limits of every joint with limits, by name."""
    out = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if limit is not None and joint.get("type") == "revolute":
            values = [float(limit.get(k, "0")) for k in ("lower", "upper", "velocity", "effort")]
            axis = numbers(joint.find("axis"), "xyz")
            out[joint.get("name", "")] = {
                "origin": numbers(joint.find("origin"), "xyz"),
                "axis": axis / np.linalg.norm(axis),
                "limits": np.array(values[:2]),
                "speed": np.array(values[2]),
                "torque": np.array(values[3]),
            }
    return out


def mujoco_model(path: Path) -> Any:
    """Return the MuJoCo model of a URDF, its base free."""
    import mujoco

    text = path.read_text(encoding="utf-8").replace("</robot>", f"{COMPILER}</robot>")
    spec = mujoco.MjSpec.from_string(text)
    spec.worldbody.first_body().add_freejoint()
    return spec.compile()


def assert_same_kinematics(robot: RobotModel, model: Any, configurations: list[Array]) -> None:
    """Compare every body's pose and the centre of mass of MuJoCo with Pinocchio's."""
    import mujoco
    import pinocchio as pin

    data, pin_data = mujoco.MjData(model), robot.full_model.createData()
    for q in configurations:
        full = full_configurations(robot.full_model, robot.locked, robot.joint_names, q[None])[0]
        data.qpos[:3], data.qpos[3:7] = q[:3], q[[6, 3, 4, 5]]
        for name in list(robot.full_model.names)[2:]:
            data.qpos[model.joint(name).qposadr[0]] = full[
                robot.full_model.joints[robot.full_model.getJointId(name)].idx_q
            ]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        pin.framesForwardKinematics(robot.full_model, pin_data, full)
        for body in range(1, model.nbody):
            pose = pin_data.oMf[robot.full_model.getFrameId(model.body(body).name, pin.FrameType.BODY)]
            np.testing.assert_allclose(data.xpos[body], pose.translation, atol=1e-12)
            np.testing.assert_allclose(data.xmat[body].reshape(3, 3), pose.rotation, atol=1e-12)
        com = pin.centerOfMass(robot.full_model, robot.full_model.createData(), full)
        np.testing.assert_allclose(data.subtree_com[1], com, atol=1e-6)  # massless links get 1 mg each


def assert_same_bodies(robot: RobotModel, model: Any) -> None:
    """Compare the bodies that MuJoCo collides with those that FCL does: same links, same kinds."""
    import coal
    import mujoco

    kinds = {coal.Capsule: "CYLINDER", coal.Box: "BOX"}  # MuJoCo takes a capsule's cylinder
    ours: dict[str, list[str]] = {}
    geometry = robot_collision_model(robot)
    for item in geometry.geometry.geometryObjects:
        name = geometry.model.frames[item.parentFrame].name
        ours.setdefault(name, []).append(kinds[type(item.geometry)])
    theirs: dict[str, list[str]] = {}
    for g in range(model.ngeom):
        if model.geom_contype[g]:
            kind = mujoco.mjtGeom(model.geom_type[g]).name.removeprefix("mjGEOM_")
            theirs.setdefault(model.body(model.geom_bodyid[g]).name, []).append(kind)
    assert ours == theirs


def sole_corners_of_bodies(robot: RobotModel, link: str, height_m: float) -> list[tuple[float, float]]:
    """Return the corners of the boxes of a foot's link on their lower side, which is at the height given [m]."""
    collision = robot_collision_model(robot)
    corners = []
    for item in collision.geometry.geometryObjects:
        if collision.model.frames[item.parentFrame].name == link:
            half = np.array(item.geometry.halfSide)
            x, y, z = np.array(item.placement.translation)
            assert abs(z - half[2] + height_m) < 1e-9
            corners += [(float(x + i * half[0]), float(y + j * half[1])) for i in (-1, 1) for j in (-1, 1)]
    return corners
