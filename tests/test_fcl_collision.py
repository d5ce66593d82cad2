"""Post-processor fcl_collision: distances, their Jacobian, and what a correction keeps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from imitor import Configuration, TaskKind, TaskStack, testing
from imitor.collision import solids
from imitor.collision.distances import Distances
from imitor.collision.shapes import TOLERANCE_M, Shapes, assemble
from imitor.collision.smallest import smallest_motion
from imitor.metrics.collision import robot_collision_model
from imitor.registry import Registry
from imitor.robot.model import RobotModel


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return testing.make_robot()


@pytest.fixture(scope="module")
def made(robot: RobotModel) -> Any:
    cls = Registry(entry_points=False).get("postprocessor", "fcl_collision")
    component = cls(cls.config_type(), testing.make_context(robot))
    component.start()
    return component


def standing_stack(robot: RobotModel) -> TaskStack:
    stack = TaskStack(robot.n)
    stack.declare("com", TaskKind.COM)
    stack.compile()
    robot.update(robot.standing)
    stack.anchor, stack.anchor_pose = "left_foot", robot.pose("left_foot")
    return stack


def arms_into_body(robot: RobotModel, share: float) -> np.ndarray:
    q = robot.standing.copy()
    for side, sign in (("left", -1.0), ("right", 1.0)):
        q[7 + robot.joint_index(f"{side}_shoulder_roll_joint")] += sign * 0.4 * share
    return q


def test_nearest_to_the_wish_within_half_planes_and_box() -> None:
    none, zero = np.zeros((0, 2)), np.zeros(0)
    box = np.full(2, -2.0), np.full(2, 2.0)
    A, b = np.array([[1.0, 1.0]]), np.array([2.0])
    np.testing.assert_allclose(smallest_motion(np.zeros(2), A, b, *box, none, zero), [1.0, 1.0], atol=1e-6)
    tight = np.array([0.5, 2.0])
    np.testing.assert_allclose(
        smallest_motion(np.zeros(2), A, b, box[0], tight, none, zero), [0.5, 1.5], atol=1e-6
    )
    kept = smallest_motion(np.zeros(2), A, b, *box, np.array([[1.0, 0.0]]), np.zeros(1))
    np.testing.assert_allclose(kept, [0.0, 2.0], atol=1e-4)


def test_distances_are_those_of_a_second_engine_within_the_tolerance_and_their_jacobian_with_differences(
    robot: RobotModel, made: Any
) -> None:
    import coal

    correction, rng = made.correction, np.random.default_rng(0)
    geometry = robot_collision_model(robot).geometry
    shapes = correction.separation.distances.shapes
    compared = sloped = checked = 0
    for _ in range(5):
        q = robot.standing.copy()
        q[7:] = np.clip(q[7:] + rng.normal(0.0, 0.4, robot.n), robot.lower, robot.upper)
        robot.update(q)
        correction.separation.distances.reset()
        pairs, d, normals, points = correction.separation.distances.below(0.08)
        J = correction.separation.jacobian(pairs, normals, points)
        for k, pair in enumerate(pairs.tolist()):
            a, b = shapes.pairs[pair].tolist()
            placed = []
            for i in (a, b):
                joint = robot.data.oMi[int(shapes.joint[i])]
                R = joint.rotation @ shapes.rotation[i]
                placed.append(coal.Transform3s(R, joint.rotation @ shapes.translation[i] + joint.translation))
            objects = geometry.geometryObjects
            other = coal.distance(
                objects[a].geometry, placed[0], objects[b].geometry, placed[1],
                coal.DistanceRequest(), coal.DistanceResult(),
            )  # fmt: skip
            # simple shapes contain the full hulls, and depths are never taken for less than they are
            assert d[k] < other + 5e-4
            assert d[k] > other - 2.0 * TOLERANCE_M - 5e-4 or d[k] < 0.0
            compared += 1
        v = rng.normal(size=robot.n)
        ahead = {}
        for sign in (1.0, -1.0):
            moved = q.copy()
            moved[7:] += sign * 1e-4 * v
            robot.update(moved)
            found, value, _, _ = correction.separation.distances.below(0.1)
            ahead[sign] = dict(zip(found.tolist(), value.tolist(), strict=True))
        for k, pair in enumerate(pairs.tolist()):
            if d[k] > 0.01:
                slope = (ahead[1.0][pair] - ahead[-1.0][pair]) / 2e-4
                sloped += 1
                checked += abs(slope - J[k] @ v) < 0.02 * (1.0 + abs(slope))
    assert compared > 20
    assert sloped > 10
    assert checked >= 0.95 * sloped  # a nearest point may change its corner


def toy() -> tuple[Any, Shapes]:
    """Two spheres of 0.1 m on a free base, the second on a slide along x and then on a hinge about z."""
    import pinocchio as pin

    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    slide = model.addJoint(base, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    hinge = model.addJoint(slide, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    place = np.eye(4)
    place[0, 3] = 0.3
    parts = [solids.sphere("a", base, np.eye(4), 0.1), solids.sphere("b", hinge, place, 0.1)]
    shapes = assemble(parts, np.array([[0, 1]]), np.array([0.0]))
    return SimpleNamespace(model=model, data=model.createData()), shapes


def test_two_links_against_the_formula() -> None:
    # python-fcl iterates: found good to 0.06 mm, and normals to 0.03 where links almost touch.
    import pinocchio as pin

    robot, shapes = toy()
    distances, rng, measured = Distances(robot, shapes), np.random.default_rng(1), 0
    for _ in range(200):
        x, angle = rng.uniform(-0.6, 0.6), rng.uniform(-3.0, 3.0)
        turn = pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()
        q = np.array([*rng.normal(size=3), *turn, x, angle])
        pin.forwardKinematics(robot.model, robot.data, q)
        exact = np.hypot(x + 0.3 * np.cos(angle), 0.3 * np.sin(angle)) - 0.2
        pairs, d, normals, _ = distances.below(0.1)
        measured += distances.measured
        assert len(pairs) == (exact < 0.1)
        if len(pairs):
            centres = [
                robot.data.oMi[int(j)].act(p) for j, p in zip(shapes.joint, shapes.centre, strict=True)
            ]
            assert d[0] == pytest.approx(exact, abs=1e-4)
            across = (centres[0] - centres[1]) / (exact + 0.2)
            np.testing.assert_allclose(normals[0], across, atol=0.05)
    assert 0 < measured < 200  # those far apart were not looked at


def test_mujoco_finds_the_same_distances(robot: RobotModel, made: Any) -> None:
    import mujoco

    distances, objects = (
        made.correction.separation.distances,
        robot_collision_model(robot).geometry.geometryObjects,
    )
    robot.update(arms_into_body(robot, 0.7))
    distances.reset()
    pairs, d, _, _ = distances.below(0.03)
    shapes, hulls = distances.shapes, 0
    for pair, ours in zip(pairs.tolist(), d.tolist(), strict=True):
        a, b = shapes.pairs[pair].tolist()
        if not all(hasattr(objects[i].geometry, "num_points") for i in (a, b)):
            continue
        spec = mujoco.MjSpec()
        for i in (a, b):
            shape, joint = objects[i].geometry, robot.data.oMi[int(shapes.joint[i])]
            points = np.array([shape.point(k) for k in range(shape.num_points)]).reshape(-1, 3)
            placed = points @ (joint.rotation @ shapes.rotation[i]).T
            placed += joint.rotation @ shapes.translation[i] + joint.translation
            spec.add_mesh(name=f"m{i}", uservert=placed.astype(np.float32).reshape(-1))
            body = spec.worldbody.add_body(name=f"b{i}")
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"m{i}")
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        theirs = mujoco.mj_geomDistance(model, data, 0, 1, 1.0, np.zeros(6))
        assert theirs - 2.0 * TOLERANCE_M - 1e-3 < ours < theirs + 1e-3
        hulls += 1
    assert hulls > 3


def test_nothing_near_changes_nothing(robot: RobotModel, made: Any) -> None:
    stack = standing_stack(robot)
    made.reset()
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    for _ in range(3):
        made.step(stack, state)
    assert state.q.tobytes() == robot.standing.tobytes()
    assert made.correction.changed == 0


def test_arms_are_kept_off_the_body_and_feet_and_com_stay(robot: RobotModel, made: Any) -> None:
    stack, other = standing_stack(robot), robot_collision_model(robot)
    made.reset()
    collided, last, com = 0, robot.standing, []
    for share in (*np.linspace(0.0, 1.0, 30), *np.linspace(1.0, 0.0, 30), *np.zeros(60)):
        q = arms_into_body(robot, float(share))
        q[7:] = np.clip(q[7:], robot.lower, robot.upper)
        collided += bool(other.collisions(q))
        robot.update(q)
        feet, before = [robot.pose(f"{s}_foot") for s in ("left", "right")], robot.com.copy()
        state = Configuration(q.copy(), np.ones(2, dtype=bool))
        made.step(stack, state)
        for side, pose in zip(("left", "right"), feet, strict=True):
            np.testing.assert_allclose(robot.pose(f"{side}_foot"), pose, atol=1e-6)
        assert (state.q[7:] >= robot.lower).all() and (state.q[7:] <= robot.upper).all()
        assert other.collisions(state.q) == []
        com.append(float(np.abs(robot.com - before).max()))
        assert (np.abs(state.q[7:] - last[7:]) <= robot.speed * made.dt_s).all()
        last = state.q.copy()
    assert collided > 10
    assert made.correction.changed > 10
    assert made.correction.left == 0
    assert max(com) < 0.002
    assert state.q.tobytes() == q.tobytes()


def test_a_fading_correction_at_the_end_of_a_range_does_not_stop_the_pose(
    robot: RobotModel, made: Any
) -> None:
    stack = standing_stack(robot)
    made.reset()
    waist, elbow = (robot.joint_index(name) for name in ("waist_pitch_joint", "left_elbow_joint"))
    sent = robot.standing.copy()
    sent[7 + waist] = robot.lower[waist]
    asked = sent.copy()
    asked[7 + elbow] += 0.01
    offset = np.zeros(robot.n)
    offset[waist] = -0.05  # leads out of the range
    made.correction._offset = offset
    state = Configuration(asked.copy(), np.ones(2, dtype=bool))
    state.sent = sent
    robot.update(asked)
    made.step(stack, state)
    np.testing.assert_allclose(state.q, asked, atol=1e-9)


def test_a_correction_of_standing_legs_leaves_the_anchor_where_it_stands(
    robot: RobotModel, made: Any
) -> None:
    stack = standing_stack(robot)
    made.reset()
    knee, elbow = (robot.joint_index(name) for name in ("left_knee_joint", "left_elbow_joint"))
    sent = robot.standing.copy()
    asked = sent.copy()
    asked[7 + elbow] += 0.5  # quicker than the joint is
    offset = np.zeros(robot.n)
    offset[knee] = 0.05
    made.correction._offset, made.correction._bent = offset, True
    state = Configuration(asked, np.ones(2, dtype=bool))
    state.sent = sent
    robot.update(asked)
    made.step(stack, state)
    assert abs(state.q[7 + knee] - sent[7 + knee]) > 1e-3
    np.testing.assert_allclose(robot.pose("left_foot"), stack.anchor_pose, atol=1e-9)
