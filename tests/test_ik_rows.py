"""Task rows against finite differences on real robots, with and without an anchor."""

from __future__ import annotations

import numpy as np
import pytest

from imitor.ik.rows import TaskRows
from imitor.robot.model import RobotModel
from imitor.tasks import TaskKind, TaskStack

ROBOTS = ("unitree_g1", "romeo", "talos")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return RobotModel.load(request.param)


def make_stack(robot: RobotModel) -> TaskStack:
    stack = TaskStack(robot.n)
    stack.declare("left_foot", TaskKind.POSE, frame="left_foot")
    stack.declare("right_foot", TaskKind.POSE, frame="right_foot")
    stack.declare("left_hand", TaskKind.POSITION, frame="left_hand")
    stack.declare("reach", TaskKind.POSITION, frame="right_hand", relative_to="chest")
    stack.declare("grasp", TaskKind.POSE, frame="right_hand", relative_to="waist")
    stack.declare("left_forearm", TaskKind.DIRECTION, frame="left_wrist", relative_to="left_elbow")
    stack.declare("torso", TaskKind.DIRECTION, frame="mid_shoulder", relative_to="mid_hip")
    stack.declare("right_thigh", TaskKind.DIRECTION, frame="right_knee", relative_to="right_hip")
    stack.declare("chest", TaskKind.ORIENTATION, frame="chest")
    stack.declare("waist_vector", TaskKind.VECTOR, frame="waist")
    stack.declare("com", TaskKind.COM)
    stack.compile()
    return stack


def random_state(robot: RobotModel, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = robot.standing.copy()
    q[7:] = robot.lower + (robot.upper - robot.lower) * rng.uniform(0.2, 0.8, robot.n)
    v = np.zeros(robot.nv)
    v[:6] = rng.normal(size=6) * 0.5
    return robot.integrate(q, v)


def set_targets(robot: RobotModel, stack: TaskStack, q: np.ndarray, shift: float, seed: int) -> None:
    """Targets a little off from where the robot is at q."""
    import pinocchio as pin

    rng = np.random.default_rng(seed)
    robot.update(q)
    for task in stack:
        turn = pin.exp3(shift * rng.normal(size=3))
        if task.kind is TaskKind.COM:
            task.target[:] = robot.com + shift * rng.normal(size=3)
        elif task.kind is TaskKind.VECTOR:
            task.target[:] = turn @ robot.rotation(task.frame)[:, 0]
        elif task.kind is TaskKind.DIRECTION:
            d = robot.position(task.frame) - robot.position(task.relative_to)
            task.target[:] = turn @ (d / np.linalg.norm(d))
        else:
            M = robot.pose(task.frame)
            if task.relative_to:
                M = np.linalg.inv(robot.pose(task.relative_to)) @ M
            p = M[:3, 3] + shift * rng.normal(size=3)
            R = turn @ M[:3, :3]
            if task.kind is TaskKind.POSITION:
                task.target[:] = p
            elif task.kind is TaskKind.ORIENTATION:
                task.target[:] = R
            else:
                task.target[:3, :3], task.target[:3, 3] = R, p


@pytest.mark.parametrize("anchor", ["", "left_foot"])
@pytest.mark.parametrize("seed", [0, 1])
def test_jacobian_is_the_derivative_of_the_error(robot: RobotModel, anchor: str, seed: int) -> None:
    stack = make_stack(robot)
    order = [["left_foot", "right_foot"], [t for t in stack.names if t not in ("left_foot", "right_foot")]]
    rows = TaskRows(robot, stack, order, {"torso": 4.0})
    q = random_state(robot, seed)
    set_targets(robot, stack, q, 0.0 if seed == 0 else 1e-3, seed)
    stack["left_foot"].mask[:] = [True, True, True, True, True, False]
    stack["com"].mask[2] = False
    stack["grasp"].active[0] = False
    if anchor:
        stack.anchor, stack.anchor_pose = anchor, robot.pose(anchor)
        stack["left_foot"].active[0] = False
    layout = rows.layout()
    rows.assemble(layout)
    J = layout.J.copy()
    h = 1e-6
    for k in range(layout.n):
        ends = []
        for sign in (1, -1):
            v = np.zeros(robot.nv)
            v[k + 6 - layout.first] = sign * h
            moved = robot.integrate(q, v)
            robot.update(moved)
            if anchor:
                robot.place(moved, anchor, stack.anchor_pose)
            rows.assemble(layout, jacobian=False)
            ends.append(layout.e.copy())
        slope = -(ends[0] - ends[1]) / (2 * h)
        np.testing.assert_allclose(J[:, k], slope, atol=5e-3 if seed else 1e-4, err_msg=f"column {k}")


def test_direction_error_is_the_angle(robot: RobotModel) -> None:
    import pinocchio as pin

    stack = make_stack(robot)
    rows = TaskRows(robot, stack, [["left_forearm"]], {})
    q = random_state(robot, 3)
    for angle in (0.0, 0.3, 2.0, np.pi - 1e-6):
        robot.update(q)
        d = robot.position("left_wrist") - robot.position("left_elbow")
        d /= np.linalg.norm(d)
        axis = np.cross(d, [0.3, 0.5, -0.8])
        stack["left_forearm"].target[:] = pin.exp3(angle * axis / np.linalg.norm(axis)) @ d
        layout = rows.layout()
        rows.assemble(layout)
        assert np.linalg.norm(layout.e) == pytest.approx(angle, abs=1e-6)


def test_an_opposite_direction_still_has_a_way_round(robot: RobotModel) -> None:
    stack = make_stack(robot)
    rows = TaskRows(robot, stack, [["torso"]], {})
    robot.update(robot.standing)
    d = robot.position("mid_shoulder") - robot.position("mid_hip")
    stack["torso"].target[:] = -d / np.linalg.norm(d)
    layout = rows.layout()
    rows.assemble(layout)
    assert np.isfinite(layout.e).all()
    assert np.linalg.norm(layout.e) == pytest.approx(np.pi, abs=1e-6)


def test_a_frame_fixed_to_the_anchor_has_no_rows_to_move(robot: RobotModel) -> None:
    stack = make_stack(robot)
    rows = TaskRows(robot, stack, [["left_foot"]], {})
    robot.update(robot.standing)
    stack.anchor, stack.anchor_pose = "left_foot", robot.pose("left_foot")
    layout = rows.layout()
    rows.assemble(layout)
    assert np.abs(layout.J).max() == 0.0
