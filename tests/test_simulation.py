"""The physics: the body is the robot's, the floor carries it, the servos hold it, and a fall is seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from imitor.errors import RobotError, UnknownJoint
from imitor.metrics.polygon import convex_hull, margin
from imitor.record import Motion
from imitor.registry import Registry
from imitor.robot.card import Coupling
from imitor.robot.model import RobotModel
from imitor.simulation.body import LEFT, OTHER, RIGHT, Body, Surroundings
from imitor.simulation.drives import Drives, coupled_groups, holding_torques, make_drives
from imitor.simulation.playback import Trace, play
from imitor.simulation.verdict import FallRule, figures, tilt
from imitor.testing.fixtures import make_robot
from small_humanoid import SmallHumanoid

REGISTRY = Registry(entry_points=False)
ROBOTS = sorted(REGISTRY.cards("robots"))
RATE_HZ = 30.0


def servos(robot: RobotModel, **changes: Any) -> Drives:
    return make_drives(robot, **{"kp_per_effort": 30.0, "kv_per_kp": 0.05, **changes})


def simulated(robot: RobotModel, **changes: Any) -> Body:
    return Body(robot, servos(robot), Surroundings(**changes))


def motion_of(robot: RobotModel, q: np.ndarray) -> Motion:
    """Return configurations (T, nq) as a motion at 30 Hz."""
    frames = len(q)
    return Motion(
        robot.name, np.arange(frames) / RATE_HZ, robot.joint_names, q[:, 7:], q[:, :3], q[:, [6, 3, 4, 5]],
        np.ones((frames, 2), dtype=bool), ["ok"] * frames,
    )  # fmt: skip


def standing(robot: RobotModel, seconds: float = 3.0) -> Motion:
    return motion_of(robot, np.tile(robot.standing, (int(seconds * RATE_HZ) + 1, 1)))


def leaning(robot: RobotModel, degrees: float, seconds: float = 2.0) -> Motion:
    """The robot turns as a stiff whole about its sole's front edge, as a plank would lean."""
    motion = standing(robot, seconds + 2.0)
    q = motion.configurations()
    for i, share in enumerate(np.clip(motion.time_s / seconds, 0.0, 1.0)):
        angle = np.radians(degrees) * share
        q[i, 3:7] = (0.0, np.sin(angle / 2.0), 0.0, np.cos(angle / 2.0))
        q[i, 7:] = lean_joints(robot, angle)
    return motion_of(robot, q)


def lean_joints(robot: RobotModel, angle: float) -> np.ndarray:
    """Return the standing joints with both ankles bent by the lean, as far as they go."""
    q = robot.standing[7:].copy()
    for name in ("left_ankle_pitch_joint", "right_ankle_pitch_joint"):
        i = robot.joint_index(name)
        q[i] = np.clip(q[i] - angle, robot.lower[i], robot.upper[i])
    for name in ("left_hip_pitch_joint", "right_hip_pitch_joint"):
        i = robot.joint_index(name)
        q[i] = np.clip(q[i] - angle, robot.lower[i], robot.upper[i])
    return q


@pytest.fixture(scope="module")
def g1() -> RobotModel:
    return make_robot("unitree_g1")


# ------------------------------------------------------------------ the body


@pytest.mark.parametrize("name", ROBOTS)
def test_masses_and_kinematics_are_those_of_the_robot(name: str) -> None:
    """Compare inertia matrix, CoM and sole corners at a random configuration with those of the kinematic model."""
    import mujoco

    robot = make_robot(name)
    body = Body(robot, servos(robot), Surroundings(armature_per_effort=0.0))
    model, data = body.model, mujoco.MjData(body.model)
    q = robot.standing.copy()
    q[7:] = np.random.default_rng(1).uniform(robot.lower, robot.upper)
    if robot.coupling is not None:
        q[7:] = robot.coupling @ q[7:][robot.coupling.argmax(axis=0)]
    data.qpos[:] = body.qpos(q)
    assert np.array_equal(body.configuration(data.qpos), q)
    mujoco.mj_forward(model, data)
    robot.update(q)
    assert np.allclose(body.sole_corners(data), robot.sole_corners(), atol=1e-9)
    assert np.allclose(data.subtree_com[0], robot.com, atol=1e-5)
    assert model.body_mass.sum() == pytest.approx(robot.mass_kg, rel=1e-5)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    order = [model.joint(n).dofadr[0] for n in robot.joint_names]
    pin.crba(robot.model, robot.data, q, pin.Convention.WORLD)
    expected = np.triu(robot.data.M) + np.triu(robot.data.M, 1).T - np.diag(robot.model.armature)
    # inertias that no body can have are mended: romeo has one, in a shoulder
    tolerance = 2e-2 if name == "romeo" else 1e-5
    assert np.allclose(M[np.ix_(order, order)], expected[6:, 6:], atol=tolerance, rtol=1e-3)


@pytest.mark.parametrize("mjcf", [False, True], ids=["urdf", "mjcf"])
def test_urdf_and_mjcf_stand_alike(tmp_path: Path, mjcf: bool) -> None:
    robot = RobotModel.load(str(SmallHumanoid().write(tmp_path, mjcf=mjcf)), REGISTRY)
    body = simulated(robot)
    trace = play(body, standing(robot, 1.0))
    assert trace.fall is None
    assert np.isclose(trace.force[5:].sum(axis=1).mean(), body.weight_n, rtol=0.02)
    assert bool(body.drives.notes) == mjcf  # the MJCF names no torque limits


def test_each_sole_has_its_corners_and_no_other_part_stands(g1: RobotModel) -> None:
    body = simulated(g1)
    assert [(body.kind == side).sum() for side in (LEFT, RIGHT)] == [4, 4]
    others = [n for n, k in zip(body.geom_names, body.kind, strict=True) if k == OTHER]
    assert "part/left_knee" in others and "part/head" in others
    assert not [n for n in others if "ankle" in n or "foot" in n]


def test_locked_joints_stay(g1: RobotModel) -> None:
    robot = make_robot(locked={"waist_roll_joint": 0.2})
    body = simulated(robot)
    assert "waist_roll_joint" not in [body.model.joint(j).name for j in range(body.model.njnt)]
    assert body.model.body_mass.sum() == pytest.approx(simulated(g1).model.body_mass.sum(), rel=1e-6)


# ------------------------------------------------------------------ the servos


def test_servos_follow_the_torque_limits(g1: RobotModel) -> None:
    drives = servos(g1)
    knee = g1.joint_index("left_knee_joint")
    assert (drives.limit[knee], drives.kp[knee], drives.kv[knee]) == (139.0, 30.0 * 139.0, 1.5 * 139.0)
    assert not drives.notes
    changed = servos(g1, effort={"{side}_knee_joint": 50.0}, kp={"*": 80.0, "left_knee_joint": 90.0})
    assert (changed.limit[knee], changed.kp[knee]) == (50.0, 90.0)
    assert (np.delete(changed.kp, knee) == 80.0).all()


def test_missing_torque_limits_are_estimated_and_said(g1: RobotModel) -> None:
    robot = make_robot()
    robot.model.effortLimit[6 + robot.joint_index("left_knee_joint")] = 0.0
    drives = servos(robot)
    assert drives.notes == ("torque limits estimated from the weight, the model has none: left_knee_joint",)
    ratio = holding_torques(g1) / g1.model.effortLimit[6:]
    assert 0.3 < np.median(ratio) < 3.0  # an estimate: of the size of the real limits


def test_wrong_servo_options_are_refused(g1: RobotModel) -> None:
    with pytest.raises(UnknownJoint, match=r"kp_nm_per_rad.*'knee'"):
        servos(g1, kp={"knee": 1.0})
    with pytest.raises(RobotError, match="effort_nm: every value must be above 0"):
        servos(g1, effort={"*": 0.0})


def test_coupled_joints_move_as_one_and_share_a_motor() -> None:
    names = ["left_hip_yaw_joint", "right_hip_yaw_joint"]
    robot = make_robot(coupled=[Coupling(joints=names, ratios=[1.0, -1.0])])
    first, second = (robot.joint_index(n) for n in names)
    assert coupled_groups(robot) == [(first, {second: -1.0})]
    drives = servos(robot)
    assert drives.limit[first] == drives.limit[second] == 44.0
    q = np.tile(robot.standing, (61, 1))
    q[:, 7 + first] = 0.1 * np.sin(np.linspace(0.0, np.pi, 61))
    q[:, 7 + second] = -q[:, 7 + first]
    trace = play(Body(robot, drives, Surroundings()), motion_of(robot, q))
    assert np.abs(trace.q[:, 7 + first] + trace.q[:, 7 + second]).max() < 2e-3


# ------------------------------------------------------------------ contact


def test_an_unactuated_robot_drops_and_its_parts_stay_on_the_floor(g1: RobotModel) -> None:
    drives = Drives(np.full(g1.n, 1e-6), np.full(g1.n, 1e-6), np.full(g1.n, 1e-6))
    body = Body(g1, drives, Surroundings(armature_per_effort=1e3))
    trace = play(body, standing(g1), settle_s=0.0)
    assert trace.fall is not None and 0.0 < trace.fall.time_s < 1.5
    assert (trace.force[-10:].sum(axis=1) > 0.3 * body.weight_n).all()
    assert trace.q[-1, 2] > -0.02  # the base lies on the floor, not under it
    com = np.empty(len(trace.q))
    for i, q in enumerate(trace.q):
        g1.update(q)
        com[i] = g1.com[2]
    acceleration = np.diff(com, 2) * RATE_HZ**2
    assert (acceleration > -9.81 - 0.1).all()  # the floor only pushes
    assert acceleration[:8].mean() < -3.0  # and at first hardly does


@pytest.mark.parametrize("name", ROBOTS)
def test_standing_robots_stand_with_the_pressure_under_the_com(name: str) -> None:
    robot = make_robot(name)
    body = simulated(robot)
    trace = play(body, standing(robot))
    found = figures(trace, body)
    assert (found["fell"], found["fall_time_s"], found["survived_s"]) == (False, None, 3.0)
    assert found["zmp_inside_share"] == 1.0 and found["airborne_frames"] == 0
    assert np.allclose(trace.force.sum(axis=1), body.weight_n, rtol=0.02)
    for q, zmp in zip(trace.q[30:], trace.zmp[30:], strict=True):
        robot.update(q)
        assert np.linalg.norm(zmp - robot.com[:2]) < 0.005
    assert found["joint_error_rad"]["max"] < 0.03
    assert found["torque_to_limit"]["max"] < 1.0


# ------------------------------------------------------------------ falls


@pytest.mark.parametrize("touch", ["points", "hulls"])
def test_a_lean_of_60_degrees_falls_and_says_when(
    g1: RobotModel, touch: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path))
    body = simulated(g1, touch=touch)
    motion = leaning(g1, 60.0)
    trace = play(body, motion)
    found = figures(trace, body)
    assert found["fell"] and found["fall_reason"]
    assert 0.2 < found["fall_time_s"] <= motion.time_s[-1] and found["survived_s"] == found["fall_time_s"]
    robot_height = trace.q[-1, 2]
    assert robot_height < 0.7 * g1.standing[2]


def test_the_pressure_goes_to_the_edge_before_the_fall(g1: RobotModel) -> None:
    body = simulated(g1)
    found = figures(play(body, leaning(g1, 60.0)), body)
    upright = figures(play(body, standing(g1, 1.0)), body)
    key = "zmp_margin_double_support_m"
    assert found[key]["min"] < 0.01 < upright[key]["min"]


def test_a_fall_is_judged_by_what_the_motion_asks_for() -> None:
    rule = FallRule()
    usual: dict[str, Any] = {
        "height": 0.7,
        "asked_height": 0.75,
        "standing_height": 0.75,
        "tilt": 0.1,
        "asked_tilt": 0.0,
    }
    assert rule.reason(**usual) == ""
    assert rule.reason(**{**usual, "tilt": 1.0}) == "the trunk leans 57 degrees more than the motion asks for"
    assert rule.reason(**{**usual, "tilt": 1.0, "asked_tilt": 0.9}) == ""
    assert rule.reason(**{**usual, "height": 0.4}) == "the base is 0.35 m lower than the motion asks for"
    assert rule.reason(**{**usual, "height": 0.4, "asked_height": 0.4}) == ""
    assert rule.reason(**usual, part="part/left_hand") == "left hand touches the floor"


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2, 3.0])
def test_tilt_ignores_the_heading(angle: float) -> None:
    turn = pin.Quaternion(pin.utils.rotate("z", 0.8) @ pin.utils.rotate("y", angle))
    assert tilt(turn.coeffs()) == pytest.approx(angle, abs=1e-7)


def test_a_diverging_simulation_is_a_fall_not_an_error(
    g1: RobotModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    drives = servos(g1)
    undamped = Drives(np.full(g1.n, 1e12), np.full(g1.n, 1e9), np.full(g1.n, 1e-9))
    trace = play(Body(g1, undamped, Surroundings(step_s=0.01, armature_per_effort=0.0)), standing(g1, 0.5))
    assert trace.fall is not None
    assert np.isfinite(trace.q).all()
    assert not list(tmp_path.iterdir())  # MuJoCo would leave a log of its warnings
    found = figures(trace, Body(g1, drives, Surroundings()))
    json.dumps(found, allow_nan=False)


def test_a_start_out_of_balance_falls_before_the_motion_begins(g1: RobotModel) -> None:
    body = simulated(g1)
    motion = standing(g1, 1.0)
    motion.joint_position_rad[:] = lean_joints(g1, np.radians(40.0))
    found = figures(play(body, motion, settle_s=2.0), body)
    assert (found["fell"], found["fall_time_s"], found["survived_s"]) == (True, 0.0, 0.0)
    assert found["fall_reason"].startswith("before the motion began, ")


def test_one_command_is_a_motion(g1: RobotModel) -> None:
    body = simulated(g1)
    found = figures(play(body, motion_of(g1, g1.standing[None])), body)
    assert (found["fell"], found["survived_s"], found["frames"]) == (False, 0.0, 1)


def test_the_same_motion_gives_the_same_figures(g1: RobotModel) -> None:
    def once() -> tuple[Trace, dict[str, Any]]:
        body = simulated(g1)
        trace = play(body, leaning(g1, 20.0, 0.5))
        found = figures(trace, body)
        del found["real_time_factor"]
        return trace, found

    (one, found), (other, again) = once(), once()
    assert found == again
    assert np.array_equal(one.q, other.q) and np.array_equal(one.zmp, other.zmp, equal_nan=True)


def test_the_heading_and_place_of_the_motion_play_no_part(g1: RobotModel) -> None:
    """Move and turn the whole motion: the robot does the same there."""
    motion = standing(g1, 1.0)
    q = motion.configurations()
    q[:, 7 + g1.joint_index("left_elbow_joint")] += 0.3 * np.sin(motion.time_s)
    here = play(simulated(g1), motion_of(g1, q))
    turned = q.copy()
    turned[:, :2] += (2.0, -1.0)
    turned[:, 3:7] = (0.0, 0.0, np.sin(0.6), np.cos(0.6))
    there = play(simulated(g1), motion_of(g1, turned))
    assert np.allclose(there.q[:, 7:], here.q[:, 7:], atol=1e-3)
    R = pin.utils.rotate("z", 1.2)[:2, :2]
    expected = (here.zmp - q[0, :2]) @ R.T + turned[0, :2]
    assert np.allclose(there.zmp, expected, atol=5e-3)


def test_the_pressure_lies_in_the_polygon(g1: RobotModel) -> None:
    trace = play(simulated(g1), standing(g1, 1.0))
    for zmp, sole in zip(trace.zmp, trace.sole, strict=True):
        hull = convex_hull([(float(x), float(y)) for x, y, _ in sole.reshape(-1, 3)])
        assert margin((float(zmp[0]), float(zmp[1])), hull) > 0.0


@pytest.mark.parametrize(("rate_hz", "step_s"), [(30.0, 1.0 / 510.0), (50.0, 0.002), (120.0, 1.0 / 600.0)])
def test_the_step_fits_the_frames(g1: RobotModel, rate_hz: float, step_s: float) -> None:
    motion = standing(g1, 0.2)
    motion.time_s[:] = 3.0 + np.arange(len(motion)) / rate_hz
    assert play(simulated(g1), motion).step_s == pytest.approx(step_s)


def test_commands_may_come_at_uneven_times(g1: RobotModel) -> None:
    motion = standing(g1, 1.0)
    motion.time_s[1:-1] += np.random.default_rng(0).uniform(-0.01, 0.01, len(motion) - 2)
    trace = play(simulated(g1), motion)
    assert trace.step_s == 0.002 and trace.fall is None
