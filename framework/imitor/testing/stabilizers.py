"""Checks of a stabilizer: it changes tasks, and tasks alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from imitor.kinds import Stabilizer
from imitor.tasks import TaskStack
from imitor.testing import stacks
from imitor.testing.expect import Snapshot, attempt, build, check_same, expect
from imitor.testing.fixtures import copies, make_context, make_frames, make_robot
from imitor.testing.frames import check_untouched, lost_points, snapshot
from imitor.testing.lifecycle import begin, end, restart
from imitor.testing.robots import standing_state
from imitor.types import SIDES, HumanFrame

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


def check_stabilizer(
    cls: type[Stabilizer[Any]], config: Mapping[str, Any] | None = None, *, robot: RobotModel | None = None
) -> None:
    """Check a stabilizer between a plain mapper and a robot that follows it."""
    robot = robot or make_robot()
    recordings = [(name, make_frames(name)) for name in ("step_forward", "single_leg_balance", "wave")]
    recordings.append(("step_forward with lost limbs", lost_points(make_frames())))
    for name, frames in recordings:
        component, stack = _build(cls, config, robot, frames)
        first = _run(component, stack, frames, name)
        restart(component)
        check_same(cls, first, _run(component, stack, frames, name), f"{name}: run again after reset()")
        end(component)
        other, stack = _build(cls, config, robot, frames)
        check_same(cls, first, _run(other, stack, frames, name), f"{name}: run by another instance")
        end(other)


def _build(
    cls: type[Stabilizer[Any]],
    config: Mapping[str, Any] | None,
    robot: RobotModel,
    frames: Sequence[HumanFrame],
) -> tuple[Stabilizer[Any], TaskStack]:
    component = build(cls, config, make_context(robot))
    stack = TaskStack(robot.n)
    stacks.declare_canonical(stack, robot, leave_out=cls.declares)
    before = stack.names
    unknown = sorted(cls.needs_tasks - set(before))
    expect(
        not unknown, cls, f"it needs the tasks {', '.join(unknown)}, which no mapper declares under that name"
    )
    attempt(cls, "declare()", lambda: component.declare(stack))
    stacks.check_declared(component, stack, before)
    stack.compile()
    begin(component, copies(frames))
    return component, stack


def _run(
    component: Stabilizer[Any], stack: TaskStack, frames: Sequence[HumanFrame], name: str
) -> list[Snapshot]:
    cls, robot = type(component), component.robot
    state = standing_state(robot)
    soles = {side: robot.pose(f"{side}_foot") for side in SIDES}
    out = []
    for i, frame in enumerate(copies(frames)):
        which, before = f"{name}, frame {i}", snapshot(frame)
        _sway(stack, robot, frame, soles, i)
        q = state.q.copy()
        state.q.flags.writeable = False
        call = lambda f=frame: component.step(f, stack, state)  # noqa: E731
        attempt(cls, f"step() on {which}", call)
        check_untouched(cls, frame, before, which)
        expect(
            (state.q == q).all(), cls, f"{which}: it changed the configuration; a stabilizer changes tasks"
        )
        stacks.check_targets(cls, stack, robot, which)
        out.append(stacks.snapshot(stack))
        state.q.flags.writeable = True
        state.q[7:] += 0.2 * (np.clip(stack["posture"].target, robot.lower, robot.upper) - state.q[7:])
        robot.update(state.q)
        if stack.anchor:
            robot.place(state.q, stack.anchor, stack.anchor_pose)
    return out


def _sway(stack: TaskStack, robot: RobotModel, frame: HumanFrame, soles: Mapping[str, Any], i: int) -> None:
    """Write targets as a mapper does: a posture that sways, feet in contact where they stood."""
    at = robot.standing.copy()
    wave = 0.1 * np.sin(0.1 * i + np.arange(robot.n))
    at[7:] = np.clip(at[7:] + wave, robot.lower, robot.upper)
    support = frame.support
    contact = [True, True] if support is None else [support.left, support.right]
    for task in stack:
        if task.kind is stacks.K.POSTURE:
            task.target[:] = at[7:]
        elif task.kind is not stacks.K.LIMITS:
            task.target[...] = stacks.now(task, robot, at)
        task.active[0], task.mask[:], task.gain[0] = True, True, 1.0
    stack.contact[:] = contact
    stack.anchor = ""
    for side, stands in zip(SIDES, contact, strict=True):
        if stands:
            stack.anchor, stack.anchor_pose[:] = f"{side}_foot", soles[side]
            stack[f"{side}_foot"].target[:] = soles[side]
