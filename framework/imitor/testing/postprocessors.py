"""Checks of a post-processor: it changes the configuration within limits, and moves no foot that stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.kinds import Postprocessor
from imitor.robot.card import Coupling
from imitor.tasks import TaskStack
from imitor.testing import stacks
from imitor.testing.expect import Snapshot, attempt, build, check_same, expect
from imitor.testing.fixtures import make_context, make_robot
from imitor.testing.lifecycle import begin, end, restart
from imitor.testing.robots import check_configuration, mirrored_pair, near_standing, standing_state
from imitor.types import Array

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

FRAMES: Final = 40
STANDS: Final = 1e-6
"""How far a standing foot may move [m]."""


def check_postprocessor(
    cls: type[Postprocessor[Any]], config: Mapping[str, Any] | None = None, *, robot: RobotModel | None = None
) -> None:
    """Check a post-processor on arms that move over standing feet, and on postures anywhere within limits."""
    robots = [robot or make_robot()]
    pair = mirrored_pair(robots[0])
    if pair is not None:
        robots.append(make_robot(str(robots[0].card.path), coupled=(Coupling(joints=pair),)))
    for each in robots:
        goal = type(each).from_card(each.card)
        for name, motion in (("moving arms", _moving_arms(goal)), ("wild postures", _wild(goal))):
            component, stack = _build(cls, config, each)
            first = _run(component, stack, motion, name)
            restart(component)
            check_same(cls, first, _run(component, stack, motion, name), f"{name}: run again after reset()")
            end(component)


def _build(
    cls: type[Postprocessor[Any]], config: Mapping[str, Any] | None, robot: RobotModel
) -> tuple[Postprocessor[Any], TaskStack]:
    component = build(cls, config, make_context(robot))
    stack = TaskStack(robot.n)
    stacks.declare_canonical(stack, robot)
    stack.compile()
    begin(component)
    return component, stack


def _moving_arms(robot: RobotModel) -> list[Array]:
    """Return configurations of a robot that stands and moves what does not carry its feet."""
    robot.update(robot.standing)
    legs = (robot.ancestors("left_foot") + robot.ancestors("right_foot"))[6:] > 0
    out = []
    for i in range(FRAMES):
        q = robot.standing.copy()
        wave = 0.5 * np.sin(0.2 * i + np.arange(robot.n))
        q[7:] = np.clip(q[7:] + np.where(legs, 0.0, wave), robot.lower, robot.upper)
        out.append(q)
    return out


def _wild(robot: RobotModel) -> list[Array]:
    rng = np.random.default_rng(2)
    return [near_standing(robot, rng, 1.5) for _ in range(FRAMES)]


def _run(
    component: Postprocessor[Any], stack: TaskStack, motion: Sequence[Array], name: str
) -> list[Snapshot]:
    cls, robot = type(component), component.robot
    state = standing_state(robot)
    foot = robot.pose("left_foot")
    out = []
    for i, q in enumerate(motion):
        which = f"{name}, frame {i}"
        stack.anchor, stack.anchor_pose = "left_foot", foot.copy()
        stack.contact = np.array([True, name == "moving arms"])
        state.q[:] = q
        stacks.aim(stack, robot, q)
        right, array, before = robot.pose("right_foot"), state.q, stacks.snapshot(stack)
        stacks.set_writable(stack, writable=False)
        try:
            attempt(cls, f"step() on {which}", lambda: component.step(stack, state))
        finally:
            stacks.set_writable(stack, writable=True)
        expect(state.q is array, cls, f"{which}: it put a new array in state.q; change the one that is there")
        check_same(cls, [before], [stacks.snapshot(stack)], f"{which}: the tasks before and after")
        check_configuration(cls, robot, stack, state, which)
        moved = float(np.abs(robot.pose("right_foot") - right).max())
        expect(
            not stack.contact[1] or moved <= STANDS,
            cls,
            f"{which}: it moved the right foot, which stands, by {moved:.2g} m",
        )
        out.append({"q": state.q.copy()})
    return out
