"""What the checks run on: an authored human, a robot, a finished run. Open to authors of tests."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.kinds import Context, Record, RunInfo
from imitor.tasks import TaskKind, TaskStack
from imitor.types import Configuration, HumanFrame, Skeleton, Support

if TYPE_CHECKING:
    from imitor.human.captured import Captured
    from imitor.human.performance import Truth
    from imitor.robot.model import RobotModel

RATE_HZ: Final = 30.0
"""Rate of frames and runs unless another is asked for [Hz]."""
ROBOT: Final = "unitree_g1"


def make_skeleton() -> Skeleton:
    """Return the skeleton of the frames of `make_frames`: every role, 41 markers, 17 rigid targets."""
    from imitor.human.body import Body
    from imitor.human.markers import MARKERS_41, TARGETS

    return Body(1.75, "male", 70.0, {}).skeleton(MARKERS_41, TARGETS)


def make_frames(
    scenario: str = "step_forward",
    n: int | None = None,
    *,
    rate_hz: float = RATE_HZ,
    loss: float = 0.0,
    seed: int = 0,
) -> list[HumanFrame]:
    """Return frames of an authored motion, with everything a frame can hold; arrays are read-only.

    Args:
        scenario: A motion of the performer, e.g. ``walk`` (imitor show performer).
        n: The first n frames; ``None`` for the whole motion.
        rate_hz: Frames per second [Hz].
        loss: Probability that a point is lost in a frame, in bursts [-]; the first frame is complete.
        seed: Seed of the losses.
    """
    truth, exact, seen = _performance(scenario, rate_hz, loss, seed)
    frames = []
    for i, time_s in enumerate(truth.time_s.tolist()[:n]):
        c = exact if i == 0 else seen
        left, right = truth.support[i].tolist()
        frame = HumanFrame(time_s, c.position[i], c.valid[i], c.orientation[i])
        if c.marker is not None and c.marker_valid is not None:
            frame.marker, frame.marker_valid = c.marker[i], c.marker_valid[i]
        if c.target is not None and c.target_valid is not None:
            frame.target, frame.target_valid = c.target[i], c.target_valid[i]
        frame.com, frame.support = truth.com[i], Support(left, right)
        frames.append(frame)
    return frames


@functools.lru_cache(maxsize=16)
def _performance(scenario: str, rate_hz: float, loss: float, seed: int) -> tuple[Truth, Captured, Captured]:
    from imitor.human.body import Body
    from imitor.human.captured import Degradation, capture
    from imitor.human.scenarios import play
    from imitor.human.scenarios.scenario import Options

    body = Body(1.75, "male", 70.0, {})
    truth = play(scenario, body, Options(), rate_hz)
    _, exact = capture(truth, body, markers=True, targets=True, degradation=Degradation())
    lossy = Degradation(loss=loss, burst_frames=0.2 * rate_hz, seed=seed)
    truth, seen = capture(truth, body, markers=True, targets=True, degradation=lossy)
    return truth, exact, seen


def copies(frames: Sequence[HumanFrame], without: frozenset[str] = frozenset()) -> list[HumanFrame]:
    """Return new frames with the same arrays, without what the words of `Component.gives` name."""
    out = []
    for frame in frames:
        copy = replace(frame)
        if "support" in without:
            copy.support = None
        if "com" in without:
            copy.com = None
        if "orientation" in without:
            copy.orientation = None
        if "markers" in without:
            copy.marker = copy.marker_valid = None
        if "targets" in without:
            copy.target = copy.target_valid = None
        out.append(copy)
    return out


def make_robot(name: str = ROBOT, **changes: Any) -> RobotModel:
    """Return a robot model of its own.

    Args:
        name: Name or path of the robot's card.
        changes: Fields of the card to replace, e.g. ``coupled`` or ``limits``.
    """
    from imitor.registry import Registry
    from imitor.robot.card import load_card
    from imitor.robot.model import RobotModel

    card = load_card(name, Registry(entry_points=False))
    return RobotModel.from_card(card.model_copy(update=changes))


def make_context(robot: RobotModel | None = None, *, rate_hz: float = RATE_HZ) -> Context:
    """Return what the builder hands to stages: a robot, the skeleton of `make_frames`, the time step."""
    return Context(robot or make_robot(), make_skeleton(), 1.0 / rate_hz)


@dataclass
class Run:
    """A run for a sink: a robot that sways beside a human who steps.

    Attributes:
        info: What the sink is told by `Sink.open`.
        frames: The human.
    """

    info: RunInfo
    frames: Sequence[HumanFrame]

    def records(self) -> Iterator[Record]:
        """Yield the frames; as in a real run it is the same record with the same arrays, written over."""
        info, robot = self.info, self.info.robot
        state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
        record = Record(0, 0.0, self.frames[0], info.stack, state)
        for i, frame in enumerate(self.frames):
            state.q[7:] = np.clip(
                robot.standing[7:] + 0.1 * np.sin(2.0 * i / info.rate_hz), robot.lower, robot.upper
            )
            state.contact[:] = frame.support is None or (frame.support.left, frame.support.right)
            robot.update(state.q)
            for task in info.stack:
                _aim(task.kind, task.target, robot, task.frame)
            record.index, record.time_s, record.human, record.compute_s = (
                i,
                frame.time_s,
                replace(frame),
                1e-3,
            )
            yield record


def _aim(kind: TaskKind, target: Any, robot: RobotModel, frame: str) -> None:
    if kind is TaskKind.COM:
        target[:] = robot.com
    elif kind is TaskKind.POSE:
        target[:] = robot.pose(frame)
    else:
        target[:] = robot.position(frame)


def make_run(
    out_dir: Path, n: int = 20, *, robot: RobotModel | None = None, rate_hz: float = RATE_HZ, **info: Any
) -> Run:
    """Return a run of n frames into a folder.

    Args:
        out_dir: The run directory; it must exist.
        n: Number of frames.
        robot: The robot; default `make_robot`.
        rate_hz: Frames per second [Hz].
        info: More fields of `RunInfo`.
    """
    robot = robot or make_robot()
    stack = TaskStack(robot.n)
    for side in ("left", "right"):
        stack.declare(f"{side}_foot", TaskKind.POSE, frame=f"{side}_foot")
        if robot.has(f"{side}_hand"):
            stack.declare(f"{side}_hand", TaskKind.POSITION, frame=f"{side}_hand")
    stack.declare("com", TaskKind.COM)
    stack.compile()
    told = RunInfo(out_dir, robot, make_skeleton(), rate_hz, stack, n, pipeline_name="conformance", **info)
    frames = make_frames("wave", n, rate_hz=rate_hz)
    return Run(told, frames)
