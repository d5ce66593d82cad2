"""Changes of support in two steps each way: the CoM goes over the other foot before a foot leaves the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np
from pydantic import Field

from imitor import Component, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.balance.step_options import StepConfig
from imitor.errors import ImitorError
from imitor.types import SIDES, Array

_STRAIGHT = 0.97
"""How much of the leg's length is used to stand [-]."""


class SupportTransitionConfig(StepConfig):
    """Options of the change of support."""

    com_ahead_m: float = Field(
        0.015,
        ge=0,
        description="lambda: how far in front of the ankle the CoM is held while a foot is lifted or lowered [m].",
    )
    arrived_m: float = Field(
        0.005, gt=0, description="A CoM this near its goal has arrived: the other foot may lift [m]."
    )
    com_speed_m_s: float = Field(0.2, gt=0, description="Largest speed of the CoM's reference [m/s].")
    com_acceleration_m_s2: float = Field(
        0.5, gt=0, description="Largest acceleration of the CoM's reference [m/s^2]."
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
        """Look where feet can land and build the references."""
        from imitor.balance.follower import Follower
        from imitor.balance.footsteps import Footsteps
        from imitor.balance.transition import TABLE_I, Step

        config, robot = self.config, self.robot
        self._table, self._lower = TABLE_I, Step.LOWER
        free_yaw = robot.coupling is not None if config.free_yaw is None else config.free_yaw
        self.footsteps = Footsteps(robot, config, self.dt_s, free_yaw=free_yaw, lands_as_turned=True)
        self._com = Follower(config.com_speed_m_s, config.com_acceleration_m_s2, self.dt_s)
        self._height = Follower(config.com_speed_m_s, config.com_acceleration_m_s2, self.dt_s)
        lengths = robot.segment_lengths()
        self._leg = _STRAIGHT * sum(lengths[f"left_{part}"] for part in ("thigh", "shank"))
        self._waist_over_hip = float(robot.position("waist")[2] - robot.position("left_hip")[2])
        self._waist_z, self._com_z = float(robot.position("waist")[2]), float(robot.com[2])

    def reset(self) -> None:
        """Stand on both feet, where the first frame has them."""
        self.footsteps.reset()
        self._started = False
        self._back = 1.0
        self._astray: dict[str, Array] = {}

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Write feet, CoM, anchor, contact, and whether hands are tracked."""
        steps = self.footsteps
        steps.take(frame)
        if not self._started:
            self._started = True
            steps.stand(stack)
            self._com.reset(self._com_goal())
            self._height.reset(np.array([self._waist_z]))
        steps.advance(frame, com_there=self._arrived())
        steps.write(stack)
        com = stack["com"]
        com.target[:2] = self._com.step(self._com_goal())
        com.mask[:] = (True, True, False)
        com.active[0] = True
        height = stack["waist_height"]
        crouch = min(float(com.target[2]) - self._com_z, 0.0) if all(stack.contact) else 0.0
        wish = min(self._waist_z + crouch, self._highest_waist())
        height.target[2:] = self._height.step(np.array([wish]))
        height.mask[:] = (False, False, True)
        self._write_ends(stack, self._table[steps.machine.step].ends)

    def _arrived(self) -> bool:
        """Tell whether the CoM rests at its goal."""
        goal = self._com_goal()
        off = self.robot.com[:2] - goal
        return self._com.rests_at(goal, 1e-4) and float(off @ off) <= self.config.arrived_m**2

    def _com_goal(self) -> Array:
        """Where the CoM is to project in the present step, shape (2,) [m]."""
        steps = self.footsteps
        where = self._table[steps.machine.step].com
        if where == "middle":
            return 0.5 * (steps.ankle_on_floor(0) + steps.ankle_on_floor(1))[:2]
        stance = steps.machine.stance
        goal = steps.ankle_on_floor(stance)[:2]
        return goal if where == "ankle" else goal + self.config.com_ahead_m * steps.place[stance][:2, 0]

    def _highest_waist(self) -> float:
        """Return how high the waist can be with the feet on the ground in reach of the hips as they are [m]."""
        steps, heights = self.footsteps, []
        machine = steps.machine
        for i, foot in enumerate(steps.feet):
            if i == machine.free and machine.step is not self._lower:
                continue
            hip, ankle = self.robot.position(foot.hip_role), steps.ankle_on_floor(i)
            if i == machine.free:
                ankle = steps.swing.at
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
