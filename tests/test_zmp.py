"""The ZMP of the whole body: closed forms, and the centre of pressure that a simulated floor measures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from imitor.kinds import RunInfo
from imitor.metrics.balance import GRAVITY
from imitor.metrics.zmp import Momentum, velocities
from imitor.pipeline import Pipeline
from imitor.record import Motion, Recorder
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.simulation.body import Body, Surroundings
from imitor.simulation.drives import make_drives
from imitor.simulation.playback import Trace, play
from imitor.spec import load_pipeline
from imitor.testing.fixtures import make_robot

PERIOD_S = 0.01


def executed(robot: RobotModel, motion: Motion) -> Trace:
    drives = make_drives(robot, kp_per_effort=30.0, kv_per_kp=0.05)
    return play(Body(robot, drives, Surroundings()), motion)


def as_motion(robot: RobotModel, q: np.ndarray) -> Motion:
    time_s = np.asarray(np.arange(len(q)) * PERIOD_S, dtype=np.float64)
    return Motion(
        robot.name, time_s, robot.joint_names, q[:, 7:], q[:, :3], q[:, [6, 3, 4, 5]],
        np.ones((len(q), 2), dtype=bool), ["ok"] * len(q),
    )  # fmt: skip


def apart(robot: RobotModel, trace: Trace) -> np.ndarray:
    """Return the ZMP by momentum less the measured one, shape (T - 1, 2) [m]."""
    return np.asarray(Momentum.of(robot, trace.q, trace.v).zmp(PERIOD_S) - trace.zmp[1:])


@pytest.fixture(scope="module")
def g1() -> RobotModel:
    return make_robot("unitree_g1")


def test_a_sway_without_turning_is_the_cart_table(g1: RobotModel) -> None:
    t = np.arange(200) * PERIOD_S
    q = np.tile(g1.standing, (len(t), 1))
    q[:, 0] += 0.05 * np.sin(2.0 * np.pi * t)
    g1.update(g1.standing)
    com = g1.com.copy()
    sway = 0.05 * (1.0 + com[2] / GRAVITY * (2.0 * np.pi) ** 2) * np.sin(2.0 * np.pi * (t[:-2] + PERIOD_S))
    found = Momentum.of(g1, q, velocities(g1, q, PERIOD_S)).zmp(PERIOD_S, 2)
    np.testing.assert_allclose(found[1:-1, 0], com[0] + sway[1:-1], atol=1e-3)
    np.testing.assert_allclose(found[:, 1], com[1], atol=1e-9)


def test_a_turn_on_the_spot_moves_it_by_the_change_of_angular_momentum(g1: RobotModel) -> None:
    """The whole robot pitches about its CoM: the CoM stays, and p_x = c_x - L_y' / (m g)."""
    t = np.arange(100) * PERIOD_S
    q = np.tile(g1.standing, (len(t), 1))
    g1.update(g1.standing)
    com, angle = g1.com.copy(), 0.5 * t**2  # evenly faster: 1 rad/s^2
    arm = g1.standing[:3] - com
    for k, a in enumerate(angle):
        c, s = np.cos(a), np.sin(a)
        q[k, :3] = com + np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ arm
        q[k, 3:7] = (0.0, np.sin(a / 2.0), 0.0, np.cos(a / 2.0))
    data = g1.model.createData()
    pin.ccrba(g1.model, data, g1.standing, np.zeros(g1.nv))
    L_rate = float(data.Ig.inertia[1, 1])
    found = Momentum.of(g1, q, velocities(g1, q, PERIOD_S)).zmp(PERIOD_S)[5:40]
    np.testing.assert_allclose(found[:, 0], com[0] - L_rate / (g1.mass_kg * GRAVITY), atol=2e-3)


@pytest.mark.parametrize("name", ["unitree_g1", "nao_v4", "hrp2"])
def test_the_floor_measures_what_the_momentum_says(name: str) -> None:
    robot = make_robot(name)
    t = np.arange(150) * PERIOD_S
    q = np.tile(robot.standing, (len(t), 1))
    carried = robot.ancestors("left_hand")[6:].astype(bool) & ~robot.ancestors("chest")[6:].astype(bool)
    joint = int(np.flatnonzero(carried)[0])
    q[:, 7 + joint] += 0.3 * np.sin(4.0 * np.pi * t)
    trace = executed(robot, as_motion(robot, q))
    assert trace.fall is None
    assert np.ptp(trace.zmp[20:, 0]) > 0.004  # there is something to agree about
    off = apart(robot, trace)[20:]
    assert np.abs(off).max() < 0.04 * np.ptp(trace.zmp[20:, 0]), np.abs(off).max()


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.3, 0.6, 1.0, 1.4, 2.0])
def test_both_agree_while_a_hand_moves_ever_faster(speed: float) -> None:
    """The hand of montecillo_2010, figure 6; from about 1 m/s on the feet rock, and forces come in blows."""
    registry = Registry(entry_points=False)
    sets = ["source.scenario=hand_updown", f"source.hand_speed_m_s={speed}"]
    pipeline = Pipeline(load_pipeline("montecillo_2010", registry, sets=sets), registry)
    robot = pipeline.robot
    recorder = Recorder(
        RunInfo(Path(), robot, pipeline.skeleton, pipeline.rate_hz, pipeline.stack, pipeline.n_frames, ())
    )
    for record in pipeline.records():
        recorder.add(record)
    trace = executed(robot, recorder.motion())
    assert trace.fall is None
    weight = robot.mass_kg * GRAVITY
    feet = trace.force[1:, :2]
    loaded = (feet > 0.01 * weight).all(axis=1) & (feet.sum(axis=1) > 0.5 * weight)
    off = np.linalg.norm(apart(robot, trace)[loaded], axis=1)
    assert loaded.sum() > 500
    assert np.sqrt(np.mean(off**2)) < (1e-4 if speed < 0.9 else 4e-3)
