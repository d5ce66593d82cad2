"""Checks of a mapper: it declares what it names, and writes sound targets in every frame, whatever is lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from imitor.kinds import Mapper
from imitor.tasks import TaskStack
from imitor.testing import stacks
from imitor.testing.expect import Snapshot, attempt, build, check_same, expect
from imitor.testing.fixtures import copies, make_context, make_frames, make_robot
from imitor.testing.frames import check_untouched, lost_points, snapshot
from imitor.testing.lifecycle import begin, end, restart
from imitor.testing.robots import standing_state
from imitor.types import HumanFrame

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

SCENARIOS: Final = ("step_forward", "wave", "squat", "single_leg_balance")


def check_mapper(
    cls: type[Mapper[Any]], config: Mapping[str, Any] | None = None, *, robot: RobotModel | None = None
) -> None:
    """Check a mapper on several motions, complete and with lost points."""
    robot = robot or make_robot()
    recordings = [(name, make_frames(name)) for name in SCENARIOS]
    recordings.append(("walk with losses", make_frames("walk", 120, loss=0.1, seed=5)))
    recordings.append(("step_forward with lost limbs", lost_points(make_frames())))
    for name, frames in recordings:
        component, stack = _build(cls, config, robot, frames)
        first = _run(component, stack, frames, name)
        restart(component)
        again = _run(component, stack, frames, name)
        check_same(cls, first, again, f"{name}: run again after reset()")
        end(component)
    other, stack = _build(cls, config, robot, recordings[0][1])
    first = _run(other, stack, recordings[0][1], recordings[0][0])
    other, stack = _build(cls, config, robot, recordings[0][1])
    check_same(cls, first, _run(other, stack, recordings[0][1], recordings[0][0]), "run by another instance")
    end(other)


def _build(
    cls: type[Mapper[Any]], config: Mapping[str, Any] | None, robot: RobotModel, frames: Sequence[HumanFrame]
) -> tuple[Mapper[Any], TaskStack]:
    component = build(cls, config, make_context(robot))
    stack = TaskStack(robot.n)
    attempt(cls, "declare()", lambda: component.declare(stack))
    expect(stack.names, cls, "it declares no task")
    stacks.check_declared(component, stack, ())
    stack.compile()
    begin(component, copies(frames))
    return component, stack


def _run(component: Mapper[Any], stack: TaskStack, frames: Sequence[HumanFrame], name: str) -> list[Snapshot]:
    cls, robot = type(component), component.robot
    standing_state(robot)
    stack.anchor = ""
    out = []
    for i, frame in enumerate(copies(frames)):
        which, before = f"{name}, frame {i}", snapshot(frame)
        robot_before = robot.com.copy()
        attempt(cls, f"step() on {which}", lambda f=frame: component.step(f, stack))  # type: ignore[misc]
        check_untouched(cls, frame, before, which)
        stacks.check_targets(cls, stack, robot, which)
        moved = bool((robot.com != robot_before).any())
        expect(
            not moved, cls, f"{which}: it moved the robot; put it back with robot.update, or copy the model"
        )
        out.append(stacks.snapshot(stack))
    return out
