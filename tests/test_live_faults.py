"""What goes wrong in a live run: stages that fail, full disks, lost terminals, requests at the wrong time."""

from __future__ import annotations

import io
import os
import pty
import resource
import signal
import sys
import termios
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from imitor import Config, Postprocessor
from imitor.clock import copied
from imitor.errors import told
from imitor.human.rotations import exponential, logarithm
from imitor.kinds import Record, RunInfo, Sink, SinkReport, Tick
from imitor.live.operator import Operator, _Keys
from imitor.live.output import Output
from imitor.live.received import Received, ReceivedRecorder
from imitor.live.receiver import Arrival
from imitor.live.sample import Sample
from imitor.live.solved import Solved
from imitor.live.source import LiveConfig, LiveSource
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.rows import Rows
from imitor.run import RunResult, _finish, run
from imitor.safety.tracking import Request, State
from imitor.spec import load_pipeline
from imitor.types import HumanFrame
from live_tools import Kept, registry

HZ = 100.0


class Authored(LiveSource[LiveConfig]):
    """The performer in real time, without a socket; sees nobody where it is told so."""

    name = "authored"
    away: Any = staticmethod(lambda time_s: False)

    def start(self) -> None:
        performer: Any = Registry(entry_points=False).get("source", "performer")
        self._performer = performer(performer.config_type(scenario="wave", rate_hz=HZ))
        self._performer.start()
        self.skeleton, self.rate_hz = self._performer.skeleton, HZ
        self._told = list(self._performer.frames())
        self._start_s, self._taken = time.perf_counter(), -1

    def take(self, timeout_s: float = 0.0) -> Arrival | None:
        due_s = self._start_s + (self._taken + 1) / HZ
        wait = due_s - time.perf_counter()
        if wait > timeout_s:
            time.sleep(timeout_s)
            return None
        time.sleep(max(wait, 0.0))
        self._taken = int((time.perf_counter() - self._start_s) * HZ)
        return Arrival(Sample(self._taken, self._taken / HZ, None), time.perf_counter())

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        if self.away(time_s):
            raise ValueError("nobody")
        told = self._told[min(sample.counter, len(self._told) - 1)]
        return HumanFrame(time_s, told.position, told.valid, told.orientation)


def authored(
    tmp_path: Path,
    operator: Operator | None = None,
    frames: int | None = None,
    stages: Sequence[type[Any]] = (),
    sets: Sequence[str] = (),
    sinks: Sequence[type[Any]] = (),
) -> RunResult:
    """Run the plain retargeting of the performer into the robot of tests."""
    plugins = registry()
    plugins.add(Authored, "tests")
    for component in (*stages, *sinks):
        plugins.add(component, "tests")
    text = Path("pipelines/retarget.yaml").read_text(encoding="utf-8")
    more = "".join(f"  - {s.kind}: {s.name}\n" for s in stages)
    pipeline = tmp_path / "pipeline.yaml"
    pipeline.write_text(text.replace("sinks:", f"{more}sinks:"), encoding="utf-8")
    spec = load_pipeline(
        str(pipeline), plugins, source="authored", sets=[f"rate_hz={HZ}", *sets],
        add_sinks=["kept", *(s.name for s in sinks)],
    )  # fmt: skip
    return run(spec, plugins, out_dir=tmp_path / "run", max_frames=frames, operator=operator)


class Breaks(Postprocessor[Config]):
    """Moves a joint at half its largest speed and fails on the way."""

    name = "breaks"

    def reset(self) -> None:
        self._taken = 0

    def step(self, stack: Any, state: Any) -> None:
        self._taken += 1
        if self._taken > 60:
            raise ZeroDivisionError
        at = self.robot.standing[7] + 0.5 * self.robot.speed[0] / HZ * max(self._taken - 40, 0)
        state.q[7] = min(at, self.robot.upper[0])


def test_after_a_failure_commands_come_to_the_last_solution_and_stay(tmp_path: Path) -> None:
    result = authored(tmp_path, frames=500, stages=[Breaks])
    assert result.status == "failed"
    robot = Kept.told[-1]
    last = np.load(tmp_path / "run/motion.npz")["joint_position_rad"][-1]
    assert np.array_equal(robot.joints()[-1], last)
    assert np.array_equal(robot.joints()[-5], last)  # there for some time, not cut off on the way


class Asks(Operator):
    """Asks at given steps; counts them."""

    def __init__(self, asks: dict[int, Request], quits_at: int) -> None:
        super().__init__()
        self._asks, self._quits_at, self._taken = asks, quits_at, -1

    def take(self) -> Request:
        self._taken += 1
        self.quits = self._taken >= self._quits_at
        return self._asks.get(self._taken, Request.NONE)


@pytest.mark.parametrize("at", [60, 70])
def test_a_stop_counts_also_while_the_run_ends(at: int, tmp_path: Path) -> None:
    result = authored(tmp_path, Asks({at: Request.STOP}, 60))
    status = np.load(tmp_path / "run/motion.npz")["status"]
    assert set(status[at:]) == {"stopped"}
    assert result.status == "stopped"


def test_a_robot_is_not_moved_before_there_is_somebody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Authored, "away", staticmethod(lambda time_s: time_s < 0.5))
    authored(tmp_path, frames=120)
    motion, robot = np.load(tmp_path / "run/motion.npz"), Kept.told[-1]
    seen = int(np.argmin(motion["status"] == "held"))
    assert 30 < seen < 70
    joints = motion["joint_position_rad"]
    assert np.array_equal(joints[:seen], np.broadcast_to(robot.robot.standing[7:], joints[:seen].shape))
    first = np.abs(joints - robot.joints()[0]).max(axis=1).argmin()
    assert seen <= first < seen + 20  # the robot sink begins there, at its slow start
    assert np.array_equal(robot.joints()[0], joints[first])


@pytest.mark.parametrize("preset", ["retarget", "tomic_2018"])
def test_waiting_and_paused_before_anybody_came_the_robot_stands(preset: str) -> None:
    plugins = Registry(entry_points=False)
    pipeline = Pipeline(load_pipeline(preset, plugins), plugins)
    frames = [f for f, _ in zip(pipeline._human_frames(pipeline.source.frames()), range(20), strict=False)]
    dt = 1.0 / pipeline.rate_hz
    standing = pipeline.robot.standing.copy()
    for k in range(20):
        pipeline.advance(Tick(k * dt, None))
        assert np.array_equal(pipeline.state.q, standing)
    pipeline.advance(Tick(20 * dt, None, "pause"))
    for k, frame in enumerate(frames):
        time_s = (21 + k) * dt
        pipeline.advance(Tick(time_s, copied(frame, time_s)))
        assert pipeline.tracking.state is State.PAUSED
        assert np.array_equal(pipeline.state.q, standing)
    pipeline.close()


# ---------------------------------------------------------------- threads


def test_whatever_fails_beside_the_steps_is_told() -> None:
    plugins = Registry(entry_points=False)
    pipeline = Pipeline(load_pipeline("retarget", plugins), plugins)
    record = pipeline.advance(Tick(0.0, next(pipeline.source.frames())))
    assert record is not None
    output = Output(pipeline.robot.twin(), pipeline.stack, [], HZ, HZ)
    output.guard.apply = None  # type: ignore[method-assign, assignment]
    output.box.put(Solved.of(record, 0.0, time.perf_counter()))
    output.start()
    output.join(5.0)
    pipeline.close()
    assert output.error is not None
    assert "commands" in str(output.error)


class Stuck(Sink[Config]):
    """Never comes back from a command."""

    name = "stuck"
    at = 10
    realtime = True
    written = 0
    free: ClassVar[threading.Event] = threading.Event()

    def open(self, run: RunInfo) -> None:
        """Nothing to do."""

    def write(self, record: Record) -> None:
        self.written += 1
        if self.written == self.at:
            Stuck.free.wait()

    def finish(self) -> SinkReport:
        raise AssertionError("it is stuck")


def test_a_sink_that_never_comes_back_ends_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imitor.live.output.STUCK_S", 0.5)
    try:
        result = authored(tmp_path, frames=2000, sinks=[Stuck])
    finally:
        Stuck.free.set()
    assert (result.status, result.frames < 1000) == ("failed", True)
    assert "sinks[2] stuck" in result.message
    assert "it has not taken a command for 0.5 s" in result.message
    assert len(np.load(tmp_path / "run/motion.npz")["time_s"]) == result.frames


def test_a_sink_that_is_stuck_at_the_end_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imitor.live.output.STUCK_S", 2.0)
    monkeypatch.setattr(Stuck, "free", threading.Event())
    monkeypatch.setattr(Stuck, "at", 45)
    try:
        result = authored(tmp_path, frames=50, sinks=[Stuck])
    finally:
        Stuck.free.set()
    assert result.status == "failed"
    assert "sinks[2] stuck: it has not taken a command" in result.message


def test_late_solutions_are_reached_over_the_time_that_they_took() -> None:
    plugins = Registry(entry_points=False)
    pipeline = Pipeline(load_pipeline("retarget", plugins), plugins)
    record = pipeline.advance(Tick(0.0, next(pipeline.source.frames())))
    assert record is not None
    robot = Kept(Config())
    robot.open(SimpleNamespace(robot=pipeline.robot, rate_hz=HZ))  # type: ignore[arg-type]
    output = Output(pipeline.robot.twin(), pipeline.stack, [("kept", robot)], HZ, HZ)
    now = time.perf_counter()
    first = Solved.of(record, 0.0, now)
    far = first.q.copy()
    far[7] += 0.1
    output.start()
    output.box.put(first)
    assert until(lambda: output.sent > 0)
    output.box.put(replace(first, q=far, ready_s=now + 0.1))
    assert until(lambda: robot.q and robot.q[-1][7] == far[7])
    output.close()
    pipeline.close()
    assert np.diff(robot.joints()[:, 0]).max() == pytest.approx(0.1 / 10, rel=1e-6)


def test_what_came_before_the_run_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take, human, used = Authored.take, Authored.human, []
    old = [Arrival(Sample(-1, 0.0, None), 0.0)]

    def noted(self: Authored, sample: Sample, time_s: float) -> HumanFrame:
        used.append(sample.counter)
        return human(self, sample, time_s)

    monkeypatch.setattr(
        Authored, "take", lambda self, timeout_s=0.0: old.pop() if old else take(self, timeout_s)
    )
    monkeypatch.setattr(Authored, "human", noted)
    authored(tmp_path, frames=3)
    assert used
    assert -1 not in used


@pytest.mark.parametrize("at_first", [True, False])
def test_orientations_that_come_and_go_are_recorded_too(
    at_first: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    human = Authored.human

    def sometimes(self: Authored, sample: Sample, time_s: float) -> HumanFrame:
        frame = human(self, sample, time_s)
        if (sample.counter % 5 == 0) == at_first:
            frame.orientation = None
        return frame

    source = Authored(LiveConfig())
    source.start()
    monkeypatch.setattr(Authored, "human", sometimes)
    recorder = ReceivedRecorder(source.skeleton, HZ, [], tmp_path)
    told = []
    for k in range(1 if at_first else 0, 20):
        tick = Tick(k / HZ, source.person(Arrival(Sample(k, 0.0, None), 0.0), k / HZ))
        recorder.add(tick)
        told.append(tick.frame)
    recorder.save(tmp_path / "received.npz")
    recorder.close()
    for live, tick in zip(told, Received(tmp_path / "received.npz").ticks(), strict=True):
        again = tick.frame
        assert live is not None
        assert again is not None
        assert (live.orientation is None) == (again.orientation is None)
        if live.orientation is not None and again.orientation is not None:
            assert np.array_equal(live.orientation, again.orientation, equal_nan=True)


# ---------------------------------------------------------------- files


def test_rows_go_on_where_a_full_disk_stopped_them(tmp_path: Path) -> None:
    rows = Rows({"time": ((), np.float64), "place": ((3,), np.float64)}, folder=tmp_path)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def add(i: int) -> None:
        arrays, k = rows.next()
        arrays["time"][k], arrays["place"][k] = i, i

    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))  # room for a block of times alone
    try:
        for i in range(512):
            add(i)
        with pytest.raises(OSError, match="large"):
            add(512)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    for i in range(512, 700):
        add(i)
    found = rows.arrays()
    assert found["time"].tolist() == list(range(700))
    assert found["place"][:, 2].tolist() == list(range(700))
    rows.close()


class Finishes(Sink[Config]):
    """Notes when it is finished."""

    name = "finishes"
    order: list[str] = []  # noqa: RUF012

    def __init__(self, name: str, realtime: bool) -> None:
        super().__init__(Config())
        self.name, self.realtime = name, realtime  # type: ignore[misc]

    def finish(self) -> SinkReport:
        Finishes.order.append(self.name)
        return SinkReport()


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), ValueError("mmap"), KeyboardInterrupt()]
)
def test_robots_are_finished_first_and_all_sinks_whatever_fails(error: BaseException, tmp_path: Path) -> None:
    def fails() -> list[Path]:
        Finishes.order.append("received")
        raise error

    Finishes.order.clear()
    plugins = Registry(entry_points=False)
    spec = load_pipeline("retarget", plugins)
    sinks = [
        ("a", Finishes("robot", True)),
        ("b", Finishes("video", False)),
        ("c", Finishes("motion", False)),
    ]
    result = RunResult(tmp_path)
    live: Any = SimpleNamespace(figures=dict, save=fails, stuck="")
    _finish(result, sinks, None, spec, plugins, live)  # type: ignore[arg-type]
    assert Finishes.order == ["robot", "received", "motion", "video"]
    assert result.status == ("interrupted" if isinstance(error, KeyboardInterrupt) else "failed")
    assert told(error) in result.message or result.status == "interrupted"


class Closes(Kept):
    """Notes that it is closed."""

    name = "closes"
    closed = 0

    def close(self) -> None:
        Closes.closed += 1


def test_an_interrupt_before_the_first_frame_closes_what_was_opened(tmp_path: Path) -> None:
    def started(pipeline: Pipeline) -> None:
        raise KeyboardInterrupt

    plugins = Registry(entry_points=False)
    plugins.add(Closes, "tests")
    spec = load_pipeline("retarget", plugins, add_sinks=["closes"])
    closed = Closes.closed
    result = run(spec, plugins, out_dir=tmp_path / "run", started=started)
    assert result.status == "interrupted"
    assert Closes.closed == closed + 1


# ---------------------------------------------------------------- the operator's terminal


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A terminal in place of the standard input; yields its other end."""
    ours, theirs = pty.openpty()
    with io.TextIOWrapper(io.BufferedReader(io.FileIO(theirs, "rb"))) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield ours


def until(done: Any) -> bool:
    end = time.perf_counter() + 5.0
    while not done() and time.perf_counter() < end:
        time.sleep(0.01)
    return bool(done())


def test_keys_that_come_together_are_all_heard(terminal: int) -> None:
    operator = Operator()
    keys = _Keys(operator)
    assert keys.begin()
    os.write(terminal, b"\x1bOR")  # F3
    time.sleep(0.05)
    os.write(terminal, b"sp")
    assert until(lambda: operator._last is Request.PAUSE)
    assert [operator.take(), operator.take()] == [Request.STOP, Request.PAUSE]
    keys.end()
    os.close(terminal)


def test_a_stop_comes_first_and_is_never_forgotten() -> None:
    operator = Operator()
    for request in [Request.PAUSE] * 100 + [Request.STOP] + [Request.RESUME] * 100 + [Request.PAUSE]:
        operator.ask(request)
    assert [operator.take() for _ in range(3)] == [Request.STOP, Request.PAUSE, Request.NONE]


def test_being_ended_while_waiting_leaves_the_terminal_as_it_was(terminal: int) -> None:
    before = termios.tcgetattr(sys.stdin)
    with pytest.raises(SystemExit) as caught, Operator().keys() as keys:
        assert keys
        assert termios.tcgetattr(sys.stdin) != before
        threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGTERM)).start()  # once more, while it ends
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5.0)
    assert caught.value.code == 128 + signal.SIGTERM
    assert termios.tcgetattr(sys.stdin) == before
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_terminal_that_goes_away_ends_the_keys_alone(terminal: int) -> None:
    keys = _Keys(Operator())
    assert keys.begin()
    os.close(terminal)
    assert until(lambda: not keys.is_alive())
    keys.end()


def test_a_lost_connection_brings_the_robot_to_rest() -> None:
    operator = Operator()
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # a background job is started to ignore it
    try:
        with operator.on_interrupt():
            os.kill(os.getpid(), signal.SIGHUP)
            os.kill(os.getpid(), signal.SIGHUP)  # shells send it once more
            assert operator.quits
            assert operator.interrupted
    finally:
        signal.signal(signal.SIGHUP, before)


# ---------------------------------------------------------------- half turns


def test_the_way_back_from_half_a_turn_has_a_direction() -> None:
    axis = np.array([[1.0, 2.0, 2.0]]) / 3.0
    for angle in (np.pi, np.pi - 1e-9, np.pi - 1e-5, np.pi - 1e-3):
        R = (
            2.0 * axis[:, :, None] * axis[:, None, :] - np.eye(3)
            if angle == np.pi
            else exponential(angle * axis)
        )
        assert exponential(logarithm(R)) == pytest.approx(R, abs=1e-9)
        assert np.linalg.norm(logarithm(R)) == pytest.approx(angle, abs=1e-9)
