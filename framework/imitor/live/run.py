"""A live run: reception, computation, commands and viewers in threads of their own; the newest frame wins.

| thread | waits for | does | gives to |
|---|---|---|---|
| receiver | a datagram | decodes it | newest instant |
| this one | a new instant, or a period without one | one step of the pipeline; files | newest solution |
| output | the next time on the grid of the output rate | interpolates, guards | robot sinks |
| viewers | a new solution | shows it | whoever looks |

Between two threads lies room for one thing, and a newer one replaces it: no delay can grow.
"""

from __future__ import annotations

import gc
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from imitor.errors import SinkError, told
from imitor.kinds import Record, Sink, Tick
from imitor.live.operator import Operator
from imitor.live.output import Output
from imitor.live.pace import Steps
from imitor.live.received import RECEIVED_FILE, ReceivedRecorder
from imitor.live.receiver import Arrival
from imitor.live.solved import Solved
from imitor.live.source import LiveSource
from imitor.live.statistics import Durations
from imitor.live.viewer import Viewers
from imitor.pipeline import Pipeline
from imitor.robot.model import BASE_NQ
from imitor.safety.tracking import Request
from imitor.types import Array

REST_S: Final = 0.3
MOST_REST_S: Final = 3.0
"""At the end the robot is held for at least and at most so long, until it is at rest [s]."""
AT_REST_RAD_S: Final = 0.05
"""A robot whose joints are all slower is at rest [rad/s]."""
FIRST_S: Final = 2.0
"""How long the first step waits for a person at most [s]."""
_SWITCH_S: Final = 0.0005
"""How long one thread may keep the others waiting [s]."""

Sinks = Sequence[tuple[str, Sink[Any]]]


@dataclass
class LiveReport:
    """What happened in a live run.

    Attributes:
        steps: Steps computed.
        without_frame: Steps for which nothing new had arrived.
        overruns: Steps that took longer than a period.
        compute: Time of a step.
        latency: From a datagram's arrival to its solution.
    """

    steps: int = 0
    without_frame: int = 0
    overruns: int = 0
    compute: Durations = field(default_factory=Durations)
    latency: Durations = field(default_factory=Durations)


class LiveRun:
    """Runs a pipeline with a live source.

    Args:
        pipeline: The built pipeline.
        sinks: The opened sinks, with their names for messages.
        out_dir: Where what is received is recorded.
        operator: Who may pause, resume, stop and end it.
        write: Writes a record to a sink; raises `SinkError`.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        sinks: Sinks,
        out_dir: Path,
        operator: Operator,
        write: Callable[[str, Sink[Any], Any], None],
    ) -> None:
        source = pipeline.source
        if not isinstance(source, LiveSource):
            raise TypeError(f"source '{source.name}' says it is live, but is no LiveSource")
        self.pipeline, self.source, self.operator = pipeline, source, operator
        self._write = write
        self._every = [s for s in sinks if not (s[1].realtime or s[1].newest)]
        commands = [s for s in sinks if s[1].realtime]
        shown = [s for s in sinks if s[1].newest]
        robot = pipeline.robot.twin()
        self.output = (
            Output(robot, pipeline.stack, commands, pipeline.output_hz, pipeline.rate_hz)
            if commands
            else None
        )
        self.viewers = Viewers(pipeline.stack, shown) if shown else None
        self.recorder = ReceivedRecorder(
            pipeline.skeleton, pipeline.rate_hz, pipeline.calibrated_with, out_dir
        )
        self.report = LiveReport()
        self._out_dir = out_dir

    def drive(self, max_frames: int | None, done: Callable[[int], None]) -> None:
        """Run until the operator ends it or so many steps are computed; then bring the robot to rest.

        Args:
            max_frames: Steps to compute; ``None``: until the operator ends it.
            done: Called after every step with the number of finished ones.

        Raises:
            RunError: A stage or a sink failed; what was finished is kept.
        """
        threads = [t for t in (self.output, self.viewers) if t is not None]
        switch = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH_S)
        gc.collect()
        gc.freeze()
        try:
            for thread in threads:
                thread.start()
            self._steps(max_frames, done)
        except Exception:  # nothing is computed any more: the guard brakes on the way to the last solution
            if self.output is not None and self.output.is_alive():
                self.output.join(REST_S)
            raise
        finally:
            for thread in threads:
                thread.close()
            sys.setswitchinterval(switch)
            gc.unfreeze()
        if self.output is not None:  # it may have failed at the very end
            self.output.check()

    def _steps(self, max_frames: int | None, done: Callable[[int], None]) -> None:
        start = time.perf_counter()
        steps, rest = Steps(self.pipeline.rate_hz, start), _Rest(self.pipeline)
        self.source.take()  # came while robots were reached: too old to begin with
        while not rest.over:
            arrival = self._next(steps)
            begin = time.perf_counter()
            time_s = begin - start
            request = self.operator.take()
            ends = self.operator.quits or (max_frames is not None and self.report.steps >= max_frames)
            if rest.began_s is None and ends:
                rest.begin(time_s)
                request = request if request is Request.STOP else Request.PAUSE
            elif rest.began_s is not None and request is not Request.STOP:  # a stop is never too late
                request = Request.NONE
            frame = None if arrival is None else self.source.person(arrival, time_s)
            self._step(Tick(time_s, frame, str(request)), arrival, begin)
            rest.step(time_s)
            done(self.report.steps)

    def _next(self, steps: Steps) -> Arrival | None:
        """Wait until the next step is due, and then for something new, but not longer than a period."""
        clock = time.perf_counter
        wait = steps.due_s - clock()
        if wait > 0:
            time.sleep(wait)
        arrival = self.source.take()
        waiting = arrival is not None
        if arrival is None:
            first = self.report.steps == 0  # the robot begins where the person is
            arrival = self.source.take(FIRST_S if first else max(steps.patience_s - clock(), 0.0))
        steps.begun(clock(), waiting)
        return arrival

    def _step(self, tick: Tick, arrival: Arrival | None, begin: float) -> None:
        try:
            record = self._solve(tick, arrival, begin)
        finally:
            self.recorder.add(tick)  # after the command has left
        if record is not None:
            for where, sink in self._every:
                self._write(where, sink, record)

    def _solve(self, tick: Tick, arrival: Arrival | None, begin: float) -> Record | None:
        """Compute a step and pass its command on; return its record."""
        report = self.report
        record = self.pipeline.advance(tick, begin)
        ready = time.perf_counter()
        if record is not None and (self.output is not None or self.viewers is not None):
            solved = Solved.of(record, math.nan if arrival is None else arrival.at_s, ready)
            if self.output is not None:
                if self.pipeline.begun:  # a robot is not moved before there is somebody to follow
                    self.output.box.put(solved)
                    time.sleep(0)  # lets the thread that sends go first
                self.output.check()
            if self.viewers is not None:
                self.viewers.box.put(solved)
        report.steps += 1
        report.without_frame += tick.frame is None
        report.compute.add(ready - begin)
        report.overruns += ready - begin > 1.0 / self.pipeline.rate_hz
        if arrival is not None:
            report.latency.add(ready - arrival.at_s)
        return record

    @property
    def stuck(self) -> str:
        """The robot sink that does not come back from a command and cannot be finished; empty when none is."""
        return "" if self.output is None else self.output.stuck

    def save(self) -> list[Path]:
        """Write what was received; return the files."""
        path = self._out_dir / RECEIVED_FILE
        try:
            self.recorder.save(path)
        except (OSError, ValueError) as error:  # a full disk, also when what lies on it is mapped
            raise SinkError(f"cannot write {path}: {told(error)}") from error
        finally:
            self.recorder.close()
        return [path]

    def figures(self) -> dict[str, Any]:
        """Return what is told of the run in the report."""
        report, tracking = self.report, self.pipeline.tracking
        out: dict[str, Any] = {
            "step_rate_hz": self.pipeline.rate_hz,
            "steps": report.steps,
            "without_frame": report.without_frame,
            "overruns": report.overruns,
            "replaced": 0 if self.source.receiver is None else self.source.receiver.box.replaced,
            "reception": self.source.reception.figures(),
            "compute": report.compute.figures(),
            "latency_to_solution": report.latency.figures(),
            "state": str(tracking.state),
        }
        if self.output is not None:
            out["output"] = self.output.figures()
        if self.viewers is not None:
            out["viewers"] = self.viewers.figures()
        return out


class _Rest:
    """The end of a run: the person pauses until the robot is at rest."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline, self._most = pipeline, AT_REST_RAD_S / pipeline.rate_hz
        self._q: Array | None = None
        self.began_s: float | None = None
        self.over = False

    def begin(self, time_s: float) -> None:
        self.began_s = time_s

    def step(self, time_s: float) -> None:
        if self.began_s is None:
            return
        joints, before = self._pipeline.state.q[BASE_NQ:].copy(), self._q
        still = before is not None and bool(np.abs(joints - before).max() <= self._most)
        self._q, rested_s = joints, time_s - self.began_s
        self.over = rested_s > MOST_REST_S or (rested_s > REST_S and still)


__all__ = ["REST_S", "LiveReport", "LiveRun"]
