"""Whole runs: every robot and solver, and every way in which a run can end before its end."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import Field

from imitor import (
    Config,
    Configuration,
    Filter,
    HumanFrame,
    Record,
    RunInfo,
    Sink,
    SinkReport,
    Solver,
    Source,
    Stabilizer,
    Strictness,
    TaskKind,
    TaskStack,
)
from imitor.cli import main
from imitor.errors import ImitorError, NoSolution, SinkError
from imitor.kinds import WHOLE_RECORDING
from imitor.pipeline import Pipeline
from imitor.record import Motion, Reference
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.run import RunResult, run
from imitor.spec import load_pipeline, load_text
from imitor.testing import make_frames, make_robot, make_skeleton

ROOT = Path(__file__).resolve().parents[1]
ROBOTS = ("unitree_g1", "romeo", "talos")
SOLVERS = tuple(Registry(entry_points=False).names("solver"))
ORDER = """\
    order:
      - [left_foot, right_foot]
      - [left_upper_arm, right_upper_arm, left_forearm, right_forearm, left_thigh, right_thigh, left_shank, right_shank,
         torso]
      - [waist, chest]
"""


def text(
    *, source: str = "{use: performer, scenario: step_forward, rate_hz: 60}", filters: Sequence[str] = (),
    late: Sequence[str] = (), solver: str = "prioritized", robot: str = "unitree_g1", sinks: Sequence[str] = (),
    more: str = "",
) -> str:  # fmt: skip
    """Return a pipeline."""
    lines = ["imitor: 1", f"robot: {robot}", *([more] if more else []), f"source: {source}", "stages:"]
    lines += [f"  - filter: {f}" for f in ("support_by_height", "human_com", *filters)]
    lines += ["  - mapper: segment_scaling", *(f"  - {entry}" for entry in late if "solver" not in entry)]
    lines += [f"  - solver: {solver}", "    id: solve", ORDER.rstrip()]
    lines += [f"  - {entry}" for entry in late if "solver" in entry]
    lines += ["sinks:", *(f"  - {{use: {s}}}" for s in ("motion_file", *sinks))]
    return "\n".join(lines) + "\n"


# ---------------------------------------------------------------- plugins that misbehave


class AtFrame(Config):
    frame: int = Field(20, ge=0, description="The frame at which it happens [-].")
    how: str = Field("", description="What happens.")


class FailingSink(Sink[AtFrame]):
    """Fail at a frame."""

    name = "failing"
    ERRORS: ClassVar[Mapping[str, Callable[[], BaseException]]] = {
        "disk": lambda: OSError(28, "No space left on device"),
        "sink": lambda: SinkError("the robot does not answer"),
        "interrupt": KeyboardInterrupt,
    }

    def write(self, record: Record) -> None:
        if record.index == self.config.frame:
            raise self.ERRORS[self.config.how]()


class FailingAtTheEnd(Sink[Config]):
    """Fail when finishing."""

    name = "failing_late"

    def write(self, record: Record) -> None:
        """Take nothing."""

    def finish(self) -> SinkReport:
        raise OSError(28, "No space left on device")


class RaisingSolver(Solver[AtFrame]):
    """Find no solution at a frame."""

    name = "raising"
    serves: ClassVar[Mapping[TaskKind, Strictness]] = {TaskKind.COM: Strictness.WEIGHTED}

    def prepare(self, stack: TaskStack) -> None:
        self.count = 0

    def reset(self) -> None:
        self.count = 0

    def step(self, stack: TaskStack, state: Configuration) -> None:
        if self.count == self.config.frame:
            if self.config.how == "numpy":
                np.linalg.cholesky(-np.eye(2))
            raise NoSolution("'left_foot' is hard and 0.31 m out of reach")
        self.count += 1


class BreakingFilter(Filter[AtFrame]):
    """Give no numbers from a frame on, for ten frames."""

    name = "breaking"

    def reset(self) -> None:
        self.count = 0

    def step(self, frame: HumanFrame) -> HumanFrame:
        i, self.count = self.count, self.count + 1
        if self.config.frame <= i < self.config.frame + 10:
            return replace(frame, position=np.full_like(frame.position, np.nan))
        return frame


class BreakingSolver(RaisingSolver):
    """Leave no numbers for ten frames."""

    name = "breaking_solver"

    def step(self, stack: TaskStack, state: Configuration) -> None:
        if self.config.frame <= self.count < self.config.frame + 10:
            state.q[:] = np.nan
        self.count += 1


class Leaping(RaisingSolver):
    """Jump to the limits and back."""

    name = "leaping"

    def step(self, stack: TaskStack, state: Configuration) -> None:
        robot = self.robot
        state.q[7:] = robot.upper + 1.0 if self.count // 10 % 2 else robot.lower - 1.0
        robot.update(state.q)
        self.count += 1


class Delayed(Stabilizer[Config]):
    """Give targets five frames later."""

    name = "delayed"

    @property
    def delay_frames(self) -> int:
        return 5

    def reset(self) -> None:
        self.queue: deque[Any] = deque()

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        now = (stack.flat_target.copy(), stack.flat_switch.copy(), stack.anchor, stack.anchor_pose.copy(),
               stack.contact.copy())  # fmt: skip
        self.queue.append(now)
        if len(self.queue) > 6:
            self.queue.popleft()
        stack.flat_target[:], stack.flat_switch[:], stack.anchor = self.queue[0][:3]
        stack.anchor_pose[:], stack.contact[:] = self.queue[0][3:]


class SeenConfig(Config):
    seconds: float | None = Field(None, description="How much it wants to see; none: all [s].")


class Calibrated(Stabilizer[SeenConfig]):
    """Look at the recording first."""

    name = "calibrated"
    seen: ClassVar[list[Sequence[HumanFrame]]] = []
    delay = 0

    @property
    def calibration_s(self) -> float:
        return WHOLE_RECORDING if self.config.seconds is None else self.config.seconds

    def calibrate(self, frames: Sequence[HumanFrame]) -> None:
        Calibrated.seen.append(frames)

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Change nothing."""


class LateFilter(Filter[SeenConfig]):
    """Count the frames it is asked to see."""

    name = "late"
    seen: ClassVar[list[int]] = []

    @property
    def calibration_s(self) -> float:
        return self.config.seconds or 0.0

    def calibrate(self, frames: Sequence[HumanFrame]) -> None:
        LateFilter.seen.append(len(frames))

    def step(self, frame: HumanFrame) -> HumanFrame:
        return frame


class Still(Source[Config]):
    """Stand, live."""

    name = "live_stand"
    live = True

    def start(self) -> None:
        self.skeleton, self.rate_hz = make_skeleton(), 30.0

    def frames(self) -> Iterator[HumanFrame]:
        yield from make_frames("stand", 30)


class Silent(Still):
    """Yield no frame."""

    name = "silent"
    live = False

    def frames(self) -> Iterator[HumanFrame]:
        yield from ()


TOYS = [
    FailingSink, FailingAtTheEnd, RaisingSolver, BreakingFilter, BreakingSolver, Leaping, Delayed, Calibrated,
    LateFilter, Still, Silent,
]  # fmt: skip


@pytest.fixture
def registry() -> Registry:
    registry = Registry(entry_points=False)
    registry.register(SimpleNamespace(imitor_components=lambda: TOYS), "toys")
    return registry


def done(registry: Registry, folder: Path, max_frames: int | None = None, **parts: Any) -> RunResult:
    return run(load_text(text(**parts), registry), registry, out_dir=folder / "out", max_frames=max_frames)


def check_motion(motion: Motion, robot: RobotModel) -> None:
    """Check that a motion is finite, within limits and within speed at its rate."""
    q = motion.joint_position_rad
    assert np.isfinite(motion.configurations()).all()
    np.testing.assert_allclose(np.linalg.norm(motion.root_quaternion_wxyz, axis=1), 1.0, atol=1e-9)
    assert (q >= robot.lower).all() and (q <= robot.upper).all()
    if len(motion) > 1:
        steps, dt = np.abs(np.diff(q, axis=0)), 1.0 / motion.rate_hz
        assert (steps <= robot.speed * dt + 1e-9).all()


# ---------------------------------------------------------------- robots and solvers


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robot_with_every_solver(registry: Registry, tmp_path: Path, robot: str, solver: str) -> None:
    source = "{use: performer, scenario: wave, rate_hz: 30}"
    result = done(registry, tmp_path, 60, robot=robot, solver=solver, source=source)
    assert (result.status, result.message, result.frames) == ("done", "", 60)
    motion, reference = (
        Motion.load(result.out_dir / "motion.npz"),
        Reference.load(result.out_dir / "reference.npz"),
    )
    assert len(motion) == len(reference.time_s) == 60
    assert motion.robot == robot
    assert set(motion.status) == {"ok"}
    np.testing.assert_allclose(motion.time_s, np.arange(60) / 30.0, atol=1e-9)
    check_motion(motion, make_robot(robot))
    metrics = json.loads((result.out_dir / "metrics.json").read_text())
    assert metrics["frames"] == 60
    assert metrics["status"] == "done"
    assert {p.name for p in result.files} == {p.name for p in result.out_dir.iterdir()}


def test_the_resolved_pipeline_runs_to_the_same_motion(registry: Registry, tmp_path: Path) -> None:
    first = done(registry, tmp_path, 30)
    spec = load_pipeline(str(first.out_dir / "pipeline.yaml"), registry)
    second = run(spec, registry, out_dir=tmp_path / "again", max_frames=30)
    assert (first.out_dir / "motion.npz").read_bytes() == (second.out_dir / "motion.npz").read_bytes()


# ---------------------------------------------------------------- ends before the end


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("disk", "frame 20 (t=0.333 s), sinks[1] failing: No space left on device"),
        ("sink", "frame 20 (t=0.333 s), sinks[1] failing: the robot does not answer"),
    ],
)
def test_a_sink_that_fails_ends_the_run_and_keeps_the_frames(
    registry: Registry, tmp_path: Path, how: str, said: str
) -> None:
    result = done(registry, tmp_path, sinks=[f"failing, how: {how}"])
    assert (result.status, result.frames) == ("failed", 20)
    assert result.message.startswith(said)
    assert len(Motion.load(result.out_dir / "motion.npz")) == 20
    assert result.metrics["status"] == "failed"


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("", "frame 20 (t=0.333 s), stages[4] raising: 'left_foot' is hard and 0.31 m out of reach"),
        ("numpy", "frame 20 (t=0.333 s), stages[4] raising: LinAlgError: Matrix is not positive definite"),
    ],
)
def test_a_solver_that_raises_ends_the_run_and_keeps_the_frames(
    registry: Registry, tmp_path: Path, how: str, said: str
) -> None:
    result = done(registry, tmp_path, late=[f"{{solver: raising, frame: 20, how: '{how}'}}"])
    assert (result.status, result.frames) == ("failed", 20)
    assert result.message.startswith(said)
    assert len(Motion.load(result.out_dir / "motion.npz")) == 20


@pytest.mark.parametrize("where", ["sink", "progress"])
def test_an_interrupted_run_keeps_the_frames(registry: Registry, tmp_path: Path, where: str) -> None:
    def progress(done: int, expected: int | None) -> None:
        if where == "progress" and done == 20:
            raise KeyboardInterrupt

    sinks = ["failing, how: interrupt"] if where == "sink" else []
    spec = load_text(text(sinks=sinks), registry)
    result = run(spec, registry, out_dir=tmp_path / "out", progress=progress)
    assert (result.status, result.frames) == ("interrupted", 20)
    assert result.message == "interrupted after 20 frames"
    assert len(Motion.load(result.out_dir / "motion.npz")) == 20
    assert (result.out_dir / "pipeline.yaml").is_file()


def test_a_sink_that_fails_at_the_end_keeps_the_others(registry: Registry, tmp_path: Path) -> None:
    result = done(registry, tmp_path, 15, sinks=["failing_late", "csv"])
    assert result.status == "failed"
    assert "No space left on device" in result.message
    assert len(Motion.load(result.out_dir / "motion.npz")) == 15
    assert (result.out_dir / "motion.csv").is_file()


def test_exit_status_and_message_of_a_failed_run(
    registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("imitor.cli.common.make_registry", lambda without=(): registry)
    for how, status in (("disk", 1), ("interrupt", 130)):
        path = tmp_path / f"{how}.yaml"
        path.write_text(text(sinks=[f"failing, how: {how}"]))
        assert main(["run", str(path), "--out", str(tmp_path / how), "--quiet"]) == status
        assert "Traceback" not in capsys.readouterr().err
        assert len(Motion.load(tmp_path / how / "motion.npz")) == 20


def test_no_frame_at_all(registry: Registry, tmp_path: Path) -> None:
    result = done(registry, tmp_path, source="{use: silent}")
    assert result.frames == 0
    assert not (result.out_dir / "motion.npz").exists()
    assert result.metrics == {}


# ---------------------------------------------------------------- the guard holds


def test_lost_numbers_of_the_human_do_not_reach_the_robot(registry: Registry, tmp_path: Path) -> None:
    """A filter that breaks its contract: positions are NaN though the flags say they are known."""
    result = done(registry, tmp_path, 60, filters=["breaking"])
    motion = Motion.load(result.out_dir / "motion.npz")
    assert (result.status, len(motion)) == ("done", 60)
    check_motion(motion, make_robot())
    assert set(motion.status[:20]) == {"ok"}
    assert motion.status[59] == "ok"
    lost = motion.joint_position_rad[20:30]
    assert np.ptp(lost, axis=0).max() < 0.05  # it stays about where it was


def test_lost_numbers_of_the_solver_are_held(registry: Registry, tmp_path: Path) -> None:
    result = done(registry, tmp_path, 60, late=["{solver: breaking_solver, frame: 20}"])
    assert result.status == "done"
    motion = Motion.load(result.out_dir / "motion.npz")
    check_motion(motion, make_robot())
    assert list(motion.status) == ["ok"] * 20 + ["held"] * 10 + ["ok"] * 30
    held = motion.configurations()[19:30]
    np.testing.assert_array_equal(held, held[:1].repeat(11, axis=0))
    assert result.metrics["figures"]["guard_held_frames"]["value"] == 10


@pytest.mark.parametrize("robot", ROBOTS)
def test_leaps_are_slowed_down(registry: Registry, tmp_path: Path, robot: str) -> None:
    result = done(registry, tmp_path, 60, robot=robot, late=["{solver: leaping}"])
    check_motion(Motion.load(result.out_dir / "motion.npz"), make_robot(robot))
    assert result.metrics["figures"]["guard_scaled_frames"]["value"] > 40


# ---------------------------------------------------------------- time


def test_frames_are_as_many_as_asked_for(registry: Registry, tmp_path: Path) -> None:
    counts: list[tuple[int, int | None]] = []
    spec = load_text(text(), registry)
    progress = lambda done, expected: counts.append((done, expected))  # noqa: E731
    result = run(spec, registry, out_dir=tmp_path / "out", max_frames=7, progress=progress)
    assert result.frames == 7
    assert counts == [(k, 7) for k in range(1, 8)]
    assert len(Motion.load(result.out_dir / "motion.npz")) == 7


@pytest.mark.parametrize("rate_hz", [None, 25.0, 60.0, 100.0])
def test_a_whole_run_has_the_frames_it_promises(registry: Registry, rate_hz: float | None) -> None:
    more = f"rate_hz: {rate_hz}" if rate_hz else ""
    source = "{use: performer, scenario: t_pose, rate_hz: 30}"
    pipeline = Pipeline(load_text(text(more=more, source=source), registry), registry)
    times = [record.time_s for record in pipeline.records()]
    pipeline.close()
    assert len(times) == pipeline.n_frames
    np.testing.assert_allclose(np.diff(times), 1.0 / pipeline.rate_hz, atol=1e-9)


def test_settling_holds_the_last_human(registry: Registry) -> None:
    source = "{use: performer, scenario: t_pose, rate_hz: 30, duration_s: 1}"
    pipeline = Pipeline(load_text(text(more="settle_s: 0.5", source=source), registry), registry)
    times, humans = [], []
    for record in pipeline.records():
        times.append(record.time_s)
        humans.append(record.human.position.copy())
    pipeline.close()
    moving = len(make_frames("t_pose")) - 90  # 1 of 4 s
    assert len(times) == pipeline.n_frames == moving + 15
    np.testing.assert_allclose(times, np.arange(len(times)) / 30.0, atol=1e-9)
    for human in humans[-15:]:
        np.testing.assert_array_equal(human, humans[moving - 1])


def recorded(registry: Registry, max_frames: int | None = None, **parts: Any) -> dict[str, np.ndarray]:
    """Run the stages and return times, human time stamps and the forearm's targets."""
    pipeline = Pipeline(load_text(text(**parts), registry), registry)
    rows: dict[str, list[Any]] = {k: [] for k in ("index", "time", "human_time", "point", "target", "q")}
    for record in pipeline.records(max_frames):
        rows["index"].append(record.index)
        rows["time"].append(record.time_s)
        rows["human_time"].append(record.human.time_s)
        rows["point"].append(record.human.position[5].copy())
        rows["target"].append(record.stack["left_forearm"].target.copy())
        rows["q"].append(record.state.q.copy())
    pipeline.close()
    return {name: np.array(column) for name, column in rows.items()}


def test_a_delay_shifts_time_and_loses_no_frame(registry: Registry) -> None:
    source = "{use: performer, scenario: wave, rate_hz: 20}"
    plain, delayed = (
        recorded(registry, source=source),
        recorded(registry, source=source, late=["stabilizer: delayed"]),
    )
    np.testing.assert_array_equal(delayed["index"], plain["index"])
    np.testing.assert_allclose(delayed["time"], plain["time"], atol=1e-9)
    np.testing.assert_allclose(delayed["human_time"], plain["human_time"], atol=1e-9)
    np.testing.assert_array_equal(delayed["point"], plain["point"])
    np.testing.assert_array_equal(delayed["target"], plain["target"])


def test_a_delay_does_not_change_how_many_frames_are_asked_for(registry: Registry) -> None:
    assert len(recorded(registry, 12, late=["stabilizer: delayed"])["time"]) == 12


# ---------------------------------------------------------------- calibration


def test_a_stage_sees_the_seconds_it_asks_for(registry: Registry) -> None:
    Calibrated.seen.clear()
    LateFilter.seen.clear()
    source = "{use: performer, scenario: step_forward, rate_hz: 50}"
    filters = ["late\n    seconds: 0.5"]
    result = recorded(
        registry, 5, source=source, filters=filters, late=["{stabilizer: calibrated, seconds: 1.0}"]
    )
    ((frames,),) = [Calibrated.seen]
    assert [f.time_s for f in frames] == pytest.approx(np.arange(51) / 50.0)
    assert all(f.support is not None and f.com is not None for f in frames)  # they went through the filters
    assert LateFilter.seen == [26]
    assert result["time"][0] == 0.0  # and the run begins at the beginning


def test_a_stage_sees_the_whole_recording(registry: Registry) -> None:
    Calibrated.seen.clear()
    source = "{use: performer, scenario: t_pose, rate_hz: 30}"
    recorded(registry, 3, source=source, late=["stabilizer: calibrated"])
    assert len(Calibrated.seen[0]) == len(make_frames("t_pose"))


def test_calibration_changes_nothing_else(registry: Registry) -> None:
    plain = recorded(registry, 20)
    seen = recorded(registry, 20, late=["stabilizer: calibrated"])
    np.testing.assert_array_equal(plain["q"], seen["q"])


def test_the_whole_recording_is_refused_live(registry: Registry) -> None:
    spec = load_text(text(source="{use: live_stand}", late=["stabilizer: calibrated"]), registry)
    with pytest.raises(ImitorError) as caught:
        Pipeline(spec, registry)
    assert str(caught.value) == (
        "stages[3] calibrated: needs the whole recording first, but the source is live; give its result as options"
    )


@pytest.mark.parametrize("preset", sorted(p.stem for p in (ROOT / "pipelines").glob("*.yaml")))
def test_a_preset_that_cannot_be_built_says_why(preset: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(self: Pipeline) -> None:
        raise ImitorError("not so")

    monkeypatch.setattr(Pipeline, "_calibrate", fails)
    registry = Registry(entry_points=False)
    # And not what then happens when the stages are closed.
    with pytest.raises(ImitorError, match=r"^not so$"):
        Pipeline(load_pipeline(preset, registry), registry)


# ---------------------------------------------------------------- folders


class Connected(Sink[Config]):
    """Says when it is let go."""

    name = "connected"
    closed: ClassVar[int] = 0

    def write(self, record: Record) -> None:
        raise AssertionError("nothing is run")

    def close(self) -> None:
        Connected.closed += 1


class Unreachable(Connected):
    """Cannot be opened."""

    name = "unreachable"

    def open(self, run: RunInfo) -> None:
        raise SinkError("nobody there")


def test_where_one_sink_cannot_be_opened_the_others_are_closed(
    registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Connected, "closed", 0)
    for sink in (Connected, Unreachable):
        registry.add(sink, "tests")
    with pytest.raises(ImitorError, match=r"^sinks\[2\] unreachable: nobody there$"):
        done(registry, tmp_path / "run", sinks=("connected", "unreachable"))
    assert Connected.closed == 1
    assert not (tmp_path / "run" / "out").exists()


def test_a_folder_that_cannot_be_written_is_told_before_anything_runs(
    registry: Registry, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    ran: list[int] = []
    spec = load_text(text(), registry)
    with pytest.raises(ImitorError) as caught:
        run(spec, registry, out_dir=tmp_path / "file" / "out", progress=lambda done, _: ran.append(done))
    assert str(caught.value).startswith(f"cannot write to the run directory {tmp_path / 'file' / 'out'}: ")
    assert "choose another with --out" in str(caught.value)
    assert caught.value.exit_status == 2
    assert ran == []


def test_runs_without_a_folder_are_numbered(
    registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = load_text(text(), registry, path="dance.yaml")
    names = [run(spec, registry, max_frames=2).out_dir for _ in range(3)]
    assert [str(n) for n in names] == ["runs/dance", "runs/dance-2", "runs/dance-3"]


# ---------------------------------------------------------------- the shared captures


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_every_shared_recording(registry: Registry, shared: Path, robot: str, solver: str) -> None:
    """Five seconds of each recording at 30 Hz: finite, within limits, within speed."""
    files = sorted((shared / "mocap").rglob("*.bvh"))
    assert len(files) >= 20
    model = make_robot(robot)
    for path in files:
        spec = load_pipeline("retarget", registry, robot=robot, input=path, uses=[f"solve={solver}"])
        pipeline = Pipeline(replace(spec, rate_hz=30.0), registry)
        q = np.array([record.state.q.copy() for record in pipeline.records(150)])
        pipeline.close()
        assert np.isfinite(q).all(), path.name
        assert (q[:, 7:] >= model.lower).all() and (q[:, 7:] <= model.upper).all(), path.name
        assert (np.abs(np.diff(q[:, 7:], axis=0)) <= model.speed / 30.0 + 1e-9).all(), path.name
