"""Checks of a sink: it keeps what it needs, and its files appear whole at the end or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.kinds import Sink, SinkReport
from imitor.testing import stacks
from imitor.testing.expect import attempt, build, expect
from imitor.testing.fixtures import Run, make_robot, make_run
from imitor.testing.frames import check_untouched, snapshot
from imitor.testing.lifecycle import end

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

FRAMES: Final = 12
_REPEATABLE: Final = (".npz", ".csv", ".txt", ".json", ".yaml")
"""Formats whose bytes follow from the frames alone."""


def check_sink(
    cls: type[Sink[Any]], config: Mapping[str, Any] | None = None, *, robot: RobotModel | None = None
) -> None:
    """Check a sink on a whole run, on one that failed early, and on one without frames."""
    robot = robot or make_robot()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = _write(cls, config, make_run(_made(folder / "whole"), FRAMES, robot=robot), FRAMES)
        _check_length(cls, whole, FRAMES)
        if any(path.suffix in _REPEATABLE for path in whole):
            again = _write(
                cls, config, make_run(_made(folder / "again"), FRAMES, robot=robot), FRAMES, spoil=True
            )
            for path, other in zip(whole, again, strict=True):
                if path.suffix not in _REPEATABLE:
                    continue
                same = path.read_bytes() == other.read_bytes()
                expect(
                    same,
                    cls,
                    f"{path.name} changes with what happens to the frames after `write`; copy the arrays",
                )
        part = _write(cls, config, make_run(_made(folder / "part"), FRAMES, robot=robot), FRAMES // 2)
        _check_length(cls, part, FRAMES // 2)
        _write(cls, config, make_run(_made(folder / "none"), FRAMES, robot=robot), 0)


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _write(
    cls: type[Sink[Any]], config: Mapping[str, Any] | None, run: Run, n: int, *, spoil: bool = False
) -> list[Path]:
    """Write the first n frames of a run and return the files."""
    out_dir, robot = run.info.out_dir, run.info.robot
    sink = build(cls, config)
    attempt(cls, "start()", sink.start)
    attempt(cls, "open()", lambda: sink.open(run.info))
    record = None
    for record in run.records():
        if record.index >= n:
            break
        which = f"frame {record.index}"
        human, before, tasks = record.human, snapshot(record.human), stacks.snapshot(run.info.stack)
        q, com = record.state.q.copy(), robot.com.copy()
        record.state.q.flags.writeable = False
        attempt(cls, f"write() of {which}", lambda r=record: sink.write(r))  # type: ignore[misc]
        record.state.q.flags.writeable = True
        check_untouched(cls, human, before, which)
        unchanged = (record.state.q == q).all() and all(
            np.array_equal(a, tasks[k]) for k, a in stacks.snapshot(run.info.stack).items()
        )
        expect(unchanged, cls, f"{which}: it changed the record it was given")
        expect((robot.com == com).all(), cls, f"{which}: it moved the robot; others use it in the same frame")
    if spoil and record is not None:
        record.state.q[:] = np.nan
        run.info.stack.flat_target[:] = np.nan
    early = {
        p: p.stat().st_mtime_ns for p in out_dir.rglob("*") if p.is_file() and not p.name.startswith(".")
    }
    report = attempt(cls, "finish()", sink.finish)
    expect(isinstance(report, SinkReport), cls, f"finish() gave a {type(report).__name__}, not a SinkReport")
    files = [Path(p) for p in report.files]
    half = [p.name for p in files if p in early]
    expect(not half, cls, f"{', '.join(half)} was there before finish(); write with imitor.atomic at the end")
    _check_files(cls, out_dir, files, n)
    content = {p: p.read_bytes() for p in files}
    attempt(cls, "finish() after finish()", sink.finish)
    lost = [
        p.name for p in files if not p.is_file() or (p.suffix in _REPEATABLE and p.read_bytes() != content[p])
    ]
    expect(not lost, cls, f"finish() after finish() damages {', '.join(lost)}")
    end(sink)
    return files


def _check_files(cls: type[Sink[Any]], out_dir: Path, files: list[Path], n: int) -> None:
    for path in files:
        there = path.is_file() and path.stat().st_size > 0
        expect(there, cls, f"it reports {path.name}, which is missing or empty")
    found = {p.resolve() for p in out_dir.rglob("*") if p.is_file()}
    strange = sorted(str(p.relative_to(out_dir.resolve())) for p in found - {p.resolve() for p in files})
    expect(
        not strange, cls, f"after {n} frames it leaves {', '.join(strange)}, which its report does not name"
    )


def _check_length(cls: type[Sink[Any]], files: list[Path], n: int) -> None:
    """Count the frames in files whose format is known: every frame, or no file."""
    for path in files:
        if path.suffix == ".npz":
            with np.load(path) as arrays:
                if "time_s" in arrays.files:
                    count = len(arrays["time_s"])
                    expect(count == n, cls, f"{path.name} holds {count} frames of {n}")
        elif path.suffix == ".csv":
            lines = [
                line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")
            ]
            expect(
                len(lines) == n + 1, cls, f"{path.name} holds {len(lines) - 1} frames of {n} under its head"
            )
