"""The change of support, step by step: the offset goes first, the foot follows [koenemann2014] section V, figure 4."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from imitor.types import Support


class Mode(Enum):
    """What the robot stands on."""

    DOUBLE = "double"
    LEFT = "left"
    RIGHT = "right"


_END = {Mode.LEFT: 0.0, Mode.RIGHT: 1.0}


def mode_of(support: Support) -> Mode | None:
    """Return the human's mode; nothing in flight."""
    if support.none:
        return None
    if support.double:
        return Mode.DOUBLE
    return Mode.LEFT if support.left else Mode.RIGHT


@dataclass(frozen=True)
class OffsetLimits:
    """How fast the offset may move.

    Attributes:
        speed: Largest speed, at 0.5 [1/s].
        floor: Smallest speed, at 0 and 1 [1/s]; above 0, or an end could neither be left nor reached.
        tolerance: How near an end counts as arrived [-].
        landing_s: How long the offset stays at an end after the human's other foot landed [s].
    """

    speed: float
    floor: float
    tolerance: float
    landing_s: float

    def at(self, offset: float) -> float:
        """Return the speed limit: a parabola with its maximum at 0.5, never below the floor [1/s]."""
        return max(self.floor, 4.0 * self.speed * offset * (1.0 - offset))


class SupportMachine:
    """Offset and support mode of the robot from those of the human.

    Attributes:
        offset: The robot's offset [-].
        mode: What the robot stands on.
    """

    def __init__(self, limits: OffsetLimits, dt_s: float) -> None:
        self._limits, self._dt_s = limits, dt_s
        self.reset()

    def reset(self) -> None:
        """Stand on both feet, the CoM in the middle."""
        self.offset, self.mode = 0.5, Mode.DOUBLE
        self._wait_s, self._landing = 0.0, False
        self._goal = 0.5

    def step(
        self,
        human: Mode | None,
        human_offset: float,
        *,
        over: Callable[[int], bool] = lambda foot: True,
        down: Callable[[], bool] = lambda: True,
    ) -> None:
        """Advance by a frame; in flight the robot stays as it is.

        A mode changes before the offset moves: what a frame's offset has reached decides about the next frame.

        Args:
            human: What the human stands on; ``None`` in flight.
            human_offset: The human's offset [-].
            over: Tells whether the robot's own CoM is over its left (0) or right (1) sole; asked where it matters.
            down: Tells whether both of the robot's feet are on the ground; asked while one lands.
        """
        limits = self._limits
        if human is not None:
            self._change(human, over)
            self._goal = _END.get(human, min(max(human_offset, 0.0), 1.0))
        if self.mode is not Mode.DOUBLE:
            return
        self._landing = self._landing and not down()
        if self._wait_s > 0.0 or self._landing:
            self._wait_s -= self._dt_s
            return
        most = limits.at(self.offset) * self._dt_s
        self.offset += min(max(self._goal - self.offset, -most), most)
        self.offset = min(max(self.offset, 0.0), 1.0)

    def _change(self, human: Mode, over: Callable[[int], bool]) -> None:
        if self.mode is not Mode.DOUBLE:
            if human is not self.mode:
                self.mode, self._wait_s, self._landing = Mode.DOUBLE, self._limits.landing_s, True
            return
        end = _END.get(human)
        if end is None or self._wait_s > 0.0 or self._landing:
            return
        if abs(self.offset - end) <= self._limits.tolerance and over(int(end)):
            self.mode, self.offset = human, end
