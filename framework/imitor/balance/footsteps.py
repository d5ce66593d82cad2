"""Where the feet stand, and the way of the one that is off the ground: the human's steps, done as this robot can.

Feet that stand keep their places. The free one goes straight up, follows the mapper's wish, gets over its landing place
and comes down flat. The landing place is as far from the other foot as the human's, kept in the region where this robot
can put the foot flat.
"""

from __future__ import annotations

from math import inf, remainder, tau
from typing import Final

import numpy as np

from imitor.balance.foot_tasks import FootTasks
from imitor.balance.landing import landing_region
from imitor.balance.offset import heading_of, tilt_left, yaw
from imitor.balance.step_options import StepConfig
from imitor.balance.steps import HumanSteps
from imitor.balance.swing import Swing
from imitor.balance.transition import Step, TransitionMachine
from imitor.robot.model import RobotModel
from imitor.tasks import TaskStack
from imitor.types import Array, HumanFrame

_FLAT_M: Final = 1.5e-3
"""A sole whose corners are all this near the floor lies on it [m]."""
_LEVEL: Final = 0.02
"""A sole is level when its highest corner is no further above its lowest than this share of its size [-]."""
_UP: Final = 0.9
"""A foot is up at this share of the height to which it is lifted [-]."""


class Footsteps:
    """The feet of one robot, frame by frame.

    Args:
        robot: The robot, left at its standing posture.
        options: How a free foot moves.
        dt_s: Time between frames [s].
        free_yaw: Whether the headings of feet are free, as where the hips share a motor.
        toe_in_rad: Where they are: how far toes may point inward from where the other foot points [rad].
        apart_m: Least gap sideways between a free sole and the one that stands [m].
        lands_as_turned: Whether a foot comes down with the heading that it then has, or else with that it left with.

    Attributes:
        machine: Which step the robot is at.
        feet: Tasks of the left and the right foot.
        place: Where each foot stands, world from sole, shape (4, 4) each.
        landing: Where the free foot's sole shall land, shape (2,) [m].
        swing: The reference of the free foot's ankle.
        region: Where this robot can put a foot flat.
    """

    def __init__(
        self,
        robot: RobotModel,
        options: StepConfig,
        dt_s: float,
        *,
        free_yaw: bool,
        toe_in_rad: float = inf,
        apart_m: float = -inf,
        lands_as_turned: bool,
    ) -> None:
        self._robot, self._options = robot, options
        self._turn_rad = options.foot_turn_rad_s * dt_s
        self._free_yaw, self._toe_in_rad, self._apart_m = free_yaw, toe_in_rad, apart_m
        self._lands_as_turned = lands_as_turned
        self.machine = TransitionMachine()
        self.region = landing_region(robot, free_yaw=free_yaw)
        self._human = HumanSteps(robot)
        self.swing = Swing(options.foot_speed_m_s, options.foot_acceleration_m_s2, options.patience_s, dt_s)
        self.feet = [FootTasks(robot, i) for i in range(2)]
        left, right = self.feet
        self._least_between = float(
            (left.sole_to_ankle[1] - left.corners[:, 1].min())
            + (right.corners[:, 1].max() - right.sole_to_ankle[1])
        )
        self.reset()

    def reset(self) -> None:
        """Stand on both feet, where the first frame has them."""
        self.machine.reset()
        self._human.reset()
        self.place: list[Array] = [np.eye(4), np.eye(4)]
        self.landing: Array = np.zeros(2)

    # ------------------------------------------------------------------ steps

    def take(self, frame: HumanFrame) -> None:
        """See how the human steps."""
        self._human.take(frame)

    def stand(self, stack: TaskStack) -> None:
        """Put the right foot where the mapper has it and the left one as far from it as the human's."""
        right = self.feet[1]
        ankle, turn = right.wished_ankle(stack), yaw(right.wished_yaw(stack))
        for place in self.place:
            place[:3, :3] = turn
        self.place[1][:2, 3] = (ankle - turn @ right.sole_to_ankle)[:2]
        self.place[0][:2, 3] = self.landing_place(0)

    def advance(self, frame: HumanFrame, *, com_there: bool) -> None:
        """Go on to the next step where the robot has finished the present one.

        Args:
            frame: The human, whose support tells what is wished for.
            com_there: Whether the CoM is where the present step wants it.
        """
        machine = self.machine
        free = machine.free
        lowest, highest = (0.0, 0.0) if free is None else self.sole_heights(free)
        down = self.swing.descends and highest < _FLAT_M and lowest > -_FLAT_M
        up = lowest > _UP * self._options.lift_m
        machine.advance(frame.support, com_there=com_there, foot_up=up, foot_down=down)
        if not machine.entered:
            return
        if machine.step is Step.LIFT and free is None:
            self._lay(machine.stance)
            self.swing.reset(self.ankle_on_floor(1 - machine.stance))
        elif machine.step is Step.CENTRE and free is not None:
            self._lay(free)
        elif machine.step in (Step.LIFT, Step.LOWER):
            self.swing.hold()
        if machine.step is Step.LOWER and free is not None:
            if self._lands_as_turned and not self._free_yaw:
                self.place[free][:3, :3] = yaw(heading_of(self._robot.rotation(self.feet[free].role)))
            self.landing = self.landing_place(free)

    def landing_place(self, i: int) -> Array:
        """Return where a foot shall land: as far from the other as the human's, kept in the region, shape (2,) [m]."""
        stand = self.place[1 - i]
        other = self.ankle_on_floor(1 - i)[:2]
        sole = other + self._human.between(i) - (self.place[i][:3, :3] @ self.feet[i].sole_to_ankle)[:2]
        R = stand[:2, :2]
        return stand[:2, 3] + R @ self.region.nearest((sole - stand[:2, 3]) @ R, i)

    def _lay(self, i: int) -> None:
        """Take where a foot is as the place on which it stands, flat on the floor."""
        T = self._robot.pose(self.feet[i].role)
        self.place[i][:3, :3] = yaw(heading_of(T[:3, :3]))
        self.place[i][:2, 3] = T[:2, 3]

    # ------------------------------------------------------------------ tasks

    def write(self, stack: TaskStack) -> None:
        """Write the tasks of both feet, the anchor and the contact."""
        machine = self.machine
        for i, foot in enumerate(self.feet):
            stack.contact[i] = i != machine.free
            if i == machine.free:
                self._move_free(stack, i)
            elif i == machine.anchor:
                foot.release(stack)
            else:
                free_yaw = self._turn_freely(i)
                foot.stand(stack, self.place[i], free_yaw=free_yaw)
        stack.anchor = self.feet[machine.anchor].role
        stack.anchor_pose[:] = self.place[machine.anchor]

    def _move_free(self, stack: TaskStack, i: int) -> None:
        """Write the tasks of the foot that is off the ground."""
        foot, swing, step, options = self.feet[i], self.swing, self.machine.step, self._options
        ground = float(foot.sole_to_ankle[2])
        if step is Step.SINGLE:
            wish = self._beside(foot.wished_ankle(stack), i)
            lowest = foot.over_floor(options.clearance_m)
            wish[2] = max(float(wish[2]), lowest)
            foot.swing(stack, swing.follow(wish, lowest))
            return
        height = ground + options.lift_m
        if step is Step.LIFT:
            ankle = swing.lift(height)
        else:
            lowest, highest = self.sole_heights(i)
            level = highest - lowest < _LEVEL * float(np.ptp(foot.corners[:, 0]))
            lead = (self.place[i][:3, :3] @ foot.sole_to_ankle)[:2]
            height = max(height, foot.over_floor(options.clearance_m))
            actual = self._robot.position(foot.ankle_role)
            ankle = swing.land(self.landing + lead, actual, ground, height, level)
        free_yaw = self._turn_freely(i)
        pose = self.place[i].copy()
        pose[:3, :3] = tilt_left(self._robot.rotation(foot.role), self._turn_rad) @ pose[:3, :3]
        pose[:3, 3] = ankle - pose[:3, :3] @ foot.sole_to_ankle
        foot.stand(stack, pose, free_yaw=free_yaw)

    def _beside(self, ankle: Array, i: int) -> Array:
        """Move a free foot's ankle, shape (3,) [m], outward until its sole is beside the one that stands."""
        outward = (1.0 - 2.0 * i) * self.place[1 - i][:2, 1]
        between = float((ankle - self.ankle_on_floor(1 - i))[:2] @ outward)
        ankle[:2] += max(self._least_between + self._apart_m - between, 0.0) * outward
        return ankle

    def _turn_freely(self, i: int) -> bool:
        """Take the heading of a foot as it is, where headings are free; return whether it is free in this frame.

        Toes that point inward further than `toe_in_rad` from where the other foot points are turned back.
        """
        if not self._free_yaw:
            return False
        heading = heading_of(self._robot.rotation(self.feet[i].role))
        other = heading_of(self.place[1 - i][:3, :3])
        inward = (2.0 * i - 1.0) * remainder(heading - other, tau) - self._toe_in_rad
        back = min(max(inward, 0.0), self._turn_rad)
        at = self.ankle_on_floor(i)
        self.place[i][:3, :3] = yaw(heading - (2.0 * i - 1.0) * back)
        self.place[i][:2, 3] += (at - self.ankle_on_floor(i))[:2]
        return inward <= 0.0

    # ------------------------------------------------------------------ where things are

    def ankle_on_floor(self, i: int) -> Array:
        """Return where the ankle of a standing foot is, shape (3,) [m]."""
        return np.asarray(self.place[i][:3, :3] @ self.feet[i].sole_to_ankle + self.place[i][:3, 3])

    def sole_on_floor(self, i: int) -> Array:
        """Return the corners of a standing sole, shape (K, 3) [m]."""
        return np.asarray(self.feet[i].corners @ self.place[i][:3, :3].T + self.place[i][:3, 3])

    def sole_heights(self, i: int) -> tuple[float, float]:
        """Return the heights of a sole's lowest and highest corner at the robot's last update [m]."""
        foot = self.feet[i]
        heights = foot.corners @ self._robot.rotation(foot.role)[2] + self._robot.position(foot.role)[2]
        return float(heights.min()), float(heights.max())


__all__ = ["Footsteps"]
