"""The change of support in two steps each way, and what is tracked in each [pennapoubel2014] section III-B, table I.

To lift a foot, the CoM goes over the other one first, then the foot is lifted parallel to the ground. To land, the foot
is lowered parallel to the ground first, then the CoM goes back to between the feet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal

from imitor.types import Support

LEFT: Final = 0
RIGHT: Final = 1


class Step(StrEnum):
    """Where the robot is in the change of support."""

    DOUBLE = "double support"
    SHIFT = "CoM to the foot that stays"
    LIFT = "lift the other foot"
    SINGLE = "single support"
    LOWER = "lower the foot"
    CENTRE = "CoM to the middle"


@dataclass(frozen=True)
class Tracked:
    """What is tracked in a step: a row of table I.

    Attributes:
        ends: Whether hands (and head) are tracked, or left free.
        foot: The foot that does not anchor the robot: ``flat``, ankle position and both ends of the sole at one height
            (five coordinates, yaw free); ``ankle``, its position alone.
        com: Where the CoM projects: the middle between the ankles, the ankle of the support foot, or ``inner``, the
            distance lambda in front of that ankle.
    """

    ends: bool
    foot: Literal["flat", "ankle"]
    com: Literal["middle", "ankle", "inner"]


TABLE_I: Final[Mapping[Step, Tracked]] = {
    Step.DOUBLE: Tracked(ends=True, foot="flat", com="middle"),
    Step.SHIFT: Tracked(ends=False, foot="flat", com="inner"),
    Step.LIFT: Tracked(ends=False, foot="flat", com="inner"),
    Step.SINGLE: Tracked(ends=True, foot="ankle", com="ankle"),
    Step.LOWER: Tracked(ends=False, foot="flat", com="inner"),
    Step.CENTRE: Tracked(ends=False, foot="flat", com="middle"),
}

IN_THE_AIR: Final = frozenset({Step.LIFT, Step.SINGLE, Step.LOWER})


class TransitionMachine:
    """Goes through the steps as the human changes support, each when the robot has finished the one before.

    Attributes:
        step: The present step.
        stance: The foot that carries the robot, or will; meaningless in double support.
        entered: Whether the step began in this frame.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Stand on both feet."""
        self.step, self.stance, self.entered = Step.DOUBLE, RIGHT, True

    @property
    def free(self) -> int | None:
        """The foot that is off the ground, or on its way up or down."""
        return 1 - self.stance if self.step in IN_THE_AIR else None

    @property
    def anchor(self) -> int:
        """The foot fixed to the world (P10): the right one but for left support and the way into and out of it."""
        return self.stance if self.step in IN_THE_AIR else RIGHT

    def advance(self, human: Support | None, *, com_there: bool, foot_up: bool, foot_down: bool) -> None:
        """Go on by a frame.

        Args:
            human: The human's support; unknown or in flight the robot finishes what it does.
            com_there: Whether the robot's CoM is where the present step wants it.
            foot_up: Whether the free foot has been lifted.
            foot_down: Whether the free foot lies flat on the ground.
        """
        before = self.step
        wish = _wish(human, self.stance if self.step in (Step.SHIFT, *IN_THE_AIR) else None)
        stays = wish == self.stance
        match self.step:
            case Step.DOUBLE | Step.CENTRE if wish is not None:
                self.step, self.stance = Step.SHIFT, wish
            case Step.CENTRE if com_there:
                self.step = Step.DOUBLE
            case Step.SHIFT if wish is None:
                self.step = Step.CENTRE
            case Step.SHIFT if not stays and wish is not None:
                self.stance = wish
            case Step.SHIFT if com_there:
                self.step = Step.LIFT
            case Step.LIFT | Step.SINGLE if not stays:
                self.step = Step.LOWER
            case Step.LIFT if foot_up:
                self.step = Step.SINGLE
            case Step.LOWER if foot_down:
                self.step = Step.CENTRE
            case Step.LOWER if stays:
                self.step = Step.LIFT
        self.entered = self.step is not before


def _wish(human: Support | None, now: int | None) -> int | None:
    """Return the foot that the human stands on alone; what it was where that is not known."""
    if human is None or human.none:
        return now
    if human.double:
        return None
    return LEFT if human.left else RIGHT
