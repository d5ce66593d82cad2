"""What fcl_collision does with feet, with poses out of reach, and with poses that cannot be mended."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from imitor import Configuration, TaskKind, TaskStack, testing
from imitor.collision import solids
from imitor.collision.distances import Distances
from imitor.collision.shapes import assemble
from imitor.metrics.collision import robot_collision_model
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.safety.guard import Guard
from imitor.types import STATUS

BOTH = np.ones(2, dtype=bool)


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return testing.make_robot("nao_v4")


def stage(robot: RobotModel, environment: Any = (), **options: Any) -> Any:
    cls: Any = Registry(entry_points=False).get("postprocessor", "fcl_collision")
    context = dataclasses.replace(testing.make_context(robot), environment=environment)
    made = cls(cls.config_type(**options), context)
    made.start()
    return made


def both_feet(robot: RobotModel, q: np.ndarray, anchor: str = "left_foot") -> TaskStack:
    """Return tasks with an active CoM and both feet standing where they are."""
    stack = TaskStack(robot.n)
    com = stack.declare("com", TaskKind.COM)
    stack.compile()
    robot.update(q)
    com.mask[:] = (True, True, False)
    stack.anchor, stack.anchor_pose = anchor, robot.pose(anchor)
    stack.contact[:] = True
    return stack


def feet_together(robot: RobotModel, angle: float) -> np.ndarray:
    """Return the standing posture with both hips turned inward and the soles flat [rad]."""
    q = robot.standing.copy()
    for side, sign in (("L", -1.0), ("R", 1.0)):
        q[7 + robot.joint_index(f"{side}HipRoll")] += sign * angle
        q[7 + robot.joint_index(f"{side}AnkleRoll")] -= sign * angle
    assert (q[7:] >= robot.lower).all() and (q[7:] <= robot.upper).all()
    return q


def overlap(robot: RobotModel, q: np.ndarray) -> float:
    return max([d for d, _ in robot_collision_model(robot).collisions(q)], default=0.0)


@pytest.mark.parametrize("slide", [False, True])
def test_standing_feet_that_touch_are_parted_on_the_ground(robot: RobotModel, slide: bool) -> None:
    made, q = stage(robot, slide=slide), feet_together(robot, 0.09)
    stack = both_feet(robot, q)
    assert overlap(robot, q) > 0.001
    before, com = [robot.pose(f"{s}_foot") for s in ("left", "right")], robot.com.copy()
    state = Configuration(q.copy(), BOTH)
    made.step(stack, state)
    assert overlap(robot, state.q) == 0.0
    after = [robot.pose(f"{s}_foot") for s in ("left", "right")]
    np.testing.assert_allclose(after[0], before[0], atol=1e-6)  # the anchor stays
    assert abs(after[1][2, 3] - before[1][2, 3]) < 1e-3  # the other one stays on the ground, and flat
    np.testing.assert_allclose(after[1][:3, 2], before[1][:3, 2], atol=5e-3)
    assert after[1][1, 3] < before[1][1, 3] - 0.001  # and is farther to the right
    np.testing.assert_allclose(robot.com[:2], com[:2], atol=2e-3)


def test_before_feet_are_placed_both_legs_part(robot: RobotModel) -> None:
    made, q = stage(robot, interim=True), feet_together(robot, 0.09)
    stack, before = both_feet(robot, q, anchor="waist"), q.copy()
    state = Configuration(q.copy(), BOTH)
    made.step(stack, state)
    assert overlap(robot, state.q) == 0.0
    np.testing.assert_array_equal(state.q[:7], before[:7])
    moved = np.abs(state.q - before)[7:]
    assert moved[robot.joint_index("LHipRoll")] > 0.001
    assert moved[robot.joint_index("RHipRoll")] > 0.001


def test_a_pose_out_of_reach_is_corrected_where_the_guard_would_send_it(robot: RobotModel) -> None:
    made, guard = stage(robot), Guard(robot, 1.0 / 30.0)
    stack = both_feet(robot, robot.standing)
    state = Configuration(robot.standing.copy(), BOTH)
    guard.apply(stack, state)
    state.sent = state.q.copy()
    rng = np.random.default_rng(0)
    for _ in range(40):
        state.q[7:] = np.clip(state.q[7:] + rng.normal(0.0, 0.6, robot.n), robot.lower, robot.upper)
        if robot.coupling is not None:
            state.q[7:] = robot.coupling @ state.q[7:][robot.coupling.argmax(axis=0)]
        robot.update(state.q)
        robot.place(state.q, "left_foot", stack.anchor_pose)
        made.step(stack, state)
        corrected = state.q.copy()
        np.testing.assert_allclose(
            robot.pose("left_foot"), stack.anchor_pose, atol=1e-9
        )  # legs bend: it stays
        assert overlap(robot, corrected) == 0.0
        guard.apply(stack, state)
        np.testing.assert_allclose(state.q, corrected, atol=1e-9)  # the guard has nothing left to do
        state.sent, state.status = state.q.copy(), 0


def test_what_cannot_be_mended_is_not_sent(robot: RobotModel) -> None:
    robot.update(robot.standing)
    x, y, z = robot.position("chest")
    wall = {"name": "wall", "shape": "box", "size_m": [0.5, 0.5, 0.5], "position_m": [x, y, z]}
    stack = both_feet(robot, robot.standing)
    for hold in (True, False):
        made = stage(robot, [wall], hold=hold)
        q = robot.standing.copy()
        q[7 + robot.joint_index("HeadYaw")] += 0.05
        state = Configuration(q.copy(), BOTH, sent=robot.standing.copy())
        robot.update(q)
        made.step(stack, state)
        assert (STATUS[state.status] == "held") == hold
        assert np.array_equal(state.q, robot.standing) == hold
        assert (made.correction.held, made.correction.left) == ((1, 0) if hold else (0, 1))


def test_the_last_command_again_is_left_alone(robot: RobotModel) -> None:
    q = feet_together(robot, 0.09)
    made, state = stage(robot), Configuration(q.copy(), BOTH, sent=q.copy())
    made.step(both_feet(robot, q), state)
    np.testing.assert_array_equal(state.q, q)


def test_a_guard_that_follows_knows_what_comes_next(robot: RobotModel) -> None:
    ours, theirs = Guard(robot, 0.02), Guard(robot, 0.02)
    stack = both_feet(robot, robot.standing)
    state = Configuration(robot.standing.copy(), BOTH)
    theirs.apply(stack, state)
    rng = np.random.default_rng(1)
    for _ in range(20):
        low, high = ours.follow(state.q)
        state.q[7:] += rng.normal(0.0, 0.3, robot.n)
        theirs.apply(stack, state)
        assert (state.q[7:] >= low - 1e-12).all() and (state.q[7:] <= high + 1e-12).all()


def test_a_long_pole_is_left_on_the_side_where_a_link_came_from() -> None:
    # A box on a slide goes through a long pole; the gap along x has a formula.
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    slide = model.addJoint(base, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    parts = [
        solids.box("link", slide, np.eye(4), np.array([0.1, 0.3, 0.06])),
        solids.cylinder("pole", 0, np.eye(4), 0.05, 2.0),
    ]
    shapes = assemble(parts, np.array([[0, 1]]), np.array([0.0]))
    toy: Any = SimpleNamespace(model=model, data=model.createData())
    distances = Distances(toy, shapes)
    for x in np.linspace(-0.2, 0.04, 40):
        q = np.array([0.0, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0, x])
        pin.forwardKinematics(model, toy.data, q)
        _, d, normals, _ = distances.below(1.0)
        assert d[0] == pytest.approx(-x - 0.1, abs=6e-4)
        np.testing.assert_allclose(normals[0], [-1.0, 0.0, 0.0], atol=0.05)


def test_parallel_faces_are_never_taken_for_farther_apart_than_they_are() -> None:
    # python-fcl's GJK is wrong by up to 27 mm for about one in a thousand pairs of boxes with parallel faces.
    import coal

    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    sides = np.array([0.16, 0.09, 0.03]), np.array([0.10, 0.06, 0.04])
    parts = [solids.box("foot", base, np.eye(4), sides[0]), solids.box("step", 0, np.eye(4), sides[1])]
    toy: Any = SimpleNamespace(model=model, data=model.createData())
    distances = Distances(toy, assemble(parts, np.array([[0, 1]]), np.array([0.0])))
    boxes = [coal.Box(*s) for s in sides]
    rng = np.random.default_rng(0)
    for _ in range(4000):
        turn = pin.exp3(np.array([rng.choice([0.0, 1e-6, 0.02]) * rng.normal(), 0.0, 0.0]))
        q = np.array([0.05 * rng.normal(), rng.uniform(-0.15, 0.15), rng.choice([0.0, 0.005, 0.02 * rng.normal()]),
                      *pin.Quaternion(turn).coeffs()])  # fmt: skip
        pin.forwardKinematics(model, toy.data, q)
        _, d, _, _ = distances.below(1.0)
        exact = coal.distance(
            boxes[0], coal.Transform3s(turn, q[:3]), boxes[1], coal.Transform3s(),
            coal.DistanceRequest(), coal.DistanceResult(),
        )  # fmt: skip
        if exact > 0.001:
            assert exact - 0.03 < d[0] < exact + 0.0031
