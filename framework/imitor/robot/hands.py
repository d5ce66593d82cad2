"""Which joints are hands: those that may touch what is there to be grasped."""

from __future__ import annotations

from imitor.robot.model import RobotModel
from imitor.types import SIDES


def hand_joints(robot: RobotModel) -> frozenset[int]:
    """Return the joints of the robot's model that carry a hand, and those behind them, as fingers."""
    names = [f"{side}_hand" for side in SIDES if robot.has(f"{side}_hand")]
    found = {int(robot.model.frames[robot.frame_id(name)].parentJoint) for name in names}
    for joint in range(1, robot.model.njoints):  # a parent comes before its children
        if int(robot.model.parents[joint]) in found:
            found.add(joint)
    return frozenset(found)
