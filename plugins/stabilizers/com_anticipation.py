"""CoM anticipation: the CoM follows the head across the feet and is over one before the other lifts."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, remainder, tau
from typing import Any

import numpy as np
from pydantic import Field

from imitor import Component, Config, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.errors import ImitorError
from imitor.types import Array

_FLAT_M = 1.5e-3
"""A sole whose corners are all this near the floor lies on it [m]."""
_LEVEL = 0.02
"""A sole is level when its highest corner is no further above its lowest than this share of its size [-]."""


class ComAnticipationConfig(Config):
    """Options of the CoM anticipation."""

    alpha: float = Field(
        0.12,
        ge=0,
        description="alpha of eq. 7: how far the CoM goes in a step of `step_s` per head speed [s].",
    )
    beta: float = Field(
        0.01,
        ge=0,
        description="beta of eq. 7: how far the CoM goes ahead of the support foot per head speed [s].",
    )
    step_s: float = Field(
        0.1,
        gt=0,
        description="Length of the step that alpha belongs to; the rate of the run does not matter [s].",
    )
    return_s: float = Field(
        1.0,
        gt=0,
        description="Time constant with which the CoM in double support comes back to the head, which it left by "
        "anticipation or by being held at a foot [s].",
    )
    velocity_s: float = Field(
        0.05, ge=0, description="Time constant of the low-pass on the head's velocity [s]."
    )
    margin_m: float = Field(
        0.025,
        ge=0,
        description="How far inside the sole it will stand on the robot's own CoM must be before the other foot "
        "lifts [m].",
    )
    com_speed_m_s: float = Field(0.3, gt=0, description="Largest speed of the CoM's target [m/s].")
    com_acceleration_m_s2: float = Field(
        0.4,
        gt=0,
        description="Largest acceleration of the CoM's target [m/s^2]; the ZMP of the cart-table model leaves the CoM "
        "by it times height over gravity.",
    )
    lift_m: float = Field(
        0.03, gt=0, description="Height to which a foot goes straight up before it follows the human's [m]."
    )
    clearance_m: float = Field(
        0.02, ge=0, description="Least height of a free sole's lowest corner over the floor [m]."
    )
    apart_m: float = Field(
        0.03, ge=0, description="Least gap sideways between a free sole and the one that stands [m]."
    )
    foot_speed_m_s: float = Field(0.4, gt=0, description="Largest speed of a free foot's target [m/s].")
    foot_acceleration_m_s2: float = Field(
        1.5, gt=0, description="Largest acceleration of a free foot's target [m/s^2]."
    )
    foot_turn_rad_s: float = Field(
        2.0, gt=0, description="How fast a free foot is turned flat before it is lowered [rad/s]."
    )
    toe_in_rad: float = Field(
        0.1,
        ge=0,
        description="Where the hips share a motor and headings are free: how far toes may point inward from where the "
        "other foot points before they are turned back [rad].",
    )
    patience_s: float = Field(
        1.0,
        ge=0,
        description="How long a foot tries to get over its landing place before it goes straight down [s].",
    )


class ComAnticipation(Stabilizer[ComAnticipationConfig]):
    """Move the CoM with the head, ahead of the lift of a foot [montecillo2010] section 5, eq. 7 (M5).

    In double support the CoM's target moves along the unit vector across the feet with the velocity of the model's
    head; in single support it stays at the support foot plus beta times that velocity. It is kept between the feet or
    inside the sole, and its speed and acceleration are limited, so that it does not jump when the support changes. A
    foot lifts only when the robot's own CoM is over the other sole by a margin, and it comes down flat, where this
    robot can put it flat. Feet that stand keep their places.

    The mapper is to stand on the robot's feet (`support: robot`). A human in the air, or never seen, leaves the robot
    on the feet that it stands on; one who is quicker than the robot finds it finish each step first.
    """

    name = "com_anticipation"
    wants = frozenset({"support"})
    needs_tasks = frozenset({"com", "head", "left_foot", "right_foot"})
    declares: Mapping[str, TaskKind] = {}  # type: ignore[misc]

    def declare(self, stack: TaskStack) -> None:
        """Check that feet and head are given in the world.

        Raises:
            ImitorError: The mapper gives them relative to a part that moves, or the head has no place.
        """
        for name in ("left_foot", "right_foot", "head"):
            part = stack[name].relative_to
            if part:
                raise ImitorError(
                    f"'{name}' is given relative to the {part}, which moves; com_anticipation needs it in the world: "
                    "use a mapper such as normalized_model"
                )
        if stack["head"].kind is not TaskKind.POSITION:
            raise ImitorError("'head' is no position; com_anticipation follows the position of the head")

    def start(self) -> None:
        """Load the region of landing and build the references."""
        from imitor.balance.follower import Follower
        from imitor.balance.foot_tasks import FootTasks
        from imitor.balance.landing import landing_region
        from imitor.balance.offset import heading_of, tilt_left, yaw
        from imitor.balance.stance import floor_point, footprint, moved_inside
        from imitor.balance.steps import HumanSteps
        from imitor.balance.swing import Swing
        from imitor.balance.transition import Step, TransitionMachine
        from imitor.metrics.polygon import margin

        config, robot = self.config, self.robot
        self._yaw, self._heading_of, self._tilt = yaw, heading_of, tilt_left
        self._footprint, self._margin, self._inside, self._floor = (
            footprint,
            margin,
            moved_inside,
            floor_point,
        )
        self._steps, self.machine = Step, TransitionMachine()
        self._free_yaw = robot.coupling is not None
        self.region = landing_region(robot, free_yaw=self._free_yaw)
        self._human = HumanSteps(robot)
        self._com = Follower(config.com_speed_m_s, config.com_acceleration_m_s2, self.dt_s)
        self._swing = Swing(
            config.foot_speed_m_s, config.foot_acceleration_m_s2, config.patience_s, self.dt_s
        )
        self._feet = [FootTasks(robot, i) for i in range(2)]
        left, right = self._feet
        self._least_between = float(
            (left.sole_to_ankle[1] - left.corners[:, 1].min())
            + (right.corners[:, 1].max() - right.sole_to_ankle[1])
        )
        self._gain = config.alpha / config.step_s
        self._smooth = exp(-self.dt_s / config.velocity_s) if config.velocity_s > 0 else 0.0
        self._return = 1.0 - exp(-self.dt_s / config.return_s)

    def reset(self) -> None:
        """Stand on both feet, where the first frame has them."""
        self.machine.reset()
        self._human.reset()
        self._started = False
        self.place: list[Array] = [np.eye(4), np.eye(4)]
        self.landing: Array = np.zeros(2)
        self._head: Array = np.zeros(2)
        self._was_single = False
        self.velocity: Array = np.zeros(2)
        self.goal: Array = np.zeros(2)

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Write feet, CoM, anchor and contact."""
        self._human.take(frame)
        if not self._started:
            self._stand_first(stack)
        self._advance(frame, state)
        self._follow_head(stack["head"].target)
        machine = self.machine
        for i, foot in enumerate(self._feet):
            stack.contact[i] = i != machine.free
            if i == machine.free:
                self._move_free(stack, i)
            elif i == machine.anchor:
                foot.release(stack)
            else:
                free_yaw = self._turn_freely(i)
                foot.stand(stack, self.place[i], free_yaw=free_yaw)
        stack.anchor = self._feet[machine.anchor].role
        stack.anchor_pose[:] = self.place[machine.anchor]
        com = stack["com"]
        com.target[:2] = self._com.step(self._com_goal())
        com.mask[:] = (True, True, False)
        com.active[0] = True

    # ------------------------------------------------------------------ CoM

    @property
    def single(self) -> bool:
        """Whether the robot stands on one foot or prepares to: the second case of eq. 7."""
        return self.machine.step not in (self._steps.DOUBLE, self._steps.CENTRE)

    def _follow_head(self, head: Array) -> None:
        """Take the velocity of the model's head, shape (2,) [m/s]."""
        now = head[:2].copy()
        self.velocity = self._smooth * self.velocity + (1 - self._smooth) * (now - self._head) / self.dt_s
        self._head = now

    def _com_goal(self) -> Array:
        """Where the CoM is to project by eq. 7, kept between the feet or inside the sole, shape (2,) [m]."""
        config, ends = self.config, [self._sole_centre(1), self._sole_centre(0)]
        if self.single:
            stance = self.machine.stance
            x, y = (self._sole_centre(stance) + config.beta * self.velocity).tolist()
            hull = self._footprint([self._sole_on_floor(stance)])
            self.goal = np.array(self._inside((x, y), hull, config.margin_m))
            self._was_single = True
            return self.goal
        across = ends[1] - ends[0]
        width = float(np.sqrt(across @ across))
        across /= width
        if self._was_single:  # goes on from where the CoM is, not from where single support wanted it
            self.goal, self._was_single = self._com.at.copy(), False
        along = float((self.goal - ends[0]) @ across)
        along += self._gain * float(self.velocity @ across) * self.dt_s
        along += self._return * (float((self._head - ends[0]) @ across) - along)
        self.goal = ends[0] + min(max(along, 0.0), width) * across
        return self.goal

    def _over(self, i: int, state: Configuration) -> float:
        """Return how far inside a sole the robot's CoM was at the last command [m]."""
        robot = self.robot
        if state.sent is None:
            return -1.0
        robot.update(state.sent)
        inside = self._margin(self._floor(robot.com), self._footprint([robot.sole_corners()[i]]))
        robot.update(state.q)
        return inside

    # ------------------------------------------------------------------ steps

    def _stand_first(self, stack: TaskStack) -> None:
        """Put the feet about the middle that the mapper has, as far apart as the human's."""
        self._started = True
        right = self._feet[1]
        ankle, yaw = right.wished_ankle(stack), self._yaw(right.wished_yaw(stack))
        for place in self.place:
            place[:3, :3] = yaw
        self.place[1][:2, 3] = (ankle - yaw @ right.sole_to_ankle)[:2]
        self.place[0][:2, 3] = self._landing_place(0)
        wished = 0.5 * (ankle + self._feet[0].wished_ankle(stack))
        off = (wished - 0.5 * (self._ankle_on_floor(0) + self._ankle_on_floor(1)))[:2]
        for place in self.place:  # the middle stays where the mapper has it: the head is over it
            place[:2, 3] += off
        self.goal = 0.5 * (self._sole_centre(0) + self._sole_centre(1))
        self._com.reset(self.goal)
        self._head = stack["head"].target[:2].copy()

    def _advance(self, frame: HumanFrame, state: Configuration) -> None:
        """Go on to the next step where the robot has finished the present one."""
        machine, steps = self.machine, self._steps
        free = machine.free
        lowest, highest = (0.0, 0.0) if free is None else self._sole_heights(free)
        there = machine.step is not steps.SHIFT or self._over(machine.stance, state) >= self.config.margin_m
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
            self.landing = self._landing_place(free)

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
        if step is self._steps.SINGLE:
            wish = self._beside(foot.wished_ankle(stack), i)
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
            actual = self.robot.position(foot.ankle_role)
            ankle = swing.land(self.landing + lead, actual, ground, height, level)
        free_yaw = self._turn_freely(i)
        pose = self.place[i].copy()
        turn = self._tilt(self.robot.rotation(foot.role), self.config.foot_turn_rad_s * self.dt_s)
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] = ankle - pose[:3, :3] @ foot.sole_to_ankle
        foot.stand(stack, pose, free_yaw=free_yaw)

    def _beside(self, ankle: Array, i: int) -> Array:
        """Move a free foot's ankle, shape (3,) [m], outward until its sole is beside the one that stands."""
        outward = (1.0 - 2.0 * i) * self.place[1 - i][:2, 1]
        between = float((ankle - self._ankle_on_floor(1 - i))[:2] @ outward)
        ankle[:2] += max(self._least_between + self.config.apart_m - between, 0.0) * outward
        return ankle

    def _turn_freely(self, i: int) -> bool:
        """Take the heading of a foot as it is, where headings are free; return whether it is free in this frame.

        Toes that point inward further than `toe_in_rad` from where the other foot points are turned back.
        """
        if not self._free_yaw:
            return False
        heading = self._heading_of(self.robot.rotation(self._feet[i].role))
        other = self._heading_of(self.place[1 - i][:3, :3])
        inward = (2.0 * i - 1.0) * remainder(heading - other, tau) - self.config.toe_in_rad
        back = min(max(inward, 0.0), self.config.foot_turn_rad_s * self.dt_s)
        at = self._ankle_on_floor(i)
        self.place[i][:3, :3] = self._yaw(heading - (2.0 * i - 1.0) * back)
        self.place[i][:2, 3] += (at - self._ankle_on_floor(i))[:2]
        return inward <= 0.0

    def _lay(self, i: int) -> None:
        """Take where a foot is as the place on which it stands, flat on the floor."""
        T = self.robot.pose(self._feet[i].role)
        self.place[i][:3, :3] = self._yaw(self._heading_of(T[:3, :3]))
        self.place[i][:2, 3] = T[:2, 3]

    def _ankle_on_floor(self, i: int) -> Array:
        """Where the ankle of a standing foot is, shape (3,) [m]."""
        return np.asarray(self.place[i][:3, :3] @ self._feet[i].sole_to_ankle + self.place[i][:3, 3])

    def _sole_on_floor(self, i: int) -> Array:
        """Corners of a standing sole, shape (K, 3) [m]."""
        return np.asarray(self._feet[i].corners @ self.place[i][:3, :3].T + self.place[i][:3, 3])

    def _sole_centre(self, i: int) -> Array:
        """Middle of a standing sole on the floor, shape (2,) [m]."""
        return np.asarray(self._sole_on_floor(i)[:, :2].mean(axis=0))

    def _sole_heights(self, i: int) -> tuple[float, float]:
        """Return the heights of a sole's lowest and highest corner [m]."""
        foot = self._feet[i]
        heights = foot.corners @ self.robot.rotation(foot.role)[2] + self.robot.position(foot.role)[2]
        return float(heights.min()), float(heights.max())


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [ComAnticipation]
