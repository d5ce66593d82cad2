"""What the programs of all papers share: run a preset in process, keep every frame, measure balance and support."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from supports import executed, offsets

import imitor  # noqa: F401  (sets one BLAS thread before numpy is used)
from imitor import metrics
from imitor.kinds import Record, RunInfo
from imitor.metrics.run import Run
from imitor.pipeline import Pipeline
from imitor.record import Motion, Recorder, Reference
from imitor.registry import Registry
from imitor.safety.tracking import Request
from imitor.spec import load_pipeline
from imitor.types import SIDES, Array, BoolArray, HumanFrame
from imitor.visual.clip import make_clip

SHORTEST_S = 0.1
"""A human's single support shorter than this is taken for noise [s]."""

Observer = Callable[[Pipeline, Record], Array]


@dataclass(frozen=True)
class Case:
    """One run of an experiment: a performer's scenario or a recording.

    Attributes:
        title: For tables and figures.
        scenario: Name of the scenario; empty for a recording.
        recording: Path of the recording in the folder of captures; empty for a scenario.
        sets: Further options, as for ``--set``.
        robot: Replaces the preset's.
    """

    title: str
    scenario: str = ""
    recording: str = ""
    sets: tuple[str, ...] = ()
    robot: str = ""

    def command(self, preset: str) -> str:
        """Return what a user types for this run."""
        what = f"--input {self.recording}" if self.recording else f"--set source.scenario={self.scenario}"
        robot = [f"--robot {self.robot}"] if self.robot else []
        return " ".join([f"imitor run {preset}", what, *robot, *(f"--set {s}" for s in self.sets)])


@dataclass
class Played:
    """A finished run.

    Attributes:
        run: Motion, reference and kinematics.
        figures: As in ``metrics.json``.
        stage_s: Time of each stage in each frame, shape (T, S) [s], and the ids of the ``stages``.
        unit_s: One 30x30 SVD, timed all through the run, median [s].
        observed: What the observer gave, one row a frame.
        simulation: The verdict of physics; empty where it was not asked for.
        trace: What physics gave frame by frame, or none.
    """

    case: Case
    robot: Any
    run: Run
    figures: dict[str, Any]
    stages: list[str]
    kinds: list[str]
    stage_s: Array
    unit_s: float
    observed: Array
    simulation: dict[str, Any] = field(default_factory=dict)
    trace: Any = None

    @property
    def motion(self) -> Motion:
        """What the robot was told."""
        return self.run.motion

    @property
    def reference(self) -> Reference:
        """What the human did and what the tasks asked for."""
        return self.run.reference

    @property
    def time_s(self) -> Array:
        """Time from the first frame, shape (T,) [s]."""
        return np.asarray(self.motion.time_s - self.motion.time_s[0])

    def frame(self, role: str) -> Array:
        """Return the poses of a role's frame, world from frame, shape (T, 4, 4)."""
        clip = make_clip(self.robot, self.motion, self.reference, np.arange(len(self.run)), [role])
        return clip.frame[role]

    @property
    def human_support(self) -> BoolArray:
        """Feet of the human on the floor, shape (T, 2)."""
        return self.reference.human_support

    @property
    def human_offset(self) -> Array:
        """Offset of the human's CoM between the ankles [koenemann2014] eq. 6, shape (T,) [-]."""
        ankles = [self.reference.role(f"{side}_ankle") for side in SIDES]
        return offsets(self.reference.human_com_m, ankles, self.human_support)

    @property
    def robot_offset(self) -> Array:
        """Offset of the robot's CoM between the feet's frames [koenemann2014] eq. 6, shape (T,) [-]."""
        feet = [self.frame(f"{side}_foot")[:, :3, 3] for side in SIDES]
        return offsets(self.run.path.com, feet, self.motion.contact)

    def ms(self, first: int = 0, last: int | None = None) -> Array:
        """Return the time of each frame in some of the stages, without the first frame, shape (T-1,) [ms]."""
        return np.asarray(1e3 * self.stage_s[1:, first:last].sum(axis=1))


class Stopwatch(Pipeline):
    """A pipeline that keeps the CPU time of each stage in the last frame: other programs do not count."""

    def _bind(self) -> None:
        super()._bind()
        self.names = [where.split()[-1] for where, c in self.stages if c.kind != "filter"]
        self.stage_s = np.zeros(len(self.names))
        self._steps = [(where, self._timed(where, step)) for where, step in self._steps]

    def step(self, frame: HumanFrame, request: Request = Request.NONE) -> HumanFrame:
        """Compute a command, from 0 on the clocks."""
        self.stage_s[:] = 0.0
        return super().step(frame, request)

    def _timed(self, where: str, step: Any) -> Any:
        i = self.names.index(where.rsplit(maxsplit=1)[-1])

        def timed(frame: Any, state: Any) -> None:
            begin = time.thread_time()
            step(frame, state)
            self.stage_s[i] += time.thread_time() - begin

        return timed


def shared_folder(given: Path | None) -> Path | None:
    """Return the folder of captures: as given, or ``mocap`` in the folder that ``IMITOR_SHARED`` names."""
    named = os.environ.get("IMITOR_SHARED")
    folder = given or (Path(named) / "mocap" if named else None)
    return folder if folder is not None and folder.is_dir() else None


def play(
    preset: str,
    case: Case,
    *,
    captures: Path | None = None,
    frames: int | None = None,
    observe: Observer | None = None,
    simulate: bool = False,
) -> Played:
    """Run a preset on a case and measure it.

    Args:
        preset: Name of the pipeline.
        case: Scenario or recording.
        captures: The folder of captures.
        frames: Only so many frames.
        observe: Gives a row for every frame, read off the pipeline as it stands.
        simulate: Whether the motion is executed in physics, as with ``--simulate``.

    Raises:
        ImitorError: The preset, the robot or the recording is wrong, or a stage failed.
    """
    registry = Registry(entry_points=False)
    sets = [*([f"source.scenario={case.scenario}"] if case.scenario else []), *case.sets]
    recording = captures / case.recording if captures is not None and case.recording else None
    spec = load_pipeline(preset, registry, robot=case.robot or None, input=recording, sets=sets)
    pipeline = Stopwatch(spec, registry)
    expected = pipeline.n_frames if frames is None else min(frames, pipeline.n_frames or frames)
    info = RunInfo(
        Path(),
        pipeline.robot,
        pipeline.skeleton,
        pipeline.rate_hz,
        pipeline.stack,
        expected,
        spec.environment,
    )
    physics: Any = None
    if simulate:
        sink = registry.get("sink", "mujoco")
        physics = sink(sink.config_type(file=False))  # type: ignore[call-arg]
        physics.start()
        physics.open(info)
    recorder, spent, units, seen = Recorder(info), [], [], []
    matrix = np.random.default_rng(0).normal(size=(30, 30))
    for record in pipeline.records(frames):
        recorder.add(record)
        if physics is not None:
            physics.write(record)
        spent.append(pipeline.stage_s.copy())
        seen.append(np.zeros(0) if observe is None else observe(pipeline, record))
        begin = time.thread_time()
        np.linalg.svd(matrix)
        units.append(time.thread_time() - begin)
    kinds = [c.kind for _, c in pipeline.stages if c.kind != "filter"]
    motion, reference = recorder.motion(), recorder.reference()
    figures = metrics.evaluate(motion, reference, pipeline.robot)["figures"]
    verdict = physics.finish().figures["simulation"] if physics is not None else {}
    trace = physics.trace if physics is not None else None
    pipeline.close()
    return Played(
        case=case, robot=pipeline.robot, run=Run(motion, reference, pipeline.robot, 0), figures=figures,
        stages=pipeline.names, kinds=kinds, stage_s=np.array(spent),
        unit_s=float(np.median(units)), observed=np.array(seen), simulation=verdict, trace=trace,
    )  # fmt: skip


def support_summary(played: Played) -> tuple[str, str]:
    """Return the single supports executed of those asked for, and the mean and largest delay, as texts."""
    shortest = max(1, round(SHORTEST_S / played.run.period_s))
    pairs = list(executed(played.human_support, played.motion.contact, shortest))
    delays = [float(played.time_s[r.first] - played.time_s[h.first]) for h, r in pairs if r is not None]
    if not pairs:
        return "none asked", ""
    told = f"{np.mean(delays):.2f}, {max(delays):.2f}" if delays else "–"
    return f"{len(delays)} of {len(pairs)}", told


def skipped(cases: Sequence[Case], captures: Path | None) -> Iterator[tuple[Case, str]]:
    """Yield the recordings that are not there, and why."""
    for case in cases:
        if not case.recording:
            continue
        if captures is None:
            yield case, "no folder of captures: give --captures, or set IMITOR_SHARED"
        elif not (captures / case.recording).is_file():
            yield case, f"no file {case.recording} in the folder of captures"


def number(value: float, digits: int = 2) -> str:
    """Return a rounded number as text, never a negative zero."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"
