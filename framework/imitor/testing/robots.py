"""Configurations for the checks, and the rules that every configuration must keep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from imitor.tasks import TaskStack
from imitor.testing.expect import AnyComponent, expect
from imitor.testing.stacks import angle
from imitor.types import Array, Configuration

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

EXACT: Final = 1e-9
"""How exactly an anchor is held and a limit kept [m, rad]."""


def near_standing(robot: RobotModel, rng: np.random.Generator, size: float = 0.25) -> Array:
    """Return a random configuration near the standing one, within limits, its left foot where it was."""
    robot.update(robot.standing)
    foot = robot.pose("left_foot")
    q = robot.standing.copy()
    margin = 0.05 * (robot.upper - robot.lower)
    joints = np.clip(q[7:] + rng.uniform(-size, size, robot.n), robot.lower + margin, robot.upper - margin)
    if robot.coupling is not None:
        joints = robot.coupling @ joints[robot.coupling.argmax(axis=0)]
    q[7:] = joints
    robot.update(q)
    robot.place(q, "left_foot", foot)
    return q


def standing_state(robot: RobotModel) -> Configuration:
    """Return a new state of the standing robot, and move the robot there."""
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    robot.update(state.q)
    return state


def check_configuration(
    cls: AnyComponent, robot: RobotModel, stack: TaskStack, state: Configuration, which: str
) -> None:
    """Check a configuration that a stage left: finite, within limits, coupled, at the anchor, robot updated at it."""
    q, joints = state.q, state.q[7:]
    expect(q.shape == (robot.nq,) and np.isfinite(q).all(), cls, f"{which}: the configuration is not finite")
    norm = float(np.linalg.norm(q[3:7]))
    expect(abs(norm - 1) < 1e-8, cls, f"{which}: the base's quaternion has length {norm:.9f}")
    outside = np.maximum(joints - robot.upper, robot.lower - joints)
    worst = int(outside.argmax())
    expect(
        outside[worst] <= EXACT,
        cls,
        f"{which}: joint {robot.joint_names[worst]} is {outside[worst]:.3g} rad beyond its limit",
    )
    if robot.coupling is not None:
        S = robot.coupling
        off = float(np.abs(joints - S @ joints[S.argmax(axis=0)]).max())
        expect(off <= EXACT, cls, f"{which}: coupled joints are {off:.3g} rad apart")
    left_at = {role: robot.pose(role) for role in robot.roles}
    robot.update(q)
    moved = max(float(np.abs(robot.pose(role) - pose).max()) for role, pose in left_at.items())
    expect(moved <= 1e-10, cls, f"{which}: the robot is not updated at the configuration ({moved:.3g} m off)")
    if stack.anchor:
        pose = robot.pose(stack.anchor)
        off = float(np.abs(pose[:3, 3] - stack.anchor_pose[:3, 3]).max())
        turn = angle(pose[:3, :3], stack.anchor_pose[:3, :3])
        expect(
            off <= EXACT and turn <= 1e-8,
            cls,
            f"{which}: the anchor {stack.anchor} is {off:.3g} m and {turn:.3g} rad off its pose; "
            "hold it exactly, with RobotModel.place",
        )


def mirrored_pair(robot: RobotModel) -> tuple[str, str] | None:
    """Return two joints of the hips that one motor could move, a left and a right one."""
    for left in robot.joint_names:
        for a, b in (("left", "right"), ("Left", "Right"), ("L", "R")):
            right = left.replace(a, b, 1)
            if "hip" in left.lower() and a in left and right in robot.joint_names and right != left:
                return left, right
    return None
