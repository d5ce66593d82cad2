"""One run: a pipeline's frames into its sinks, a run directory, and the measured quality."""

from __future__ import annotations

import contextlib
import logging
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imitor.atomic import atomic
from imitor.errors import ImitorError, RunError, SinkError, told
from imitor.kinds import Record, RunInfo, Sink
from imitor.pipeline import Pipeline
from imitor.record import MOTION_FILE
from imitor.registry import Registry
from imitor.spec import PipelineSpec

log = logging.getLogger("imitor")
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
        if started is not None:
            started(pipeline)
        registry.announce("started", {"pipeline": spec.name, "out_dir": result.out_dir})
        try:
            for record in pipeline.records(max_frames):
                for where, sink in sinks:
                    _write(where, sink, record)
                result.frames += 1
                if result.frames == 1:
                    result.time_to_first_frame_s = time.perf_counter() - begin
                if progress is not None:
                    progress(result.frames, pipeline.n_frames if max_frames is None else max_frames)
        except KeyboardInterrupt:
            result.status, result.message = "interrupted", f"interrupted after {result.frames} frames"
        except RunError as error:
            result.status, result.message = "failed", str(error)
        except (
            Exception
        ) as error:  # a fault of ours or of an observer: what was finished is kept all the same
            result.status, result.message = "failed", f"after {result.frames} frames: {told(error)}"
        if result.frames == 0 and result.status == "done":
            result.status, result.message = "failed", f"source {spec.source.name} gave no frame"
        _finish(result, sinks, pipeline, spec, registry)
    finally:
        pipeline.close()
    registry.announce("finished" if result.status == "done" else "failed", {"result": result})
    return result


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
            sink.open(info)
        except Exception as error:  # nothing was run yet: what is wrong with a sink is wrong with the input
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
) -> None:
    """Let every sink finish, also after a failure of another; then measure."""
    extra: dict[str, Any] = {}
    for where, sink in reversed(sinks):  # the motion first: whatever fails later, it is there
        try:
            report = sink.finish()
            result.files += report.files
            extra.update(report.figures)
        except KeyboardInterrupt:
            result.status, result.message = "interrupted", f"{where}: interrupted while finishing"
        except Exception as error:
            text = f"{where}: {told(error)}"
            if result.status == "done":
                result.status, result.message = "failed", text
            else:
                log.error(text)
        finally:
            with contextlib.suppress(Exception):
                sink.close()
    try:
        path = result.out_dir / "pipeline.yaml"
        with atomic(path) as temporary:
            temporary.write_text(spec.to_yaml(), encoding="utf-8")
        result.files.append(path)
        if result.frames and (result.out_dir / MOTION_FILE).is_file():
            result.metrics = _measure(result, extra, pipeline, registry)
    except OSError as error:
        result.status = "failed" if result.status == "done" else result.status
        result.message = result.message or f"cannot write to {result.out_dir}: {error.strerror}"
    except Exception as error:
        result.status = "failed" if result.status == "done" else result.status
        result.message = result.message or f"the motion is kept, but cannot be measured: {told(error)}"


def _measure(
    result: RunResult, extra: dict[str, Any], pipeline: Pipeline, registry: Registry
) -> dict[str, Any]:
    from imitor import metrics

    figures = metrics.evaluate_dir(result.out_dir, registry)
    guard = pipeline.guard.report
    figures["figures"]["guard_scaled_frames"] = {"value": guard.scaled, "frames": result.frames}
    figures["figures"]["guard_held_frames"] = {"value": guard.not_finite, "frames": result.frames}
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
