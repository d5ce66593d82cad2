"""Feet re-placed and turned so that the CoM projects where it shall: a statically stable pose in every frame."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from pydantic import Field

from imitor import (
    Component,
    Config,
    Configuration,
    HumanFrame,
    Stabilizer,
    Task,
    TaskKind,
    TaskStack,
    hookimpl,
)
from imitor.types import SIDES, Array

_LIGHT = 0.6
"""Offset of the CoM away from the anchor's foot above which the other foot becomes the anchor [-]."""
_FREE_HEADING = np.array([True, True, False])
_PLACE_AND_SOLE = np.array([True, True, True, True, True, False])
_UP = np.array([0.0, 0.0, 1.0])
_MOST = 0.5
"""Most that a foot is moved, as a share of its way to the CoM [-]: what asks for more is no standing pose."""


class FootRetargetConfig(Config):
    """Options of foot retargeting."""

    transition_s: float = Field(
        0.3, gt=0, description="Time in which a foot leaves the ground or comes down to it [s]."
    )
    clearance_m: float = Field(
        0.012, ge=0, description="Least height of a free sole over the ground, once it has left it [m]."
    )
    flat_below_m: float = Field(
        0.03,
        gt=0,
        description="A free sole lower than this is held flat; at twice this it is as the leg has it [m].",
    )


class FootRetarget(Stabilizer[FootRetargetConfig]):
    """Re-place one foot in double support, turn the support foot in single support [koenemann2014] V-C, eq. 7 (K5).

    Takes the pose found so far, the CoM's target and the contact. In double support the foot on whose side the CoM is
    to go (left if the wanted offset is smaller than the present one) moves towards the CoM until the CoM projects onto
    the wanted offset; in single support feet keep their places. The normal of the soles points from the wanted offset
    to the CoM. It then sets the robot on the ground: this normal becomes the vertical, the support foot the anchor,
    flat where it stands; `left_foot` and `right_foot` say where the feet are, soles flat with free yaw, `waist` how
    the trunk is turned, its heading free: five coordinates a leg; and `com` where the CoM is then, for a solver whose
    feet are given in the world. In double support the foot that carries more weight is the anchor.

    A foot that the human has lifted while the robot still stands on it, or both in flight, stays where it is on the
    floor: the pose that the human's raised leg asks for is none to stand in. Sitting and lying down are postures like
    others: the trunk is turned until the CoM is over the feet, as far as the legs can; `static_balance` does the rest.

    A foot that lifts or lands moves between its place on the ground and its free place within `transition_s`; it is in
    contact when that is over.
    """

    name = "foot_retarget"
    wants = frozenset({"configuration", "support"})
    needs_tasks = frozenset({"com", "left_foot", "right_foot", "waist"})

    def start(self) -> None:
        """Bind kernels and views."""
        from imitor.balance import offset
        from imitor.balance.stance import Stance

        robot = self.robot
        self._line, self._stance, self._twin = offset, Stance, robot.twin()
        self._places: list[Array] = [robot.position(f"{side}_foot") for side in SIDES]
        self._turns: list[Array] = [robot.rotation(f"{side}_foot") for side in SIDES]
        self._waist_at, self._waist_turn = robot.position("waist"), robot.rotation("waist")
        self._rate = self.dt_s / self.config.transition_s

    def reset(self) -> None:
        """Forget where the feet stood."""
        self._down = [1.0, 1.0]
        self._support = -1
        self._ground: Array = np.eye(4)
        self._left: list[Array] = [np.zeros(2), np.zeros(2)]  # where on the floor each foot stood last

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Write feet, waist, anchor and contact."""
        wanted = [bool(c) for c in stack.contact]
        if not any(wanted):  # nothing to stand on: as if on both
            wanted = [True, True]
        for i, on in enumerate(wanted):
            self._down[i] = _full(self._down[i] + self._rate) if on else max(self._down[i] - self._rate, 0.0)
        before = self.robot.standing if state.sent is None else state.sent
        self._last = self._stance.at(self._twin, before)
        com, places = self.robot.com, [p.copy() for p in self._places]
        offset = self._line.offset_of(stack["com"].target, places[0], places[1])
        offset = min(max(offset, 0.0), 1.0) if all(wanted) else float(wanted[1])
        self._choose_support(wanted, offset, first=state.sent is None)
        planted = self._planted(frame, wanted)
        standing = self._kept(places, planted) if any(planted) else self._double(com, places, offset)
        normal = self._line.foot_normal(com, standing[0], standing[1], offset)
        self._write(stack, places, standing, normal, wanted, planted, offset)

    def _planted(self, frame: HumanFrame, wanted: list[bool]) -> list[bool]:
        """Return which feet the robot stands on and the human does not."""
        support = frame.support
        if support is None or not all(wanted):
            return [False, False]
        return [not support.left and self._last.down[0], not support.right and self._last.down[1]]

    def _kept(self, places: list[Array], planted: list[bool]) -> list[Array]:
        """Return the feet as they stand to one another at the last command, the one the human stands on in place."""
        feet, j = self._last.feet, self._support if all(planted) else planted.index(False)
        turn = self._line.yaw(self._line.yaw_of(self._turns[j]) - self._line.yaw_of(feet[j]))
        kept = list(places)
        kept[1 - j] = places[j] + turn.dot(feet[1 - j][:3, 3] - feet[j][:3, 3])
        return kept

    def _double(self, com: Array, places: list[Array], offset: float) -> list[Array]:
        """Return the feet with one re-placed, so that the CoM projects onto the offset (figure 5)."""
        now = self._line.offset_of(com, places[0], places[1])
        i = 0 if offset < now else 1
        share = self._line.shift_for(com, places[i], places[1 - i], offset if i == 0 else 1.0 - offset)
        moved = list(places)
        share = min(max(share, -_MOST), _MOST) * min(self._down)  # in single support feet keep their places
        moved[i] = places[i] + share * (com - places[i])
        return moved

    def _choose_support(self, wanted: list[bool], offset: float, *, first: bool) -> None:
        """Keep the anchor's foot while it carries weight; the other one takes over where it is on the ground."""
        now, down = self._support, self._last.down
        if now >= 0 and wanted[now]:
            light = offset > _LIGHT if now == 0 else offset < 1.0 - _LIGHT
            if not (light and min(self._down) >= 1.0 and down[1 - now]):
                return
        self._support = 1 - now if now >= 0 else int(not wanted[0])
        foot = self._support
        T = self.robot.pose(f"{SIDES[foot]}_foot") if first else self._last.feet[foot]
        self._ground = np.eye(4)
        self._ground[:3, :3] = self._line.yaw(self._line.yaw_of(T))
        self._ground[:2, 3] = T[:2, 3]

    def _write(
        self,
        stack: TaskStack,
        places: list[Array],
        standing: list[Array],
        normal: Array,
        wanted: list[bool],
        planted: list[bool],
        offset: float,
    ) -> None:
        """Set the robot on the ground and write the targets in that world."""
        foot, line = self._support, self._line
        R = line.upright(normal)
        R = line.yaw(line.yaw_of(self._ground) - line.yaw_of(R.dot(self._turns[foot]))).dot(R)
        at = self._ground[:3, 3] - R.dot(standing[foot])  # world of the ground from the present world
        com = stack["com"]
        np.add(R.dot(self.robot.com), at, out=com.target)
        com.mask[:] = _FREE_HEADING
        waist = R.dot(self._waist_turn)
        waist_at = R.dot(self._waist_at) + at
        floor: list[Array] = []
        for i, side in enumerate(SIDES):
            ground = R.dot(standing[i]) + at
            ground[2] = 0.0
            if wanted[i] and self._last.down[i]:
                self._left[i] = self._last.feet[i][:2, 3]
            elif not wanted[i]:
                ground[:2] = self._left[i]
            turn, target, down = R.dot(self._turns[i]), ground, self._down[i]
            if down < 1.0:
                turn, target = self._in_the_air(i, turn, R.dot(places[i]) + at, ground)
            else:
                turn = line.yaw(line.yaw_of(turn))
            if planted[i] and i != foot:
                target[:2] = self._last.feet[i][:2, 3]
            self._write_foot(stack, side, turn, target, waist, waist_at)
            stack.contact[i] = wanted[i] and down >= 1.0
            floor.append(target[:2] if planted[i] else ground[:2])
        com.target[:2] = (1.0 - offset) * floor[0] + offset * floor[1]
        task = stack["waist"]
        task.target[:] = waist
        task.mask[:] = _FREE_HEADING
        task.active[0] = True
        stack.anchor = f"{SIDES[foot]}_foot"
        stack.anchor_pose[:] = self._ground

    def _in_the_air(self, foot: int, turn: Array, free: Array, ground: Array) -> tuple[Array, Array]:
        """Return how a foot is turned and where it is on its way between its free place and its place on the ground."""
        down = self._down[foot] * self._down[foot] * (3.0 - 2.0 * self._down[foot])  # leaves, arrives at rest
        turn = self._tilted(turn, float(free[2]), down)
        lowest = float(self.robot.sole[foot].dot(turn[2]).min())
        free[2] = max(float(free[2]), self.config.clearance_m - lowest)
        # up before it goes, there before it comes down
        return turn, ground + (1.0 - down) * (free - ground) * (1.0 - down, 1.0 - down, 1.0)

    def _tilted(self, turn: Array, height: float, down: float) -> Array:
        """Return how a sole is to be turned: as found while high up, flat near the ground and on it."""
        share = max(down, 1.0 - min(max(height / self.config.flat_below_m - 1.0, 0.0), 1.0))
        heading = self._line.yaw(self._line.yaw_of(turn))
        normal = (1.0 - share) * turn[:, 2] + share * _UP
        length = sqrt(normal.dot(normal))
        if share >= 1.0 or length < 1e-6:
            return heading
        return np.asarray(self._line.upright(normal / length).T.dot(heading))

    @staticmethod
    def _write_foot(
        stack: TaskStack, side: str, turn: Array, place: Array, waist: Array, waist_at: Array
    ) -> None:
        task: Task = stack[f"{side}_foot"]
        task.active[0] = True
        if task.kind is TaskKind.POSE:
            task.target[:3, :3], task.target[:3, 3], task.target[3] = turn, place, (0.0, 0.0, 0.0, 1.0)
            task.mask[:] = _PLACE_AND_SOLE
            return
        task.target[:] = (place - waist_at).dot(waist) if task.relative_to == "waist" else place
        if f"{side}_sole" in stack:
            sole = stack[f"{side}_sole"]
            sole.target[:] = turn
            sole.mask[:] = _FREE_HEADING
            sole.active[0] = True


def _full(share: float) -> float:
    """Return a share, 1 where only rounding is missing: a foot does not land a frame late for it."""
    return share if share < 1.0 - 1e-9 else 1.0


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [FootRetarget]
