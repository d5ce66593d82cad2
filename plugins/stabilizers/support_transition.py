"""Changes of support in two steps each way: the CoM goes over the other foot before a foot leaves the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np
from pydantic import Field

from imitor import Component, Config, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.errors import ImitorError
from imitor.types import SIDES, Array

_FLAT_M = 1.5e-3
"""A sole whose corners are all this near the floor lies on it [m]."""
_LEVEL = 0.02
"""A sole is level when its highest corner is no further above its lowest than this share of its size [-]."""

_STRAIGHT = 0.97
"""How much of the leg's length is used to stand [-]."""


class SupportTransitionConfig(Config):
    """Options of the change of support."""

    com_ahead_m: float = Field(
        0.015,
        ge=0,
        description="lambda: how far in front of the ankle the CoM is held while a foot is lifted or lowered [m].",
    )
    lift_m: float = Field(
        0.03, gt=0, description="rho: height to which a foot is lifted before it is free [m]."
    )
    arrived_m: float = Field(
        0.005, gt=0, description="A CoM this near its goal has arrived: the other foot may lift [m]."
    )
    com_speed_m_s: float = Field(0.2, gt=0, description="Largest speed of the CoM's reference [m/s].")
    com_acceleration_m_s2: float = Field(
        0.5, gt=0, description="Largest acceleration of the CoM's reference [m/s^2]."
    )
    foot_speed_m_s: float = Field(0.3, gt=0, description="Largest speed of a free foot's reference [m/s].")
    foot_acceleration_m_s2: float = Field(
        1.0, gt=0, description="Largest acceleration of a free foot's reference [m/s^2]."
    )
    foot_turn_rad_s: float = Field(
        2.0, gt=0, description="How fast a free foot is turned flat before it is lowered [rad/s]."
    )
    clearance_m: float = Field(
        0.02, ge=0, description="Least height of a free sole's lowest corner over the floor [m]."
    )
    patience_s: float = Field(
        1.0,
        ge=0,
        description="How long a foot tries to get over its landing place before it goes straight down [s].",
    )
    ends: Sequence[str] = Field(
        ["left_hand", "right_hand", "head"], description="Tasks that are free during transitions [-]."
    )
    blend_s: float = Field(
        1.0, gt=0, description="Time in which the free ends come back after a transition [s]."
    )
    free_yaw: bool | None = Field(
        None,
        description="Leave the heading of a standing foot free; none: where the hips share a motor, as NAO's do.",
    )


class SupportTransition(Stabilizer[SupportTransitionConfig]):
    """Change support in two steps each way, landing within reach [pennapoubel2014] III, table I (P4 to P6, P10 to P12).

    Before a foot lifts, the robot's CoM goes over the other one; the foot is lifted parallel to the ground to `lift_m`,
    then follows the mapper. To land it goes over its landing place, is lowered flat, then the CoM goes to the middle
    between the ankles. The landing place is proportional to the human's, kept in the region where this robot can put
    the foot flat. Feet that stand keep their places. The human may be quicker: the robot finishes each step first.

    The mapper is to stand on the robot's feet (`support: robot` of segment_scaling). When the human has no foot on the
    floor the robot finishes what it does and waits; a human who starts on one leg is followed by a transition from two
    feet; points that are lost leave the last targets.

    The task `waist_height`, for a low level, keeps the trunk as high as when standing, or on two feet lower when the
    human crouches: the paper leaves it to the gradients, but to stand on one deeply bent knee needs a strong motor.
    """

    name = "support_transition"
    wants = frozenset({"support"})
    needs_tasks = frozenset({"com", "left_foot", "right_foot"})
    declares: Mapping[str, TaskKind] = {"waist_height": TaskKind.POSITION}  # type: ignore[misc]

    def declare(self, stack: TaskStack) -> None:
        """Declare the height of the waist.

        Raises:
            ImitorError: The mapper gives the feet relative to a part that moves.
        """
        for side in SIDES:
            part = stack[f"{side}_foot"].relative_to
            if part:
                raise ImitorError(
                    f"'{side}_foot' is given relative to the {part}, which moves while the feet are to stay where they "
                    "are; use a mapper that gives the feet in the world, such as segment_scaling"
                )
        stack.declare("waist_height", TaskKind.POSITION, frame="waist")

    def start(self) -> None:
        """Load the region of landing and build the references."""
        from imitor.balance import transition
        from imitor.balance.follower import Follower
        from imitor.balance.foot_tasks import FootTasks
        from imitor.balance.landing import landing_region
        from imitor.balance.offset import heading_of, tilt_left, yaw
        from imitor.balance.steps import HumanSteps
        from imitor.balance.swing import Swing

        config, robot = self.config, self.robot
        self._table, self._steps = transition.TABLE_I, transition.Step
        self._yaw, self._heading_of, self._tilt = yaw, heading_of, tilt_left
        self.machine = transition.TransitionMachine()
        self._free_yaw = robot.coupling is not None if config.free_yaw is None else config.free_yaw
        self.region = landing_region(robot, free_yaw=self._free_yaw)
        self._human = HumanSteps(robot)
        self._com = Follower(config.com_speed_m_s, config.com_acceleration_m_s2, self.dt_s)
        self._height = Follower(config.com_speed_m_s, config.com_acceleration_m_s2, self.dt_s)
        self._swing = Swing(
            config.foot_speed_m_s, config.foot_acceleration_m_s2, config.patience_s, self.dt_s
        )
        self._feet = [FootTasks(robot, i) for i in range(2)]
        lengths = robot.segment_lengths()
        self._leg = _STRAIGHT * sum(lengths[f"left_{part}"] for part in ("thigh", "shank"))
        self._waist_over_hip = float(robot.position("waist")[2] - robot.position("left_hip")[2])
        self._waist_z, self._com_z = float(robot.position("waist")[2]), float(robot.com[2])

    def reset(self) -> None:
        """Stand on both feet, where the first frame has them."""
        self.machine.reset()
        self._human.reset()
        self._started = False
        self._back = 1.0
        self._astray: dict[str, Array] = {}
        self.place: list[Array] = [np.eye(4), np.eye(4)]
        self.landing: Array = np.zeros(2)

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Write feet, CoM, anchor, contact, and whether hands are tracked."""
        self._human.take(frame)
        if not self._started:
            self._stand_first(stack)
        self._advance(frame)
        machine = self.machine
        row = self._table[machine.step]
        for i, foot in enumerate(self._feet):
            stack.contact[i] = i != machine.free
            if i == machine.free:
                self._move_free(stack, i)
            elif i == machine.anchor:
                foot.release(stack)
            else:
                self._turn_freely(i)
                foot.stand(stack, self.place[i], free_yaw=self._free_yaw)
        stack.anchor = self._feet[machine.anchor].role
        stack.anchor_pose[:] = self.place[machine.anchor]
        com = stack["com"]
        com.target[:2] = self._com.step(self._com_goal())
        com.mask[:] = (True, True, False)
        com.active[0] = True
        height = stack["waist_height"]
        crouch = min(float(com.target[2]) - self._com_z, 0.0) if all(stack.contact) else 0.0
        wish = min(self._waist_z + crouch, self._highest_waist())
        height.target[2:] = self._height.step(np.array([wish]))
        height.mask[:] = (False, False, True)
        self._write_ends(stack, row.ends)

    # ------------------------------------------------------------------ steps

    def _stand_first(self, stack: TaskStack) -> None:
        """Put the right foot where the mapper has it and the left one as far from it as the human's."""
        self._started = True
        right = self._feet[1]
        ankle, yaw = right.wished_ankle(stack), self._yaw(right.wished_yaw(stack))
        for place in self.place:
            place[:3, :3] = yaw
        self.place[1][:2, 3] = (ankle - yaw @ right.sole_to_ankle)[:2]
        self.place[0][:2, 3] = self._landing_place(0)
        self._com.reset(self._com_goal())
        self._height.reset(np.array([self._waist_z]))

    def _advance(self, frame: HumanFrame) -> None:
        """Go on to the next step where the robot has finished the present one."""
        machine, steps = self.machine, self._steps
        goal = self._com_goal()
        off = self.robot.com[:2] - goal
        there = self._com.rests_at(goal, 1e-4) and float(off @ off) <= self.config.arrived_m**2
        free = machine.free
        lowest, highest = (0.0, 0.0) if free is None else self._sole_heights(free)
        down = self._swing.descends and highest < _FLAT_M and lowest > -_FLAT_M
        machine.advance(
            frame.support, com_there=there, foot_up=lowest > 0.9 * self.config.lift_m, foot_down=down
        )
        if not machine.entered:
            return
        if machine.step is steps.LIFT and free is None:
            self._lay(machine.stance)
            self._swing.reset(self._ankle_on_floor(1 - machine.stance))
        elif machine.step is steps.CENTRE and free is not None:
            self._lay(free)
        elif machine.step in (steps.LIFT, steps.LOWER):
            self._swing.hold()
        if machine.step is steps.LOWER and free is not None:
            if not self._free_yaw:  # as it is turned now: a jump of the target is a jump of the robot
                self.place[free][:3, :3] = self._yaw(
                    self._heading_of(self.robot.rotation(self._feet[free].role))
                )
            self.landing = self._landing_place(free)

    def _com_goal(self) -> Array:
        """Where the CoM is to project in the present step, shape (2,) [m]."""
        where = self._table[self.machine.step].com
        if where == "middle":
            return 0.5 * (self._ankle_on_floor(0) + self._ankle_on_floor(1))[:2]
        stance = self.machine.stance
        goal = self._ankle_on_floor(stance)[:2]
        return goal if where == "ankle" else goal + self.config.com_ahead_m * self.place[stance][:2, 0]

    def _landing_place(self, i: int) -> Array:
        """Where a foot shall land: as far from the other as the human's, kept in the region, shape (2,) [m]."""
        stand = self.place[1 - i]
        other = self._ankle_on_floor(1 - i)[:2]
        sole = other + self._human.between(i) - (self.place[i][:3, :3] @ self._feet[i].sole_to_ankle)[:2]
        R = stand[:2, :2]
        return stand[:2, 3] + R @ self.region.nearest((sole - stand[:2, 3]) @ R, i)

    # ------------------------------------------------------------------ feet

    def _move_free(self, stack: TaskStack, i: int) -> None:
        """Write the tasks of the foot that is off the ground."""
        foot, swing, step = self._feet[i], self._swing, self.machine.step
        ground = float(foot.sole_to_ankle[2])
        if self._table[step].foot == "ankle":
            wish = foot.wished_ankle(stack)
            lowest = foot.over_floor(self.config.clearance_m)
            wish[2] = max(float(wish[2]), lowest)
            foot.swing(stack, swing.follow(wish, lowest))
            return
        height = ground + self.config.lift_m
        if step is self._steps.LIFT:
            ankle = swing.lift(height)
        else:
            lowest, highest = self._sole_heights(i)
            level = highest - lowest < _LEVEL * float(np.ptp(foot.corners[:, 0]))
            lead = (self.place[i][:3, :3] @ foot.sole_to_ankle)[:2]
            height = max(height, foot.over_floor(self.config.clearance_m))
            ankle = swing.land(
                self.landing + lead, self.robot.position(foot.ankle_role), ground, height, level
            )
        self._turn_freely(i)
        pose = self.place[i].copy()
        pose[:3, :3] = (
            self._tilt(self.robot.rotation(foot.role), self.config.foot_turn_rad_s * self.dt_s) @ pose[:3, :3]
        )
        pose[:3, 3] = ankle - pose[:3, :3] @ foot.sole_to_ankle
        foot.stand(stack, pose, free_yaw=self._free_yaw)

    def _turn_freely(self, i: int) -> None:
        """Take the heading of a foot as it is, where headings are free."""
        if self._free_yaw:
            at = self._ankle_on_floor(i)
            self.place[i][:3, :3] = self._yaw(self._heading_of(self.robot.rotation(self._feet[i].role)))
            self.place[i][:2, 3] += (at - self._ankle_on_floor(i))[:2]

    def _lay(self, i: int) -> None:
        """Take where a foot is as the place on which it stands, flat on the floor."""
        T = self.robot.pose(self._feet[i].role)
        self.place[i][:3, :3] = self._yaw(self._heading_of(T[:3, :3]))
        self.place[i][:2, 3] = T[:2, 3]

    def _ankle_on_floor(self, i: int) -> Array:
        """Where the ankle of a standing foot is, shape (3,) [m]."""
        return np.asarray(self.place[i][:3, :3] @ self._feet[i].sole_to_ankle + self.place[i][:3, 3])

    def _sole_heights(self, i: int) -> tuple[float, float]:
        """Return the heights of a sole's lowest and highest corner [m]."""
        foot = self._feet[i]
        heights = foot.corners @ self.robot.rotation(foot.role)[2] + self.robot.position(foot.role)[2]
        return float(heights.min()), float(heights.max())

    def _highest_waist(self) -> float:
        """Return how high the waist can be with the feet on the ground in reach of the hips as they are [m]."""
        machine, heights = self.machine, []
        for i, foot in enumerate(self._feet):
            if i == machine.free and machine.step is not self._steps.LOWER:
                continue
            hip, ankle = self.robot.position(foot.hip_role), self._ankle_on_floor(i)
            if i == machine.free:
                ankle = self._swing.at
            aside = hip[:2] - ankle[:2]
            up = sqrt(max(self._leg**2 - float(aside @ aside), 0.0))
            heights.append(float(ankle[2]) + up + self._waist_over_hip)
        return min(heights)

    def _write_ends(self, stack: TaskStack, tracked: bool) -> None:
        """Free the hands in transitions; afterwards they come back from where they are, within `blend_s`."""
        returned = tracked and self._back == 0.0
        self._back = min(self._back + self.dt_s / self.config.blend_s, 1.0) if tracked else 0.0
        rest = (1.0 - self._back) ** 2 * (1.0 + 2.0 * self._back)
        for name in self.config.ends:
            if name not in stack:
                continue
            task = stack[name]
            task.active[0] = tracked
            if task.kind is not TaskKind.POSITION or task.relative_to or not tracked:
                continue
            if returned:
                self._astray[name] = self.robot.position(task.frame) - task.target
            if rest > 0.0 and name in self._astray:
                task.target += rest * self._astray[name]


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [SupportTransition]
