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
    Tick,
)
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.safety.following import Following
from imitor.safety.guard import Guard
from imitor.safety.teleport import Teleport
from imitor.safety.tracking import Request, State, Tracking
from imitor.spec import PipelineSpec, StageSpec
from imitor.tasks import TaskStack
from imitor.types import N_ROLES, STATUS, Array, Configuration, HumanFrame, Skeleton, read_only

HELD, STOPPED = STATUS.index("held"), STATUS.index("stopped")
_LOST_POSITION = read_only(np.full((N_ROLES, 3), np.nan))
_LOST_VALID = read_only(np.zeros(N_ROLES, dtype=np.bool_))
_LOST_ORIENTATION = read_only(np.full((N_ROLES, 3, 3), np.nan))
_STATUS_OF = {State.WAITING: HELD, State.HOLDING: HELD, State.PAUSED: HELD, State.STOPPED: STOPPED}


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
        tracking: Where the tracking of the person stands.
        begun: Whether the robot has followed somebody; until then it stands.
        rate_hz: How often a configuration is computed [Hz].
        n_frames: Number of commands, when known.
    """

    def __init__(self, spec: PipelineSpec, registry: Registry) -> None:
        self.spec = spec
        self.stages: list[tuple[str, Component[Any]]] = []
        self.calibrated_with: list[HumanFrame] = []
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
        self.rate_hz = self._rate()
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
        self.tracking = Tracking(spec.tracking)
        self._following = Following(spec.tracking, 1.0 / self.rate_hz)
        self._teleport = Teleport(spec.tracking.human_m_s * max(spec.speed, 1.0))
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

    def _rate(self) -> float:
        """Return how often a command is computed [Hz]: of a live source, not oftener than something arrives."""
        source, asked = self.source, self.spec.rate_hz
        if asked is None:
            return source.rate_hz
        return min(asked, source.rate_hz) if source.live or source.ticks() is not None else asked

    @property
    def output_hz(self) -> float:
        """How often a live run sends commands to robots [Hz]: also between two configurations."""
        return max(self.spec.rate_hz or self.rate_hz, self.rate_hz)

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
        frames = self._human_frames(self.source.first_frames())
        if longest < WHOLE_RECORDING:
            frames = _first_seconds(frames, longest)
        seen = self.calibrated_with = list(frames)
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
        if n is None or self.source.ticks() is not None:
            return n
        ratio = self.rate_hz / (self.source.rate_hz * self.spec.speed)
        return int((n - 1) * ratio + 1e-9) + 1 + round(self.spec.settle_s * self.rate_hz)

    def _bind(self) -> None:
        """Collect the bound steps once: nothing is looked up per frame."""
        self._filter_steps = [(where, c.step) for where, c in self.filters]
        self._missing = [c.missing for _, c in self.stages if isinstance(c, Mapper)]
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
        self.tracking.reset()
        self._following.reset()
        self._teleport.reset()
        self._solved.reset()
        self.state = Configuration(self.robot.standing.copy(), np.ones(2, dtype=bool))
        self.robot.update(self.state.q)
        self._index = 0
        self.begun = False
        self._last_seen: HumanFrame | None = None
        self._record = Record(0, 0.0, None, self.stack, self.state)  # type: ignore[arg-type]
        self._humans: deque[HumanFrame] = deque(
            maxlen=1 + sum(c.delay_frames for _, c in self.stages if c.kind != "filter")
        )

    def _human_frames(self, frames: Iterator[HumanFrame]) -> Iterator[HumanFrame]:
        speed = self.spec.speed
        return at_rate(played(frames, speed), self.source.rate_hz * speed, self.rate_hz)

    def _with_settling(self, frames: Iterator[HumanFrame]) -> Iterator[HumanFrame]:
        last = None
        for last in frames:
            yield last
        if last is None:
            return
        for k in range(1, round(self.spec.settle_s * self.rate_hz) + 1):
            yield copied(last, last.time_s + k / self.rate_hz)

    def step(self, frame: HumanFrame, request: Request = Request.NONE) -> HumanFrame:
        """Compute the command of one human frame into ``self.state``; return the frame that was followed.

        Args:
            frame: The person; nothing of them is valid where nothing was received.
            request: What the operator asks for.

        Raises:
            RunError: A stage failed; says which and at which frame.
        """
        where, time_s = "", frame.time_s
        frame = copied(frame, time_s)  # filters bind new arrays; the source's frame may be played again
        try:
            where = "tracking"
            frame = self._teleport.step(frame)
            for where, filter_step in self._filter_steps:  # noqa: B007
                frame = filter_step(frame)
                if frame is None:
                    raise ImitorError("a filter returns the frame, not None")
            where = "tracking"
            tracked, frame = self._follow(frame, request)
            state = self.state
            first = not self.begun
            self.begun = self.begun or tracked in (State.TRACKING, State.RETURNING)
            if tracked is State.STOPPED or not self.begun:
                self._keep_command()
            else:
                state.status = 0
                for where, step in self._first_steps if first else self._steps:  # noqa: B007
                    step(frame, state)
            where = "guard"
            self.guard.apply(self.stack, state)
            if state.status:
                self._solved.reset()
            state.status = max(state.status, _STATUS_OF.get(tracked, 0))
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

    def _follow(self, frame: HumanFrame, request: Request) -> tuple[State, HumanFrame]:
        """Return where the tracking stands and the person to follow."""
        missing = [what for of in self._missing for what in of(frame)]
        tracked = self.tracking.step(frame.time_s, not missing, request, ", ".join(missing))
        frame = self._following.step(frame, tracked, self._teleport.left)
        if tracked is State.RETURNING and self._following.returned:
            self.tracking.returned()
        return tracked, frame

    def _keep_command(self) -> None:
        """Ask for the last command again; the guard brakes."""
        state = self.state
        if state.sent is not None:
            state.q[:] = state.sent
        self.robot.update(state.q)
        state.status = HELD

    def records(self, max_frames: int | None = None) -> Iterator[Record]:
        """Yield a record for each frame of a recording; it is the same object each time, valid until the next.

        The delay that stages declare shifts time stamps: a command is recorded with the human frame it belongs to,
        and the run goes on until the last one is out. A filter with a delay returns earlier frames with their own
        time stamps. The recording of a live run is played step by step as it was.
        """
        ticks = self.source.ticks()
        if ticks is None:
            frames = self._with_settling(self._human_frames(self.source.frames()))
            if max_frames is not None:
                frames = itertools.islice(frames, max_frames)
            frames = _drained(frames, self.delay_frames, 1.0 / self.rate_hz)
            ticks = (Tick(frame.time_s, frame) for frame in frames)
        elif max_frames is not None:
            ticks = itertools.islice(ticks, max_frames)
        ticks = self._sound(ticks)
        while True:
            begin = time.perf_counter()
            tick = next(ticks, None)
            if tick is None:
                return
            record = self.advance(tick, begin)
            if record is not None:
                yield record

    @property
    def delay_frames(self) -> int:
        """How many frames later a command comes than the human frame it belongs to [frames]."""
        return sum(c.delay_frames for _, c in self.stages)

    def advance(self, tick: Tick, begin_s: float | None = None) -> Record | None:
        """Take one step; return the record of the command that it finishes, valid until the next step.

        Args:
            tick: What was received.
            begin_s: When the work for this step began by the performance counter; default: now [s].
        """
        begin = time.perf_counter() if begin_s is None else begin_s
        frame = self._nobody(tick.time_s) if tick.frame is None else tick.frame
        self._last_seen = tick.frame or self._last_seen
        self._humans.append(self.step(frame, Request(tick.request)))
        if self._index <= self.delay_frames:
            return None
        record = self._record
        record.compute_s = time.perf_counter() - begin
        record.index, record.human = self._index - 1 - self.delay_frames, self._humans[0]
        record.time_s = record.human.time_s
        return record

    def _nobody(self, time_s: float) -> HumanFrame:
        """Return a frame in which nothing of the person is seen."""
        skeleton = self.skeleton
        frame = HumanFrame(time_s, _LOST_POSITION, _LOST_VALID)
        if skeleton.marker_names:
            n = len(skeleton.marker_names)
            frame.marker, frame.marker_valid = np.full((n, 3), np.nan), np.zeros(n, dtype=np.bool_)
        if skeleton.target_names:
            n = len(skeleton.target_names)
            frame.target, frame.target_valid = np.full((n, 4, 4), np.nan), np.zeros(n, dtype=np.bool_)
        if self._last_seen is not None and self._last_seen.orientation is not None:
            frame.orientation = _LOST_ORIENTATION
        return frame

    def _sound(self, ticks: Iterator[Tick]) -> Iterator[Tick]:
        """Yield the steps of the source; what goes wrong in it names it and its frame.

        Raises:
            RunError: The source failed, or time stands still or runs backwards.
        """
        where, time_s = f"source {self.spec.source.name}", -math.inf
        for i in itertools.count():
            try:
                tick = next(ticks, None)
                if tick is None:
                    return
                if not tick.time_s > time_s:
                    raise ImitorError(
                        f"its time goes from {time_s:.6g} s to {tick.time_s:.6g} s; it must increase"
                    )
                time_s = tick.time_s
            except Exception as error:  # whatever a plugin's source raises: the frames before are kept
                raise RunError(f"{told(error)}. The frames before are kept.", frame=i, stage=where) from error
            yield tick

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
