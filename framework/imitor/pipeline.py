"""A pipeline: its stages built and bound once, then a plain loop over frames."""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from imitor.clock import at_rate, copied, played
from imitor.errors import ImitorError, RobotError, RunError, SourceError, SpecError, told
from imitor.kinds import (
    WHOLE_RECORDING,
    Component,
    Context,
    Filter,
    Mapper,
    Postprocessor,
    Record,
    Solver,
    Source,
    Stabilizer,
)
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.safety.guard import Guard
from imitor.spec import PipelineSpec, StageSpec
from imitor.tasks import TaskStack
from imitor.types import Array, Configuration, HumanFrame, Skeleton


class Pipeline:
    """Source, stages and guard of one run, ready to give a command for each human frame.

    Args:
        spec: The validated pipeline.
        registry: Where the plugins are.

    Raises:
        ImitorError: The source cannot be read, the robot does not fit, or a stage refuses its place.

    Attributes:
        source: The started source.
        robot: The robot model, at the configuration so far.
        stack: The tasks.
        guard: What every command passes.
        rate_hz: Output rate [Hz].
        n_frames: Number of commands, when known.
    """

    def __init__(self, spec: PipelineSpec, registry: Registry) -> None:
        self.spec = spec
        self.stages: list[tuple[str, Component[Any]]] = []
        self.source = self._start_source(spec.source, registry)
        try:
            self._assemble(spec, registry)
        except BaseException:
            self.close()
            raise

    def _assemble(self, spec: PipelineSpec, registry: Registry) -> None:
        if self.source.live and spec.speed != 1.0:
            raise ImitorError(
                f"speed {spec.speed}: a live source cannot be slowed down or sped up; leave it at 1"
            )
        self.rate_hz = spec.rate_hz or self.source.rate_hz
        self.skeleton: Skeleton = self.source.skeleton
        self.robot = RobotModel.load(spec.robot, registry)
        context = Context(self.robot, self.skeleton, 1.0 / self.rate_hz, spec.environment)
        for stage in spec.stages:
            component = registry.get(stage.kind, stage.name)(stage.config, context)
            self.stages.append((f"{stage.where} {stage.id}", component))
        self.filters = [(w, c) for w, c in self.stages if isinstance(c, Filter)]
        self.stack = TaskStack(self.robot.n, len(spec.environment))
        self._build()
        self.guard = Guard(self.robot, 1.0 / self.rate_hz)
        self.n_frames = self._count()
        self._bind()
        self.reset()

    @staticmethod
    def _start_source(spec: StageSpec, registry: Registry) -> Source[Any]:
        source = registry.get("source", spec.name)(spec.config)
        if not isinstance(source, Source):
            raise ImitorError(f"'{spec.name}' is no source")
        with _at(f"source {spec.name}"):
            source.start()
        if source.n_frames == 0:
            raise ImitorError(f"source {spec.name}: it has no frames; nothing was run")
        return source

    def _build(self) -> None:
        for where, component in self.stages:
            with _at(where):
                if isinstance(component, Mapper | Stabilizer):
                    component.declare(self.stack)
        self.stack.compile()
        for where, component in self.stages:
            with _at(where):
                if isinstance(component, Solver):
                    component.prepare(self.stack)
                component.start()
        self._calibrate()

    def _calibrate(self) -> None:
        """Give each stage the first frames it asks for, as they come out of the filters before it."""
        wanted = [(where, c) for where, c in self.stages if c.calibration_s > 0]
        if not wanted:
            return
        longest = max(c.calibration_s for _, c in wanted)
        if longest == WHOLE_RECORDING and self.source.live:
            where = next(w for w, c in wanted if c.calibration_s == WHOLE_RECORDING)
            raise ImitorError(
                f"{where}: needs the whole recording first, but the source is live; give its result as options"
            )
        frames = self._human_frames()
        if longest < WHOLE_RECORDING:
            frames = _first_seconds(frames, longest)
        seen = list(frames)
        for where, component in self.stages:
            with _at(where):
                if component.calibration_s > 0:
                    component.calibrate(
                        [f for f in seen if f.time_s - seen[0].time_s <= component.calibration_s]
                    )
                if isinstance(component, Filter):
                    seen = [component.step(f) for f in seen]
                    component.reset()
        self.source.reset()

    def _count(self) -> int | None:
        n = self.source.n_frames
        if n is None:
            return None
        ratio = self.rate_hz / (self.source.rate_hz * self.spec.speed)
        return int((n - 1) * ratio + 1e-9) + 1 + round(self.spec.settle_s * self.rate_hz)

    def _bind(self) -> None:
        """Collect the bound steps once: nothing is looked up per frame."""
        self._filter_steps = [(where, c.step) for where, c in self.filters]
        stages = [(where, c) for where, c in self.stages if not isinstance(c, Filter)]
        self._steps = [(where, _bound(c, self.stack)) for where, c in stages]
        self._first_steps = [
            (where, _settling(c, self.stack) if isinstance(c, Solver) else _bound(c, self.stack))
            for where, c in stages
        ]
        self._solved = _Solved(self.robot)
        solvers = [i for i, (_, c) in enumerate(stages) if isinstance(c, Solver)]
        if solvers and any(isinstance(c, Postprocessor) for _, c in stages[solvers[-1] :]):
            for steps in (self._steps, self._first_steps):
                steps.insert(solvers[-1] + 1, (stages[solvers[-1]][0], self._solved.keep))
                steps.insert(solvers[0], (stages[solvers[0]][0], self._solved.resume))

    # ------------------------------------------------------------------ running

    def reset(self) -> None:
        """Go back to before the first frame."""
        for _, component in self.stages:
            component.reset()
        self.guard.reset()
        self._solved.reset()
        self.state = Configuration(self.robot.standing.copy(), np.ones(2, dtype=bool))
        self.robot.update(self.state.q)
        self._index = 0

    def _human_frames(self) -> Iterator[HumanFrame]:
        speed = self.spec.speed
        return at_rate(played(self.source.frames(), speed), self.source.rate_hz * speed, self.rate_hz)

    def _with_settling(self, frames: Iterator[HumanFrame]) -> Iterator[HumanFrame]:
        last = None
        for last in frames:
            yield last
        if last is None:
            return
        for k in range(1, round(self.spec.settle_s * self.rate_hz) + 1):
            yield copied(last, last.time_s + k / self.rate_hz)

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Compute the command of one human frame into ``self.state``; return the filtered frame.

        Raises:
            RunError: A stage failed; says which and at which frame.
        """
        where, time_s = "", frame.time_s
        frame = copied(frame, time_s)  # filters bind new arrays; the source's frame may be played again
        try:
            for where, filter_step in self._filter_steps:  # noqa: B007
                frame = filter_step(frame)
                if frame is None:
                    raise ImitorError("a filter returns the frame, not None")
            state = self.state
            if state.status:
                self._solved.reset()
            state.status = 0
            for where, step in self._first_steps if self._index == 0 else self._steps:  # noqa: B007
                step(frame, state)
            where = "guard"
            self.guard.apply(self.stack, state)
            state.contact[:] = self.stack.contact
            state.sent = state.q.copy()
        except RunError as error:
            raise type(error)(str(error), frame=self._index, time_s=time_s, stage=where) from error
        except Exception as error:  # a plugin's fault ends the run, not the program: finished frames are kept
            raise RunError(
                f"{told(error)}. The frames before are kept.", frame=self._index, time_s=time_s, stage=where
            ) from error
        self._index += 1
        return frame

    def records(self, max_frames: int | None = None) -> Iterator[Record]:
        """Yield a record for each frame; it is the same object each time, valid until the next.

        The delay that stages declare shifts time stamps: a command is recorded with the human frame it belongs to,
        and the run goes on until the last one is out. A filter with a delay returns earlier frames with their own
        time stamps.
        """
        delay = sum(c.delay_frames for _, c in self.stages)
        frames = self._with_settling(self._human_frames())
        if max_frames is not None:
            frames = itertools.islice(frames, max_frames)
        record = Record(0, 0.0, None, self.stack, self.state)  # type: ignore[arg-type]
        clock = time.perf_counter
        humans: deque[HumanFrame] = deque(
            maxlen=1 + sum(c.delay_frames for _, c in self.stages if c.kind != "filter")
        )
        frames = self._sound(_drained(frames, delay, 1.0 / self.rate_hz))
        for i in itertools.count():
            begin = clock()
            frame = next(frames, None)
            if frame is None:
                return
            humans.append(self.step(frame))
            record.compute_s = clock() - begin
            if i < delay:
                continue
            record.index, record.human = i - delay, humans[0]
            record.time_s = humans[0].time_s
            yield record

    def _sound(self, frames: Iterator[HumanFrame]) -> Iterator[HumanFrame]:
        """Yield the frames of the source; what goes wrong in it names it and its frame.

        Raises:
            RunError: The source failed, or time stands still or runs backwards.
        """
        where, time_s = f"source {self.spec.source.name}", -math.inf
        for i in itertools.count():
            try:
                frame = next(frames, None)
                if frame is None:
                    return
                if not frame.time_s > time_s:
                    raise ImitorError(
                        f"its time goes from {time_s:.6g} s to {frame.time_s:.6g} s; it must increase"
                    )
                time_s = frame.time_s
            except Exception as error:  # whatever a plugin's source raises: the frames before are kept
                raise RunError(f"{told(error)}. The frames before are kept.", frame=i, stage=where) from error
            yield frame

    def close(self) -> None:
        """Close the source and every stage."""
        for component in (*(c for _, c in self.stages), self.source):
            component.close()


def _first_seconds(frames: Iterator[HumanFrame], seconds: float) -> Iterator[HumanFrame]:
    """Yield the frames of the first seconds of a recording."""
    start: float | None = None
    for frame in frames:
        start = frame.time_s if start is None else start
        if frame.time_s - start > seconds:
            return
        yield frame


def _drained(frames: Iterator[HumanFrame], delay: int, dt: float) -> Iterator[HumanFrame]:
    """Repeat the last frame so often that delayed stages give back everything."""
    last = None
    for last in frames:
        yield last
    if last is not None:
        for k in range(1, delay + 1):
            yield copied(last, last.time_s + k * dt)


Step = Callable[[HumanFrame, Configuration], None]


def _bound(component: Component[Any], stack: TaskStack) -> Step:
    """Return a stage's step with one signature for all kinds."""
    if isinstance(component, Mapper):
        map_step = component.step
        return lambda frame, state: map_step(frame, stack)
    if isinstance(component, Stabilizer):
        stabilize = component.step
        return lambda frame, state: stabilize(frame, stack, state)
    if isinstance(component, Solver | Postprocessor):
        change = component.step
        return lambda frame, state: change(stack, state)
    raise ImitorError(f"{type(component).__name__} is no stage")


class _Solved:
    """What the last solver found, before the post-processing after it: where the first goes on from in the next frame.

    A solver that started from a corrected configuration would work against the correction frame after frame, and
    joints that neither holds would drift away. After a frame that was held, solvers start from the command: from where
    the robot is there may be another way.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot
        self._q: Array | None = None

    def reset(self) -> None:
        self._q = None

    def keep(self, frame: HumanFrame, state: Configuration) -> None:
        if self._q is None:
            self._q = state.q.copy()
        self._q[:] = state.q

    def resume(self, frame: HumanFrame, state: Configuration) -> None:
        if self._q is not None and math.isfinite(self._q.dot(self._q)):
            state.q[:] = self._q
            self._robot.update(state.q)


def _settling(solver: Solver[Any], stack: TaskStack) -> Step:
    settle = solver.settle
    return lambda frame, state: settle(stack, state)


@contextlib.contextmanager
def _at(where: str) -> Iterator[None]:
    """Name the stage in errors that happen while the pipeline is built."""
    try:
        yield
    except (SpecError, SourceError, RobotError):
        raise
    except Exception as error:
        raise ImitorError(f"{where}: {told(error)}") from error


def build(spec: PipelineSpec, registry: Registry) -> Pipeline:
    """Build a pipeline from its spec."""
    return Pipeline(spec, registry)


__all__: Sequence[str] = ["Pipeline", "build"]
