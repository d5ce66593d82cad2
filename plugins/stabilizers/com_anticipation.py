"""CoM anticipation: the CoM follows the head across the feet and is over one before the other lifts."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp
from typing import Any

import numpy as np
from pydantic import Field

from imitor import Component, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.balance.step_options import StepConfig
from imitor.errors import ImitorError
from imitor.types import Array


class ComAnticipationConfig(StepConfig):
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
    apart_m: float = Field(
        0.03, ge=0, description="Least gap sideways between a free sole and the one that stands [m]."
    )
    foot_speed_m_s: float = Field(0.4, gt=0, description="Largest speed of a free foot's target [m/s].")
    foot_acceleration_m_s2: float = Field(
        1.5, gt=0, description="Largest acceleration of a free foot's target [m/s^2]."
    )
    toe_in_rad: float = Field(
        0.1,
        ge=0,
        description="Where the hips share a motor and headings are free: how far toes may point inward from where the "
        "other foot points before they are turned back [rad].",
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
        """Look where feet can land and build the references."""
        from imitor.balance.follower import Follower
        from imitor.balance.footsteps import Footsteps
        from imitor.balance.stance import floor_point, footprint, moved_inside
        from imitor.balance.transition import Step
        from imitor.metrics.polygon import margin

        config, robot = self.config, self.robot
        self._footprint, self._margin, self._inside, self._floor = (
            footprint,
            margin,
            moved_inside,
            floor_point,
        )
        self._step = Step
        self.footsteps = Footsteps(
            robot,
            config,
            self.dt_s,
            free_yaw=robot.coupling is not None,
            toe_in_rad=config.toe_in_rad,
            apart_m=config.apart_m,
            lands_as_turned=False,
        )
        self._com = Follower(config.com_speed_m_s, config.com_acceleration_m_s2, self.dt_s)
        self._gain = config.alpha / config.step_s
        self._smooth = exp(-self.dt_s / config.velocity_s) if config.velocity_s > 0 else 0.0
        self._return = 1.0 - exp(-self.dt_s / config.return_s)

    def reset(self) -> None:
        """Stand on both feet, where the first frame has them."""
        self.footsteps.reset()
        self._started = False
        self._head: Array = np.zeros(2)
        self._was_single = False
        self.velocity: Array = np.zeros(2)
        self.goal: Array = np.zeros(2)

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Write feet, CoM, anchor and contact."""
        steps = self.footsteps
        steps.take(frame)
        if not self._started:
            self._stand_first(stack)
        there = steps.machine.step is not self._step.SHIFT or self._is_over(steps.machine.stance, state)
        steps.advance(frame, com_there=there)
        self._follow_head(stack["head"].target)
        steps.write(stack)
        com = stack["com"]
        com.target[:2] = self._com.step(self._com_goal())
        com.mask[:] = (True, True, False)
        com.active[0] = True

    # ------------------------------------------------------------------ CoM

    @property
    def single(self) -> bool:
        """Whether the robot stands on one foot or prepares to: the second case of eq. 7."""
        return self.footsteps.machine.step not in (self._step.DOUBLE, self._step.CENTRE)

    def _follow_head(self, head: Array) -> None:
        """Take the velocity of the model's head, shape (2,) [m/s]."""
        now = head[:2].copy()
        self.velocity = self._smooth * self.velocity + (1 - self._smooth) * (now - self._head) / self.dt_s
        self._head = now

    def _com_goal(self) -> Array:
        """Where the CoM is to project by eq. 7, kept between the feet or inside the sole, shape (2,) [m]."""
        config, ends = self.config, [self._sole_centre(1), self._sole_centre(0)]
        if self.single:
            stance = self.footsteps.machine.stance
            x, y = (self._sole_centre(stance) + config.beta * self.velocity).tolist()
            hull = self._footprint([self.footsteps.sole_on_floor(stance)])
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

    def _is_over(self, i: int, state: Configuration) -> bool:
        """Tell whether the robot's CoM was inside a sole by the margin at the last command."""
        robot = self.robot
        if state.sent is None:
            return False
        robot.update(state.sent)
        inside = self._margin(self._floor(robot.com), self._footprint([robot.sole_corners()[i]]))
        robot.update(state.q)
        return inside >= self.config.margin_m

    def _stand_first(self, stack: TaskStack) -> None:
        """Put the feet about the middle that the mapper has, as far apart as the human's."""
        self._started = True
        steps = self.footsteps
        steps.stand(stack)
        left, right = steps.feet
        wished = 0.5 * (right.wished_ankle(stack) + left.wished_ankle(stack))
        off = (wished - 0.5 * (steps.ankle_on_floor(0) + steps.ankle_on_floor(1)))[:2]
        for place in steps.place:  # the middle stays where the mapper has it: the head is over it
            place[:2, 3] += off
        self.goal = 0.5 * (self._sole_centre(0) + self._sole_centre(1))
        self._com.reset(self.goal)
        self._head = stack["head"].target[:2].copy()

    def _sole_centre(self, i: int) -> Array:
        """Return the middle of a standing sole on the floor, shape (2,) [m]."""
        return np.asarray(self.footsteps.sole_on_floor(i)[:, :2].mean(axis=0))


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [ComAnticipation]
