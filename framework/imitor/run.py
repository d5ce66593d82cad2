"""One run: a pipeline's frames into its sinks, a run directory, and the measured quality."""

from __future__ import annotations

import contextlib
import logging
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imitor.atomic import atomic
from imitor.errors import ImitorError, RunError, SinkError, told
from imitor.kinds import Record, RunInfo, Sink
from imitor.pipeline import Pipeline
from imitor.record import MOTION_FILE
from imitor.registry import Registry
from imitor.safety.tracking import OPERATOR
from imitor.spec import PipelineSpec

if TYPE_CHECKING:
    from imitor.live.operator import Operator
    from imitor.live.run import LiveRun

log = logging.getLogger("imitor")
MOST_MEASURED = 60_000
"""Longer runs are not measured when they end: their operator waits [frames]."""
FLIGHT_SHARE = 0.2
"""Share of frames without a foot on the floor above which the run asks whether that can be [-]."""

Progress = Callable[[int, int | None], None]


@dataclass
class RunResult:
    """What a run left behind.

    Attributes:
        out_dir: The run directory.
        metrics: Content of ``metrics.json``; empty when no frame was finished.
        status: ``done``, ``failed``, ``stopped`` or ``interrupted``.
        message: Why it did not end with ``done``.
        files: Files written.
        frames: Finished frames.
        time_to_first_frame_s: From the call to the first finished frame [s].
    """

    out_dir: Path
    metrics: dict[str, Any] = field(default_factory=dict)
    status: str = "done"
    message: str = ""
    files: list[Path] = field(default_factory=list)
    frames: int = 0
    time_to_first_frame_s: float = 0.0


def run(
    spec: PipelineSpec,
    registry: Registry,
    *,
    out_dir: Path | None = None,
    max_frames: int | None = None,
    view: bool = False,
    progress: Progress | None = None,
    started: Callable[[Pipeline], None] | None = None,
    operator: Operator | None = None,
    observe: Callable[[LiveRun], None] | None = None,
) -> RunResult:
    """Run a pipeline to its end, an error, or an interruption; finished frames are kept in every case.

    Args:
        spec: The validated pipeline.
        registry: Where the plugins are.
        out_dir: The run directory; default ``runs/<name>``, numbered when it exists.
        max_frames: Stop after so many frames.
        view: Open the windows of sinks that have one.
        progress: Called after every frame with frames done and expected.
        started: Called once with the built pipeline, before the first frame.
        operator: Who may pause, resume, stop and end a live run; by default Ctrl-C ends it.
        observe: Called once with a live run, before its first step; its figures may be read from another thread.

    Raises:
        ImitorError: Nothing was run: input, robot, options or folder are wrong.
    """
    begin = time.perf_counter()
    pipeline = Pipeline(spec, registry)
    registry.announce("built", {"pipeline": spec.name, "robot": pipeline.robot.name})
    try:
        result = RunResult(_run_directory(out_dir, spec.name))
        try:
            sinks = _open_sinks(spec, registry, pipeline, result, max_frames, view)
        except ImitorError:
            with contextlib.suppress(OSError):  # leave no empty folder behind
                result.out_dir.rmdir()
            raise

        def finished(frames: int) -> None:
            result.frames = frames
            if frames == 1:
                result.time_to_first_frame_s = time.perf_counter() - begin
            if progress is not None:
                progress(frames, pipeline.n_frames if max_frames is None else max_frames)

        live: LiveRun | None = None
        try:  # from here on sinks are open, robots reached: whatever happens, they are finished
            if started is not None:
                started(pipeline)
            registry.announce("started", {"pipeline": spec.name, "out_dir": result.out_dir})
            live = _live_run(pipeline, sinks, result, operator)
            if live is None:
                for i, record in enumerate(pipeline.records(max_frames)):
                    for where, sink in sinks:
                        _write(where, sink, record)
                    finished(i + 1)
            else:
                if observe is not None:
                    observe(live)
                _drive(live, result, max_frames, finished)
        except KeyboardInterrupt:
            result.status, result.message = "interrupted", f"interrupted after {result.frames} frames"
        except RunError as error:
            result.status, result.message = "failed", str(error)
        except (
            Exception
        ) as error:  # a fault of ours or of an observer: what was finished is kept all the same
            result.status, result.message = "failed", f"after {result.frames} frames: {told(error)}"
        if result.status == "done" and pipeline.tracking.report.stops:
            result.status, result.message = "stopped", _stop_message(pipeline)
        if result.frames == 0 and result.status == "done":
            result.status, result.message = "failed", f"source {spec.source.name} gave no frame"
        _finish(result, sinks, pipeline, spec, registry, live)
    finally:
        pipeline.close()
    registry.announce("finished" if result.status == "done" else "failed", {"result": result})
    return result


def _live_run(
    pipeline: Pipeline, sinks: Sequence[tuple[str, Sink[Any]]], result: RunResult, operator: Operator | None
) -> LiveRun | None:
    """Return the live run of a pipeline with a live source, else ``None``."""
    if not pipeline.source.live:
        return None
    from imitor.live.operator import Operator
    from imitor.live.run import LiveRun

    return LiveRun(pipeline, sinks, result.out_dir, operator or Operator(), _write)


def _drive(live: LiveRun, result: RunResult, max_frames: int | None, finished: Callable[[int], None]) -> None:
    with live.operator.on_interrupt():
        live.drive(max_frames, finished)
    if live.operator.interrupted:
        result.status, result.message = "interrupted", f"interrupted after {result.frames} frames"


def _stop_message(pipeline: Pipeline) -> str:
    tracking = pipeline.tracking
    times = "" if tracking.report.stops == 1 else f"; {tracking.report.stops} stops in all"
    remedy = (
        "; to go on once all is seen again: --set tracking.resume=automatic"
        if tracking.options.resume == "request" and tracking.why != OPERATOR
        else ""
    )
    return (
        f"emergency stop at {tracking.stopped_at_s:.3f} s: {tracking.why}; the robot kept its last "
        f"safe command{times}{remedy}"
    )


def _run_directory(out_dir: Path | None, name: str) -> Path:
    if out_dir is None:
        stem = Path("runs") / (name or "run")
        out_dir, k = stem, 2
        while out_dir.exists():
            out_dir, k = stem.with_name(f"{stem.name}-{k}"), k + 1
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out_dir):
            pass
    except OSError as error:
        raise ImitorError(
            f"cannot write to the run directory {out_dir}: {error.strerror}; choose another with --out"
        ) from None
    return out_dir


def _open_sinks(
    spec: PipelineSpec,
    registry: Registry,
    pipeline: Pipeline,
    result: RunResult,
    max_frames: int | None,
    view: bool,
) -> list[tuple[str, Sink[Any]]]:
    n = pipeline.n_frames
    info = RunInfo(
        out_dir=result.out_dir,
        robot=pipeline.robot,
        skeleton=pipeline.skeleton,
        rate_hz=pipeline.rate_hz,
        stack=pipeline.stack,
        n_frames=n if max_frames is None or n is None else min(n, max_frames),
        environment=spec.environment,
        pipeline=spec.to_yaml(),
        pipeline_name=spec.name,
        view=view,
        live=pipeline.source.live,
    )
    sinks: list[tuple[str, Sink[Any]]] = []
    if not any(s.name == "motion_file" for s in spec.sinks):  # a run directory always holds the motion
        recorder = registry.get("sink", "motion_file")
        sinks.append(("motion_file", recorder(recorder.config_type())))  # type: ignore[arg-type]
    for stage in spec.sinks:
        sinks.append((f"{stage.where} {stage.id}", registry.get("sink", stage.name)(stage.config)))  # type: ignore[arg-type]
    sinks.sort(key=lambda item: item[1].name == "motion_file")  # last: a frame counts when every sink has it
    for where, sink in sinks:
        try:
            sink.start()
            apart = info.live and (sink.realtime or sink.newest)  # they look at the robot from another thread
            rate_hz = pipeline.output_hz if info.live and sink.realtime else info.rate_hz
            sink.open(replace(info, robot=pipeline.robot.twin(), rate_hz=rate_hz) if apart else info)
        except BaseException as error:  # nothing was run yet: a sink's fault is one of the input
            for _, opened in sinks[: sinks.index((where, sink))]:  # a robot is connected by now
                with contextlib.suppress(Exception):
                    opened.close()
            if not isinstance(error, Exception):
                raise
            raise ImitorError(f"{where}: {told(error)}") from error
    return sinks


def _write(where: str, sink: Sink[Any], record: Record) -> None:
    try:
        sink.write(record)
    except Exception as error:  # a failing sink ends the run with what was finished kept
        raise SinkError(
            f"{told(error)}. The frames before are kept.",
            frame=record.index,
            time_s=record.time_s,
            stage=where,
        ) from error


def _finish(
    result: RunResult,
    sinks: Sequence[tuple[str, Sink[Any]]],
    pipeline: Pipeline,
    spec: PipelineSpec,
    registry: Registry,
    live: LiveRun | None,
) -> None:
    """Let every sink finish, also after a failure of another; then measure."""
    extra: dict[str, Any] = {}
    if live is not None:
        extra["live"] = live.figures()
    robots = [item for item in sinks if item[1].realtime]  # first of all: they are to be at rest
    stuck = "" if live is None else live.stuck
    for where, sink in robots:
        if where != stuck:
            _finish_sink(where, sink, result, extra)
    if live is not None:
        with _finishing("what was received", result):
            result.files += live.save()
    for where, sink in reversed(sinks):  # then the motion: whatever fails later, it is there
        if not sink.realtime:
            _finish_sink(where, sink, result, extra)
    try:
        path = result.out_dir / "pipeline.yaml"
        with atomic(path) as temporary:
            temporary.write_text(spec.to_yaml(), encoding="utf-8")
        result.files.append(path)
        if result.frames > MOST_MEASURED:
            log.warning(
                f"{result.frames} frames are not measured now; imitor evaluate {result.out_dir} does it"
            )
            result.metrics = _unmeasured(result, extra, pipeline)
        elif result.frames and (result.out_dir / MOTION_FILE).is_file():
            result.metrics = _measure(result, extra, pipeline, registry)
    except OSError as error:
        result.status = "failed" if result.status == "done" else result.status
        result.message = result.message or f"cannot write to {result.out_dir}: {error.strerror}"
    except Exception as error:
        result.status = "failed" if result.status == "done" else result.status
        result.message = result.message or f"the motion is kept, but cannot be measured: {told(error)}"


def _finish_sink(where: str, sink: Sink[Any], result: RunResult, extra: dict[str, Any]) -> None:
    try:
        with _finishing(where, result):
            report = sink.finish()
            result.files += report.files
            extra.update(report.figures)
    finally:
        with contextlib.suppress(Exception):
            sink.close()


@contextlib.contextmanager
def _finishing(where: str, result: RunResult) -> Iterator[None]:
    """Let what fails at the end, or is interrupted, leave the rest its turn."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        result.status, result.message = "interrupted", f"{where}: interrupted while finishing"
    except Exception as error:
        text = f"{where}: {told(error)}"
        if result.status == "done":
            result.status, result.message = "failed", text
        else:
            log.error(text)


def _measure(
    result: RunResult, extra: dict[str, Any], pipeline: Pipeline, registry: Registry
) -> dict[str, Any]:
    from imitor import metrics

    figures = metrics.evaluate_dir(result.out_dir, registry)
    return _written(figures, result, extra, pipeline)


def _unmeasured(result: RunResult, extra: dict[str, Any], pipeline: Pipeline) -> dict[str, Any]:
    """Write what is known of a run without measuring its frames."""
    from imitor import metrics

    figures = {"schema": metrics.SCHEMA, "robot": pipeline.robot.name, "frames": result.frames, "figures": {}}
    return _written(figures, result, extra, pipeline)


def _written(
    figures: dict[str, Any], result: RunResult, extra: dict[str, Any], pipeline: Pipeline
) -> dict[str, Any]:
    from imitor import metrics

    guard = pipeline.guard.report
    figures["figures"]["guard_scaled_frames"] = {"value": guard.scaled, "frames": result.frames}
    figures["figures"]["guard_held_frames"] = {"value": guard.not_finite, "frames": result.frames}
    figures["tracking"] = pipeline.tracking.report.figures()
    figures["status"], figures["message"] = result.status, result.message
    figures["source"] = {"skeleton": pipeline.skeleton.name, "notes": list(pipeline.skeleton.notes)}
    figures.update(extra)
    flight = figures["figures"].get("flight_frames", {}).get("share", 0.0)
    stands = pipeline.stack.anchor in ("", "left_foot", "right_foot")  # else it is held elsewhere
    if flight > FLIGHT_SHARE and stands:
        log.warning(
            f"no foot touches the floor in {100 * flight:.0f} % of the frames: does the recording jump that much, "
            "or is its floor elsewhere (--set source.floor=...) or the support filter too strict?"
        )
    path = result.out_dir / "metrics.json"
    metrics.write(figures, path)
    result.files.append(path)
    return dict(figures)
