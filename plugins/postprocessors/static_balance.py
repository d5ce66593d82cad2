"""Static balance as the last word: a pose is sent only if the robot can stand in it."""

from __future__ import annotations

import logging
from math import dist
from typing import Any, Final

import numpy as np
from pydantic import Field

from imitor import Component, Config, Configuration, Postprocessor, TaskStack, hookimpl
from imitor.types import SIDES, STATUS, Array, BoolArray

_LOG: Final = logging.getLogger("imitor")
_HELD: Final = STATUS.index("held")
_SHARES: Final = (1.0, 0.5, 0.25)
"""Shares of the way from the last command to the new pose that are tried [-]."""


class StaticBalanceConfig(Config):
    """How far inside the CoM stays, and how fast a standing foot may be moved."""

    margin_m: float = Field(
        0.008, ge=0, le=0.1, description="Distance of the CoM to the edge of the standing feet's polygon [m]."
    )
    slide_m_s: float = Field(
        0.2, ge=0, description="Fastest that a standing foot is re-placed on the floor; 0 holds it [m/s]."
    )
    com_tolerance_m: float | None = Field(
        None,
        gt=0,
        description="The CoM is also brought this near to the target of the task `com`; none: anywhere inside [m].",
    )


class StaticBalance(Postprocessor[StaticBalanceConfig]):
    """Send a pose only if the robot stands in it: feet in contact flat on the floor, the CoM inside their polygon.

    A pose that does is left as it is, to the last bit. Of another one the legs are moved by as little as it takes,
    within what their speed allows from the last command; where that is not enough, half and a quarter of the way from
    the last command to the pose are tried; where nothing helps, the last command is repeated and the frame is marked
    as held. A foot in contact stays at its place on the floor, or slides no faster than `slide_m_s` to where the pose
    has it; a foot that comes into contact is brought down flat, in as many frames as its speed takes.

    Acts while the anchor is a foot in contact; other poses are left as they are.
    """

    name = "static_balance"

    def start(self) -> None:
        """Prepare rows and bounds."""
        from imitor.balance.legs import Legs
        from imitor.balance.stance import Stance

        robot = self.robot
        self._stance, self._twin = Stance, robot.twin()
        self._twin_feet: list[Array] = [self._twin.position(f"{side}_foot") for side in SIDES]
        self._legs = Legs(robot, self.config.margin_m, self.config.com_tolerance_m or 0.0)
        self._feet: list[Array] = [robot.position(f"{side}_foot") for side in SIDES]
        self._fast = robot.speed * self.dt_s
        self._slide = self.config.slide_m_s * self.dt_s
        self._told = True

    def reset(self) -> None:
        """Forget the counts."""
        self.changed = self.held = 0
        self._told = False

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Make the pose one that stands, or hold the last one."""
        anchor = next((i for i, side in enumerate(SIDES) if stack.anchor == f"{side}_foot"), -1)
        if anchor < 0 or not stack.contact[anchor]:
            return
        q, contact, last = state.q, stack.contact, state.sent
        places = [p[:2].copy() for p in self._feet]
        before = places if last is None else self._places_at(last)
        for i in range(2):
            length = dist(places[i], before[i])
            if contact[i] and length > self._slide:
                places[i] = before[i] + self._slide / length * (places[i] - before[i])
        bounds, com = self._bounds(last), self._com_target(stack)
        legs = self._legs
        if self._within(q, bounds) and legs.stands(contact, places) and legs.near(com):
            return
        self.changed += 1
        stood = self._stood(anchor, contact, last)
        wanted = q.copy()
        for share in _SHARES if last is not None else (1.0,):
            if last is not None:
                self._go(stack, q, last, share * self._reachable(wanted, last), wanted)
            if share < 1.0:
                places = [b if c else p for b, p, c in zip(before, places, contact, strict=True)]
            legs.solve(q, anchor, stack.anchor_pose, contact, places, com, bounds)
            if legs.stands(stood, places):
                return
        self._hold(stack, state)

    def _go(self, stack: TaskStack, q: Array, last: Array, share: float, wanted: Array) -> None:
        """Set ``q`` to a share of the way from the last command to a pose."""
        q[7:] = last[7:] + share * (wanted[7:] - last[7:])
        self.robot.update(q)
        self.robot.place(q, stack.anchor, stack.anchor_pose)

    def _hold(self, stack: TaskStack, state: Configuration) -> None:
        self.held += 1
        state.status = _HELD
        state.q[:] = self.robot.standing if state.sent is None else state.sent
        self.robot.update(state.q)
        if not self.robot.is_at(stack.anchor, stack.anchor_pose):
            self.robot.place(state.q, stack.anchor, stack.anchor_pose)

    def _com_target(self, stack: TaskStack) -> Array | None:
        if self.config.com_tolerance_m is None or "com" not in stack or not stack["com"].active[0]:
            return None
        return stack["com"].target[:2]

    def _bounds(self, last: Array | None) -> tuple[Array, Array]:
        """Return the joint positions that can be reached from the last command, shape (n,) each [rad]."""
        low, high = self.robot.lower, self.robot.upper
        if last is None:
            return low, high
        return np.maximum(low, last[7:] - self._fast), np.minimum(high, last[7:] + self._fast)

    def _places_at(self, last: Array) -> list[Array]:
        """Return where on the floor the feet were at the last command, shape (2,) each [m]."""
        self._twin.update(last)
        return [p[:2].copy() for p in self._twin_feet]

    def _stood(self, anchor: int, contact: BoolArray, last: Array | None) -> BoolArray:
        """Return which feet in contact were down at the last command, shape (2,)."""
        if last is None:
            return contact
        stood: BoolArray = contact & np.array(self._stance.at(self._twin, last).down)
        stood[anchor] = True
        return stood

    @staticmethod
    def _within(q: Array, bounds: tuple[Array, Array]) -> bool:
        joints = q[7:]
        return not ((joints < bounds[0] - 1e-12) | (joints > bounds[1] + 1e-12)).any()

    def _reachable(self, wanted: Array, last: Array) -> float:
        """Return the largest share of the way from the last command to a pose that the joints' speed allows [-]."""
        step = np.abs(wanted[7:] - last[7:])
        fast = step > self._fast
        return float((self._fast[fast] / step[fast]).min(initial=1.0))

    def close(self) -> None:
        """Say once what was done."""
        if getattr(self, "_told", True):
            return
        self._told = True
        _LOG.info(
            "static_balance: the legs were changed in %d frames, the pose was held in %d",
            self.changed - self.held,
            self.held,
        )


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the post-processor."""
    return [StaticBalance]
