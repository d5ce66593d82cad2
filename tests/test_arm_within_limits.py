"""An arm beyond its limits: its segments point as well as they can within the limits, and nothing jumps."""

from __future__ import annotations

import numpy as np
import pytest

from imitor import testing
from imitor.contact.arm_within_limits import ArmWithinLimits
from imitor.contact.local_limits import LocalLimits
from imitor.robot.model import RobotModel
from imitor.types import SIDES, Array

ASIDE = {"ShoulderPitch": -2.72, "ShoulderYaw": 0.21, "ElbowRoll": 1.29, "ElbowYaw": -1.51}
"""Joints of a left arm held aside and a little back with the forearm up, as a person has them [rad]."""
MIRRORED = ("ShoulderYaw", "ElbowRoll", "ElbowYaw")


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return testing.make_robot("romeo")


def arm_of(robot: RobotModel, side: str) -> tuple[ArmWithinLimits, np.ndarray]:
    carry = {s: robot.ancestors(f"{s}_hand")[6:] > 0.0 for s in SIDES}
    joints = carry[side] & ~(carry["left"] & carry["right"])
    return ArmWithinLimits(robot, side, joints), joints


def aside(robot: RobotModel, side: str) -> Array:
    q = robot.standing[7:].copy()
    for name, value in ASIDE.items():
        sign = -1.0 if side == "right" and name in MIRRORED else 1.0
        q[robot.joint_index(f"{side[0].upper()}{name}")] = sign * value
    return q


def places(robot: RobotModel, side: str, joints: Array) -> Array:
    q = robot.standing.copy()
    q[7:] = joints
    robot.update(q)
    return np.stack([robot.position(f"{side}_{end}") for end in ("elbow", "hand")])


@pytest.mark.parametrize("side", SIDES)
def test_an_arm_held_aside_points_as_well_as_it_can(side: str, robot: RobotModel) -> None:
    arm, joints = arm_of(robot, side)
    q = aside(robot, side)
    scaled = LocalLimits(robot.lower, robot.upper, 0.08)(q)
    found = scaled.copy()
    found[joints] = arm(q, scaled)
    assert (found >= robot.lower).all() and (found <= robot.upper).all()
    goal, before, after = (places(robot, side, x) for x in (q, scaled, found))
    off = [np.linalg.norm(at[1] - at[0] - goal[1] + goal[0]) for at in (before, after)]  # hand from elbow
    assert off[0] > 0.2 and off[1] < 0.02
    nearest = min(
        np.linalg.norm(places(robot, side, shoulder_at(robot, side, pitch, yaw))[0] - goal[0])
        for pitch in np.linspace(0.0, 1.0, 21)
        for yaw in np.linspace(0.0, 1.0, 21)
    )
    assert np.linalg.norm(after[0] - goal[0]) < nearest + 0.003


def shoulder_at(robot: RobotModel, side: str, pitch: float, yaw: float) -> Array:
    """Return joints with those of the shoulder at shares of their ranges."""
    joints = robot.standing[7:].copy()
    for name, share in (("ShoulderPitch", pitch), ("ShoulderYaw", yaw)):
        j = robot.joint_index(f"{side[0].upper()}{name}")
        joints[j] = robot.lower[j] + share * (robot.upper[j] - robot.lower[j])
    return joints


def test_within_the_limits_nothing_is_changed(robot: RobotModel) -> None:
    arm, joints = arm_of(robot, "left")
    scale = LocalLimits(robot.lower, robot.upper, 0.08)
    for share in np.linspace(0.0, 1.0, 21):
        q = robot.lower + share * (robot.upper - robot.lower)
        assert np.array_equal(arm(q, scale(q)), scale(q)[joints])


@pytest.mark.parametrize("side", SIDES)
def test_on_the_way_there_and_back_nothing_jumps(side: str, robot: RobotModel) -> None:
    arm, _ = arm_of(robot, side)
    scale = LocalLimits(robot.lower, robot.upper, 0.08)
    first, last = robot.standing[7:], aside(robot, side)
    n = 300
    shares = np.concatenate([np.linspace(0.0, 1.0, n), np.linspace(1.0, 0.0, n)])
    path = np.array([arm(q, scale(q)) for q in (first + s * (last - first) for s in shares)])
    given_step = np.abs(last - first).max() / n
    assert np.abs(np.diff(path, axis=0)).max() < 10.0 * given_step


def test_any_joints_give_joints_within_the_limits(robot: RobotModel) -> None:
    arm, joints = arm_of(robot, "right")
    scale = LocalLimits(robot.lower, robot.upper, 0.08)
    for q in np.random.default_rng(0).uniform(-6.0, 6.0, size=(200, robot.n)):
        found = arm(q, scale(q))
        assert np.isfinite(found).all()
        assert (found >= robot.lower[joints]).all() and (found <= robot.upper[joints]).all()
