"""The robot model: roles, anchoring, sizes, coupling, limits, locked joints, URDF and MJCF, and MuJoCo as oracle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.errors import RobotError, SpecError, UnknownJoint, UnknownLink
from imitor.registry import Registry
from imitor.robot.model import DEFAULT_SPEED, RobotModel
from imitor.testing import make_robot
from imitor.types import SEGMENTS
from small_humanoid import ANKLE, FOREARM, HAND, HIP, SHANK, SHOULDER, SOLE, THIGH, UPPER_ARM, SmallHumanoid

ROBOTS = ("unitree_g1", "romeo", "talos")
SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return make_robot(request.param)


@pytest.fixture
def humanoid() -> SmallHumanoid:
    return SmallHumanoid()


def small(tmp_path: Path, humanoid: SmallHumanoid, *, mjcf: bool = False) -> RobotModel:
    return RobotModel.load(str(humanoid.write(tmp_path, mjcf=mjcf)), Registry(entry_points=False))


def random_configuration(robot: RobotModel, rng: np.random.Generator) -> np.ndarray:
    q = robot.standing.copy()
    q[:3] = rng.normal(size=3)
    q[3:7] = rng.normal(size=4)
    q[3:7] /= np.linalg.norm(q[3:7])
    q[7:] = rng.uniform(robot.lower, robot.upper)
    return q


def test_frames_may_be_updated_alone(robot: RobotModel) -> None:
    rng = np.random.default_rng(3)
    q, roles = random_configuration(robot, rng), ("left_hand", "right_foot")
    robot.update(q)
    there = [robot.pose(role) for role in roles]
    jacobian = robot.jacobian.copy()
    robot.update(robot.standing)
    robot.update_frames(q, [robot.frame_id(role) for role in roles])
    np.testing.assert_allclose([robot.pose(role) for role in roles], there, atol=1e-12)
    np.testing.assert_allclose(robot.jacobian, jacobian, atol=1e-12)
    robot.update(robot.standing)


# ---------------------------------------------------------------- standing and roles


def test_it_stands_on_the_floor(robot: RobotModel) -> None:
    robot.update(robot.standing)
    corners = robot.sole_corners()
    assert corners[..., 2].min() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(corners[..., 2]) < 2e-3
    assert (robot.standing[7:] >= robot.lower).all() and (robot.standing[7:] <= robot.upper).all()
    for role in ("left_foot", "right_foot"):
        np.testing.assert_allclose(robot.rotation(role), np.eye(3), atol=2e-2)
        assert robot.position(role)[2] == pytest.approx(0.0, abs=2e-3)


def test_roles_are_upright_when_all_joints_are_zero(robot: RobotModel) -> None:
    q = robot.standing.copy()
    q[7:] = 0.0
    robot.update(q)
    for role in robot.roles:
        np.testing.assert_allclose(robot.rotation(role), np.eye(3), atol=1e-9)


def test_middles_are_middles_when_all_joints_are_zero(robot: RobotModel) -> None:
    q = robot.standing.copy()
    q[7:] = 0.0
    robot.update(q)
    for joint in ("hip", "shoulder"):
        middle = 0.5 * (robot.position(f"left_{joint}") + robot.position(f"right_{joint}"))
        np.testing.assert_allclose(robot.position(f"mid_{joint}"), middle, atol=1e-9)


def test_lengths_are_those_of_the_drawing(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    lengths = small(tmp_path, humanoid).segment_lengths()
    for side in ("left", "right"):
        assert lengths[f"{side}_thigh"] == pytest.approx(THIGH)
        assert lengths[f"{side}_shank"] == pytest.approx(SHANK)
        assert lengths[f"{side}_upper_arm"] == pytest.approx(UPPER_ARM)
        assert lengths[f"{side}_forearm"] == pytest.approx(FOREARM)
        assert lengths[f"{side}_hand"] == pytest.approx(HAND)
    assert lengths["hips"] == pytest.approx(2 * HIP[0])
    assert lengths["shoulders"] == pytest.approx(2 * SHOULDER[0])
    assert lengths["torso"] == pytest.approx(SHOULDER[1] - HIP[1])
    assert lengths["ankle_height"] == pytest.approx(ANKLE)


def test_soles_are_mirrored(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    robot = small(tmp_path, humanoid)
    left, right = robot.sole_corners()
    np.testing.assert_allclose(left[:, :2] - [0.0, HIP[0]], SOLE, atol=1e-12)
    np.testing.assert_allclose(right * [1, -1, 1], left, atol=1e-12)


def test_the_neutral_height_is_that_of_the_legs(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    robot = small(tmp_path, humanoid)
    assert robot.standing[2] == pytest.approx(THIGH + SHANK + ANKLE - HIP[1])
    assert robot.mass_kg == pytest.approx(sum(link.mass for link in humanoid.links))


# ---------------------------------------------------------------- placing


@given(seed=SEEDS, role=st.sampled_from(["left_foot", "right_foot", "waist", "head", "left_hand"]))
@settings(max_examples=40, deadline=None)
def test_placing_puts_the_frame_exactly(robot: RobotModel, seed: int, role: str) -> None:
    rng = np.random.default_rng(seed)
    q = random_configuration(robot, rng)
    robot.update(random_configuration(robot, rng))
    pose = robot.pose(role)
    robot.update(q)
    joints = q[7:].copy()
    robot.place(q, role, pose)
    np.testing.assert_allclose(robot.pose(role), pose, atol=1e-12)
    np.testing.assert_array_equal(q[7:], joints)
    robot.update(q)
    np.testing.assert_allclose(robot.pose(role), pose, atol=1e-12)


def test_placing_ten_thousand_times_keeps_a_unit_quaternion(robot: RobotModel) -> None:
    rng = np.random.default_rng(0)
    q = robot.standing.copy()
    robot.update(q)
    feet = [robot.pose("left_foot"), robot.pose("right_foot")]
    for k in range(10_000):
        q[7:] = np.clip(q[7:] + 0.01 * rng.normal(size=robot.n), robot.lower, robot.upper)
        robot.update(q)
        robot.place(q, ("left_foot", "right_foot")[k % 2], feet[k % 2])
        assert abs(np.linalg.norm(q[3:7]) - 1) < 1e-12
    np.testing.assert_allclose(robot.pose("right_foot"), feet[1], atol=1e-12)


def test_a_role_that_is_not_there_is_named(robot: RobotModel) -> None:
    with pytest.raises(
        RobotError, match=rf"robot '{robot.name}' has no frame for the role 'tail'; its card names: "
    ):
        robot.position("tail")
    with pytest.raises(RobotError, match="has no frame for the role"):
        robot.ancestors("tail")


# ---------------------------------------------------------------- the manifold


@given(seed=SEEDS, share=st.floats(0, 1))
@settings(max_examples=40, deadline=None)
def test_integrate_difference_and_interpolate_agree(robot: RobotModel, seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    a, v = random_configuration(robot, rng), 0.5 * rng.normal(size=robot.nv)
    b = robot.integrate(a, v)
    np.testing.assert_allclose(robot.difference(a, b), v, atol=1e-9)
    half = robot.interpolate(a, b, share)
    np.testing.assert_allclose(robot.difference(a, half), share * v, atol=1e-8)
    np.testing.assert_allclose(robot.interpolate(a, b, 0.0), a, atol=1e-12)


def test_com_jacobian_is_the_derivative(robot: RobotModel) -> None:
    rng = np.random.default_rng(1)
    q, v, h = random_configuration(robot, rng), rng.normal(size=robot.nv), 1e-6
    robot.update(robot.integrate(q, h * v))
    ahead = robot.com.copy()
    robot.update(robot.integrate(q, -h * v))
    behind = robot.com.copy()
    robot.update(q)
    np.testing.assert_allclose(robot.com_jacobian @ v, (ahead - behind) / (2 * h), atol=1e-6)


def test_ancestors_are_the_joints_that_move_a_frame(robot: RobotModel) -> None:
    rng = np.random.default_rng(2)
    q = random_configuration(robot, rng)
    for role in ("left_foot", "head", "right_hand"):
        mask = robot.ancestors(role)
        assert mask[:6].all()
        for i in range(robot.n):
            v = np.zeros(robot.nv)
            v[6 + i] = 0.1
            robot.update(q)
            before = robot.pose(role)
            robot.update(robot.integrate(q, v))
            assert (np.abs(robot.pose(role) - before).max() > 1e-9) == bool(mask[6 + i])


# ---------------------------------------------------------------- other sizes


@given(
    factor=st.floats(0.5, 2.0),
    segment=st.sampled_from(["left_thigh", "right_shank", "left_upper_arm", "right_forearm"]),
)
@settings(max_examples=25, deadline=None)
def test_a_segment_takes_the_length_asked_for(robot: RobotModel, factor: float, segment: str) -> None:
    before = robot.segment_lengths()
    after = robot.scaled({segment: factor}).segment_lengths()
    assert after[segment] == pytest.approx(factor * before[segment], rel=1e-6)
    for name in SEGMENTS:
        if name != segment:
            assert after[name] == pytest.approx(before[name], rel=1e-6), name


def test_everything_grows_together(robot: RobotModel) -> None:
    big = robot.scaled({"*": 2.0})
    before, after = robot.segment_lengths(), big.segment_lengths()
    for name in SEGMENTS:
        assert after[name] == pytest.approx(2 * before[name], rel=1e-2), name
    assert (big.n, big.joint_names) == (robot.n, robot.joint_names)
    big.update(big.standing)
    assert big.sole_corners()[..., 2].min() == pytest.approx(0.0, abs=1e-12)


def test_growth_zero_is_the_robot_and_one_the_scaled(robot: RobotModel) -> None:
    grown = robot.scaled({"*": 1.4, "left_forearm": 0.7})
    rng = np.random.default_rng(3)
    q = random_configuration(robot, rng)
    full = {}
    grown.update(q)
    full = {role: grown.pose(role) for role in robot.roles}
    grown.set_scale(0.0)
    grown.update(q)
    robot.update(q)
    for role in robot.roles:
        np.testing.assert_allclose(grown.pose(role), robot.pose(role), atol=1e-12)
    grown.set_scale(1.0)
    grown.update(q)
    for role in robot.roles:
        np.testing.assert_allclose(grown.pose(role), full[role], atol=1e-12)
    grown.set_scale(0.5)
    lengths, start = grown.segment_lengths(), robot.segment_lengths()
    assert lengths["left_forearm"] == pytest.approx(0.85 * start["left_forearm"], rel=1e-6)


def test_scaling_leaves_the_robot_alone(robot: RobotModel) -> None:
    before = robot.segment_lengths()
    other = robot.scaled({"*": 1.5})
    other.set_scale(0.3)
    assert robot.segment_lengths() == before
    robot.update(robot.standing)
    com = robot.com.copy()
    other.update(other.standing)
    np.testing.assert_array_equal(robot.com, com)


def test_a_segment_that_is_none_is_refused(robot: RobotModel) -> None:
    with pytest.raises(RobotError, match="has no segment tail to scale; segments: hips"):
        robot.scaled({"tail": 2.0})


# ---------------------------------------------------------------- coupling


def coupled(tmp_path: Path, humanoid: SmallHumanoid, ratios: list[float]) -> RobotModel:
    humanoid.card["coupled"] = [{"joints": ["left_hip_roll", "right_hip_roll"], "ratios": ratios}]
    humanoid.link("left_hip_carrier").range = (-0.3, 0.6)
    humanoid.link("right_hip_carrier").range = (-0.5, 0.4)
    humanoid.link("right_hip_carrier").speed = 2.0
    return small(tmp_path, humanoid)


@pytest.mark.parametrize("ratio", [1.0, -1.0, 0.5, -2.0])
def test_the_range_of_coupled_joints_is_the_intersection(
    tmp_path: Path, humanoid: SmallHumanoid, ratio: float
) -> None:
    robot = coupled(tmp_path, humanoid, [1.0, ratio])
    a, b = robot.joint_index("left_hip_roll"), robot.joint_index("right_hip_roll")
    low, high = sorted((-0.5 / ratio, 0.4 / ratio))
    assert robot.lower[a] == pytest.approx(max(-0.3, low))
    assert robot.upper[a] == pytest.approx(min(0.6, high))
    expected = sorted((robot.lower[a] * ratio, robot.upper[a] * ratio))
    np.testing.assert_allclose(expected, [robot.lower[b], robot.upper[b]])
    assert robot.speed[a] == pytest.approx(min(8.0, 2.0 / abs(ratio)))
    assert robot.speed[b] == pytest.approx(robot.speed[a] * abs(ratio))
    assert robot.acceleration[b] == pytest.approx(robot.acceleration[a] * abs(ratio))
    S = robot.coupling
    assert S is not None and S.shape == (robot.n, robot.n - 1)
    u = np.random.default_rng(0).uniform(-1, 1, robot.n - 1)
    v = S @ u
    assert v[b] == pytest.approx(ratio * v[a])
    others = [i for i in range(robot.n) if i not in (a, b)]
    np.testing.assert_array_equal(S[others].sum(axis=1), 1.0)


def test_joint_values_respect_coupling_and_limits(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    robot = coupled(tmp_path, humanoid, [1.0, 1.0])
    values = robot.joint_values({"left_hip_roll": 0.35, "right_hip_roll": -0.1, "left_knee": 99.0})
    assert values[robot.joint_index("right_hip_roll")] == values[robot.joint_index("left_hip_roll")] == 0.35
    assert values[robot.joint_index("left_knee")] == 2.3


def test_no_range_left_is_said(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    humanoid.card["limits"] = {"position_rad": {"left_knee": [-0.5, -0.1]}}
    with pytest.raises(RobotError, match="no range left between lower and upper limit of left_knee"):
        small(tmp_path, humanoid)


def test_coupled_joints_without_a_common_range_are_refused(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    humanoid.card["coupled"] = [{"joints": ["left_hip_roll", "right_hip_roll"]}]
    humanoid.link("left_hip_carrier").range = (0.1, 0.6)
    humanoid.link("right_hip_carrier").range = (-0.5, -0.1)
    with pytest.raises(RobotError, match="hip_roll"):
        small(tmp_path, humanoid)


# ---------------------------------------------------------------- limits


def test_limits_of_the_card_narrow_those_of_the_model(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    humanoid.card["limits"] = {
        "position_rad": {"{side}_knee": [0.2, 1.5], "waist_yaw": [-9.0, 9.0]},
        "speed_rad_s": {"*": 5.0, "left_knee": 3.0, "right_knee": 99.0},
        "acceleration_rad_s2": {"left_knee": 40.0},
    }
    robot = small(tmp_path, humanoid)
    left, right = robot.joint_index("left_knee"), robot.joint_index("right_knee")
    waist = robot.joint_index("waist_yaw")
    assert (robot.lower[left], robot.upper[left]) == (robot.lower[right], robot.upper[right]) == (0.2, 1.5)
    assert (robot.lower[waist], robot.upper[waist]) == (-2.5, 2.5)
    assert (robot.speed[left], robot.speed[right], robot.speed[waist]) == (3.0, 8.0, 5.0)
    assert robot.acceleration[left] == 40.0
    assert np.isinf(robot.acceleration[right])


def test_a_model_without_speeds_gets_a_default(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    robot = small(tmp_path, humanoid, mjcf=True)
    assert (robot.speed == DEFAULT_SPEED).all()


# ---------------------------------------------------------------- names


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"roles": {"waist": "pelvsi"}},
            "roles.waist: robot 'small' has no link or joint 'pelvsi'; did you mean 'pelvis'?",
        ),
        (
            {"soles": {"frame": "{side}_fot", "polygon_m": [[0, 0], [1, 0], [1, 1]]}},
            "soles.frame: robot 'small' has no link or joint 'left_fot'; did you mean 'left_foot'?",
        ),
        (
            {"standing": {"left_kne": 0.1}},
            "standing: robot 'small' has no link or joint 'left_kne'; did you mean 'left_knee'?",
        ),
        (
            {"limits": {"speed_rad_s": {"waist_jaw": 1.0}}},
            "limits.speed_rad_s: robot 'small' has no link or joint 'waist_jaw'; did you mean 'waist_yaw'?",
        ),
        (
            {"locked": {"left_elbw": 0.0}},
            "locked: robot 'small' has no link or joint 'left_elbw'; did you mean 'left_elbow'?",
        ),
        (
            {"coupled": [{"joints": ["left_knee", "rigth_knee"]}]},
            "coupled: robot 'small' has no link or joint 'rigth_knee'; did you mean 'right_knee'?",
        ),
    ],
)
def test_a_wrong_name_is_told_with_a_suggestion(
    tmp_path: Path, humanoid: SmallHumanoid, change: dict[str, Any], said: str
) -> None:
    humanoid.card.update(change)
    with pytest.raises(UnknownLink) as caught:
        small(tmp_path, humanoid)
    assert str(caught.value).startswith(said)
    assert "names: imitor robot check small)" in str(caught.value)
    assert caught.value.exit_status == 2


def test_unknown_joints_and_links_are_two_things(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    robot = small(tmp_path, humanoid)
    with pytest.raises(UnknownJoint):
        robot.joint_index("nose")
    assert issubclass(UnknownJoint, UnknownLink)


def test_a_card_that_is_missing_or_unknown() -> None:
    with pytest.raises(SpecError, match="did you mean 'romeo'"):
        make_robot("romoe")
    with pytest.raises(SpecError, match="there is no such robot card file"):
        make_robot("no/such/card.yaml")


def test_a_missing_or_damaged_model_is_told(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    path = humanoid.write(tmp_path)
    (tmp_path / "small.urdf").write_text("<robot name='x'><link")
    with pytest.raises(RobotError, match=r"robot 'small': .*small.urdf cannot be read as a robot"):
        make_robot(str(path))
    (tmp_path / "small.urdf").unlink()
    with pytest.raises(RobotError, match=r"robot 'small': there is no model file .*small.urdf"):
        make_robot(str(path))


# ---------------------------------------------------------------- locked joints


def test_locked_joints_stay_where_the_card_says(tmp_path: Path, humanoid: SmallHumanoid) -> None:
    free = small(tmp_path, humanoid)
    humanoid.card["locked"] = {"{side}_elbow": [-0.7, -0.2], "waist_yaw": 0.3}
    robot = small(tmp_path, humanoid)
    assert robot.n == free.n - 3
    assert robot.locked == {"left_elbow": -0.7, "right_elbow": -0.2, "waist_yaw": 0.3}
    q = free.standing.copy()
    rng = np.random.default_rng(0)
    joints = dict(zip(free.joint_names, rng.uniform(free.lower, free.upper), strict=True)) | robot.locked
    q[7:] = [joints[n] for n in free.joint_names]
    mine = robot.standing.copy()
    mine[:3], mine[7:] = q[:3], [joints[n] for n in robot.joint_names]
    free.update(q)
    robot.update(mine)
    for role in ("left_foot", "left_hand", "right_hand", "head"):
        np.testing.assert_allclose(robot.position(role), free.position(role), atol=1e-12)
    np.testing.assert_allclose(robot.com, free.com, atol=1e-12)


# ---------------------------------------------------------------- URDF, MJCF, MuJoCo


def test_urdf_and_mjcf_are_one_robot(tmp_path: Path) -> None:
    folders = [tmp_path / "urdf", tmp_path / "mjcf"]
    for folder in folders:
        folder.mkdir()
    one, other = small(folders[0], SmallHumanoid()), small(folders[1], SmallHumanoid(), mjcf=True)
    assert sorted(one.joint_names) == sorted(other.joint_names)
    index = [one.joint_names.index(n) for n in other.joint_names]
    np.testing.assert_allclose(one.lower[index], other.lower)
    np.testing.assert_allclose(one.upper[index], other.upper)
    assert one.mass_kg == pytest.approx(other.mass_kg)
    np.testing.assert_allclose(one.standing[:7], other.standing[:7], atol=1e-12)
    rng = np.random.default_rng(5)
    for _ in range(20):
        a = random_configuration(one, rng)
        b = a.copy()
        b[7:] = a[7:][index]
        one.update(a)
        other.update(b)
        for role in one.roles:
            np.testing.assert_allclose(one.pose(role), other.pose(role), atol=1e-9)
        np.testing.assert_allclose(one.com, other.com, atol=1e-9)
    assert one.segment_lengths() == pytest.approx(other.segment_lengths())


@pytest.mark.parametrize("mjcf", [False, True])
def test_mujoco_agrees_about_places_and_com(tmp_path: Path, *, mjcf: bool) -> None:
    import mujoco

    humanoid = SmallHumanoid()
    for part in humanoid.links:
        part.mass = part.mass or 1e-3  # MuJoCo moves no body without mass
    robot = small(tmp_path, humanoid, mjcf=mjcf)
    model = mujoco.MjModel.from_xml_string(humanoid.mjcf())
    data = mujoco.MjData(model)
    bodies = {"chest": "chest", "head": "head"}
    sided = {"knee": "shank", "ankle": "foot", "elbow": "forearm", "wrist": "wrist", "hand": "hand"}
    for role, link in sided.items():
        bodies |= {f"{side}_{role}": f"{side}_{link}" for side in ("left", "right")}
    rng = np.random.default_rng(6)
    for _ in range(20):
        q = random_configuration(robot, rng)
        data.qpos[:3], data.qpos[3:7] = q[:3], q[[6, 3, 4, 5]]
        for name, value in zip(robot.joint_names, q[7:], strict=True):
            data.joint(name).qpos[0] = value
        mujoco.mj_forward(model, data)
        robot.update(q)
        for role, body in bodies.items():
            np.testing.assert_allclose(robot.position(role), data.body(body).xpos, atol=1e-9)
            np.testing.assert_allclose(robot.rotation(role), data.body(body).xmat.reshape(3, 3), atol=1e-9)
        np.testing.assert_allclose(robot.com, data.subtree_com[1], atol=1e-9)


def test_mujoco_agrees_about_a_real_robot(tmp_path: Path) -> None:
    """The URDF without its meshes, read by MuJoCo; fixed joints kept as bodies."""
    import xml.etree.ElementTree as ET

    import mujoco

    robot = make_robot("unitree_g1")
    root = ET.parse(robot.files.model).getroot()
    for element in root.iter("link"):
        for shape in [*element.findall("visual"), *element.findall("collision")]:
            element.remove(shape)
    compiler = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
    compiler.set("fusestatic", "false")
    path = tmp_path / "g1.urdf"
    ET.ElementTree(root).write(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(7)
    for _ in range(10):
        q = robot.standing.copy()
        q[7:] = rng.uniform(robot.lower, robot.upper)
        for name, value in zip(robot.joint_names, q[7:], strict=True):
            data.joint(name).qpos[0] = value
        mujoco.mj_forward(model, data)
        robot.update(q)
        root_at = data.body("pelvis").xpos
        for role, link in robot.card.sided_roles().items():
            there = robot.position(role) - q[:3]
            np.testing.assert_allclose(there, data.body(link).xpos - root_at, atol=1e-6, err_msg=role)
