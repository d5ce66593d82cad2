"""A speed limit on the targets of hands and feet that carry no weight."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

from pydantic import Field

from imitor import Component, Config, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.types import Array


class SpeedLimitConfig(Config):
    """Options of the speed limit."""

    tasks: Sequence[str] = Field(
        ["left_hand", "right_hand", "left_foot", "right_foot"],
        description="Position and pose tasks to limit, where they are declared [-].",
    )
    speed_m_s: float = Field(0.8, gt=0, description="Largest speed of a target in its reference frame [m/s].")


class SpeedLimit(Stabilizer[SpeedLimitConfig]):
    """Limit how fast the targets of free hands and feet move [koenemann2014] section V-D (K6).

    Place it before a solver, which then runs on the limited targets. A foot in contact is left alone: its target is
    the balance's. Speeds are those in the frame that the task is relative to.
    """

    name = "speed_limit"

    def reset(self) -> None:
        """Forget the last targets."""
        self._last: dict[str, Array] = {}

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Bring targets that are too fast back to the limit."""
        most = self.config.speed_m_s * self.dt_s
        left, right = stack.contact.tolist()
        for name in self.config.tasks:
            if name not in stack:
                continue
            task = stack[name]
            if task.kind is TaskKind.POSITION:
                place = task.target
            elif task.kind is TaskKind.POSE:
                place = task.target[:3, 3]
            else:
                continue
            last = self._last.get(name)
            if last is None:
                self._last[name] = place.copy()
                continue
            if not (left and name == "left_foot") and not (right and name == "right_foot"):
                step = place - last
                length = sqrt(step.dot(step))
                if length > most:
                    place[:] = last + (most / length) * step
            last[:] = place


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [SpeedLimit]
