"""The CoM's offset between the feet: the human's, at a speed the robot can balance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from imitor import Component, Config, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.types import ROLE_INDEX, SIDES, Array

_ON_THE_FLOOR = np.array([True, True, False])


class ComOffsetConfig(Config):
    """Options of the CoM offset."""

    speed: float = Field(2.0, gt=0, description="Largest speed of the offset, at 0.5 [1/s].")
    floor: float = Field(
        0.25,
        gt=0,
        description="Smallest speed limit of the offset, at 0 and at 1; it must be able to leave them [1/s].",
    )
    tolerance: float = Field(
        0.01, ge=0, lt=0.5, description="An offset this near 0 or 1 has arrived: the other foot may lift [-]."
    )
    landing_s: float = Field(
        0.4, ge=0, description="How long the offset waits after single support until the foot is down [s]."
    )
    margin_m: float = Field(
        0.01,
        ge=0,
        description="How far inside the sole it will stand on the robot's own CoM must be before the other foot "
        "lifts [m].",
    )


class ComOffset(Stabilizer[ComOffsetConfig]):
    """Carry the human's CoM offset between the feet over to the robot [koenemann2014] eq. 6, figure 4 (K3, K4).

    Writes the CoM's target, on the line between the robot's soles at the offset, and the contact: a foot leaves the
    ground only when the offset has arrived over the other one and the robot's own CoM was inside that sole at the last
    command; the CoM leaves a sole only when the other one was down. While the human stands on one foot the offset goes
    to that foot; its speed limit is a parabola with its maximum in the middle and a floor above zero at the ends.

    On bad input: with ankles or CoM lost, the human's offset stays as last seen, and support is what the support filter
    says. With no foot of the human on the floor (a jump, lying down) the robot stays on the feet it stands on. A
    human who is on one foot from the start finds the robot on two; it shifts its weight first.
    """

    name = "com_offset"
    wants = frozenset({"support", "com", "configuration"})
    needs_tasks = frozenset({"com"})
    declares: Mapping[str, TaskKind] = {}  # type: ignore[misc]

    def start(self) -> None:
        """Build the support machine."""
        from imitor.balance.offset import offset_of
        from imitor.balance.stance import Stance
        from imitor.balance.support import OffsetLimits, SupportMachine, mode_of

        config = self.config
        limits = OffsetLimits(config.speed, config.floor, config.tolerance, config.landing_s)
        self._offset_of, self._mode_of, self._stance = offset_of, mode_of, Stance
        self._twin = self.robot.twin()
        self.machine = SupportMachine(limits, self.dt_s)
        self._ankles = [ROLE_INDEX[f"{side}_ankle"] for side in SIDES]
        self._feet: list[Array] = [self.robot.position(f"{side}_foot") for side in SIDES]
        self.human_offset = 0.5

    def reset(self) -> None:
        """Stand on both feet, the CoM in the middle."""
        self.machine.reset()
        self.human_offset = 0.5

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Write the CoM's target and the contact."""
        left, right = self._ankles
        if frame.com is not None and frame.valid[left] and frame.valid[right]:  # else as in the last frame
            human = self._offset_of(frame.com, frame.position[left], frame.position[right])
            self.human_offset = human if np.isfinite(human) else self.human_offset
        machine, support = self.machine, frame.support
        machine.step(
            None if support is None else self._mode_of(support),
            self.human_offset,
            over=lambda foot: self._is_over(foot, state.sent),
            down=lambda: self._is_down(state.sent),
        )
        com = stack["com"]
        com.target[:] = self._feet[0] + machine.offset * (self._feet[1] - self._feet[0])
        com.mask[:] = _ON_THE_FLOOR
        stack.contact[:] = (machine.mode.value != "right", machine.mode.value != "left")

    def _is_over(self, foot: int, last: Array | None) -> bool:
        """Tell whether the CoM of the last command is over a sole."""
        return last is not None and self._stance.at(self._twin, last).margin_m(foot) >= self.config.margin_m

    def _is_down(self, last: Array | None) -> bool:
        """Tell whether both feet were down in the last command."""
        return last is None or all(self._stance.at(self._twin, last).down)


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [ComOffset]
