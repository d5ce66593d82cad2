"""Commands leave at a fixed rate from a thread of its own, between solved configurations, through a guard."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from typing import Any, Final

from imitor.errors import SinkError, told
from imitor.kinds import Sink
from imitor.live.mailbox import Mailbox
from imitor.live.pace import Grid
from imitor.live.solved import Mirror, Solved
from imitor.live.statistics import Durations
from imitor.robot.model import RobotModel
from imitor.safety.guard import Guard
from imitor.tasks import TaskStack
from imitor.types import STATUS, Array

HELD = STATUS.index("held")
STUCK_S: Final = 5.0
"""A sink that has not taken a command after so long takes none any more [s]."""
_LEEWAY_S: Final = 0.5
_LATE: Final = 1.5
"""A solution that takes so many times as long as it should is late [-]."""


class Output(threading.Thread):
    """Sends commands to the robot sinks.

    Between two solved configurations commands go along the straight line, over the time between solutions, also where
    that is longer than it should be, but not over more than ``hold_s``. Where nothing was solved in time the last one
    stays the goal, and after ``hold_s`` commands are marked as held.

    Args:
        robot: A robot of its own.
        stack: The tasks; copied.
        sinks: Where commands go, with their names for messages.
        rate_hz: Commands per second [Hz].
        solved_hz: Solutions per second [Hz].
        hold_s: After so long without a solution commands are marked as held [s].
    """

    def __init__(
        self,
        robot: RobotModel,
        stack: TaskStack,
        sinks: Sequence[tuple[str, Sink[Any]]],
        rate_hz: float,
        solved_hz: float,
        hold_s: float = 0.25,
    ) -> None:
        super().__init__(name="imitor-output", daemon=True)
        self.box: Mailbox[Solved] = Mailbox()
        self.latency, self.late = Durations(), 0
        self.sent = self.between = self.stale = 0
        self.error: SinkError | None = None
        self._writing: tuple[str, float] | None = None
        self._robot, self._stack, self._sinks = robot, stack.twin(), sinks
        self._rate_hz, self._hold_s = rate_hz, hold_s
        self._steps = max(1.0, rate_hz / solved_hz)
        self._ready_s = math.nan
        self._guard = Guard(robot, 1.0 / rate_hz)
        self._closing = threading.Event()

    @property
    def guard(self) -> Guard:
        """What every command passes."""
        return self._guard

    def close(self) -> None:
        """Stop after the command that is on its way."""
        self._closing.set()
        self.box.close()
        if self.is_alive():
            self.join(STUCK_S + _LEEWAY_S)

    @property
    def stuck(self) -> str:
        """The sink that is stuck in a command and cannot be finished either; empty when none is."""
        writing = self._writing
        if writing is None or not self.is_alive():
            return ""
        where, since_s = writing
        return where if time.perf_counter() - since_s > STUCK_S else ""

    def check(self) -> None:
        """Raise what went wrong.

        Raises:
            SinkError: A sink failed, or is stuck in a command.
        """
        if self.error is not None:
            raise self.error
        where = self.stuck
        if where:
            raise SinkError(
                f"it has not taken a command for {STUCK_S:g} s; is the robot, or the way to it, stuck? It is left as "
                "it is. The frames before are kept.",
                frame=self.sent,
                stage=where,
            )

    def run(self) -> None:
        """Send until closed or until a sink, or something else, fails."""
        try:
            self._run()
        except Exception as error:  # a robot without commands is not to go unnoticed
            self.error = SinkError(
                f"{told(error)}. The frames before are kept.", frame=self.sent, stage="commands"
            )

    def _run(self) -> None:
        clock = time.perf_counter
        goal = self.box.take(0.2)
        while goal is None:
            if self._closing.is_set():
                return
            goal = self.box.take(0.2)
        mirror = Mirror(self._stack, goal)
        state = mirror.state
        line = _Line(goal.q, self._robot)
        start, grid, fresh = clock(), Grid(self._rate_hz, clock()), True
        while not self._closing.is_set():
            ready = goal.ready_s if fresh else None
            if fresh:
                line.aim(state.q if self.sent else goal.q, goal.q, self._steps_to(goal))
                mirror.take(goal)
            line.step(state.q)
            now = clock()
            self._send(mirror, goal, now - start, now - goal.ready_s > self._hold_s)
            if self.error is not None:
                return
            after = clock()
            self.late += after > grid.latest_s + grid.period_s
            if fresh and goal.arrived_s == goal.arrived_s:
                self.latency.add(after - goal.arrived_s)
            self.between += not fresh
            grid.left(now, ready)
            fresh, goal = self._next(grid, goal)

    def _steps_to(self, goal: Solved) -> float:
        """Return in how many commands a solution is reached: more when it comes late."""
        between, self._ready_s = (goal.ready_s - self._ready_s) * self._rate_hz, goal.ready_s
        late = between > _LATE * self._steps  # false for the first one, NaN
        return max(self._steps, min(between, self._hold_s * self._rate_hz)) if late else self._steps

    def _next(self, grid: Grid, goal: Solved) -> tuple[bool, Solved]:
        """Wait for the next time on the grid; return whether there is a new goal, and the goal."""
        clock = time.perf_counter
        wait = grid.earliest_s - clock()
        if wait > 0:
            self._closing.wait(wait)
        until = grid.latest_s if self._steps < 1.5 else grid.next_s
        new = self.box.take(max(until - clock(), 0.0))
        if new is not None and self._steps < 1.5 and grid.is_old(new.ready_s):
            new = self.box.take(max(until - clock(), 0.0)) or new
        if new is None or self._steps < 1.5:
            return new is not None, new or goal
        wait = grid.next_s - clock()
        if wait > 0:
            self._closing.wait(wait)
        return True, new

    def _send(self, mirror: Mirror, goal: Solved, time_s: float, stale: bool) -> None:
        record, state = mirror.record, mirror.state
        state.status = max(goal.status, HELD if stale else 0)
        self.stale += stale
        record.index, record.time_s = self.sent, time_s
        self._guard.apply(mirror.stack, state)
        for where, sink in self._sinks:
            begin = time.perf_counter()
            self._writing = where, begin
            try:
                sink.write(record)
            except Exception as error:  # no robot to reach ends the run; what was finished is kept
                self.error = SinkError(
                    f"{told(error)}. The frames before are kept.", frame=self.sent, time_s=time_s, stage=where
                )
                return
            if self._closing.is_set() and time.perf_counter() - begin > STUCK_S:
                return  # given up meanwhile: the others are finished
        self._writing = None
        self.sent += 1

    def figures(self) -> dict[str, Any]:
        """Return what is told of it in the report."""
        return {
            "rate_hz": self._rate_hz,
            "sent": self.sent,
            "between_solutions": self.between,
            "without_solution_in_time": self.stale,
            "late": self.late,
            "replaced": self.box.replaced,
            "guard_scaled": self._guard.report.scaled,
            "latency": self.latency.figures(),
        }


class _Line:
    """The way from one configuration to the next in equal steps."""

    def __init__(self, q: Array, robot: RobotModel) -> None:
        self._from, self._to = q.copy(), q.copy()
        self._steps, self._done, self._robot = 1.0, 1.0, robot

    def aim(self, start: Array, goal: Array, steps: float) -> None:
        self._from[:], self._to[:] = start, goal
        self._steps, self._done = steps, 0.0

    def step(self, q: Array) -> None:
        """Write the next configuration; at the end it stays."""
        self._done = min(self._done + 1.0, self._steps)
        share = self._done / self._steps
        q[:] = self._to if share >= 1.0 else self._robot.interpolate(self._from, self._to, share)


__all__ = ["Output"]
