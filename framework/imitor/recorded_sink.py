"""What sinks that write a file share: they keep the whole run and write once, whole or not at all."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

from imitor.atomic import atomic
from imitor.errors import SinkError
from imitor.kinds import Config, Record, RunInfo, Sink, SinkReport
from imitor.record import Recorder

C = TypeVar("C", bound=Config)


class RecordedSink(Sink[C]):
    """A sink that copies every frame while the robot moves and writes its files at the end.

    A concrete class writes `save`; a run without frames never calls it.

    Attributes:
        run: What the run told when it started.
        recorder: The frames so far.
    """

    run: RunInfo
    recorder: Recorder

    def open(self, run: RunInfo) -> None:
        """Make room for the frames."""
        self.run, self.recorder = run, Recorder(run)

    def write(self, record: Record) -> None:
        """Copy one frame."""
        self.recorder.add(record)

    def finish(self) -> SinkReport:
        """Write the files, unless there was no frame."""
        return self.save() if len(self.recorder) else SinkReport()

    def close(self) -> None:
        """Give back what the frames were kept in."""
        if hasattr(self, "recorder"):
            self.recorder.close()

    def save(self) -> SinkReport:
        """Write the recorded frames."""
        raise NotImplementedError

    def folder_of(self, path: Path) -> Path:
        """Check early that the folder of a file to be written exists; return the file's full path.

        Raises:
            SinkError: It does not exist.
        """
        full = self.run.out_dir / path.expanduser()
        if not full.parent.is_dir():
            raise SinkError(
                f"sink '{self.name}': there is no folder {full.parent} for {full.name}; "
                "make it, or change the sink's option `path`"
            )
        return full


@contextlib.contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Yield a temporary path that becomes ``path`` on success; what the disk refuses is a `SinkError`."""
    with refusals(path), atomic(path) as temporary:
        yield temporary


@contextlib.contextmanager
def refusals(path: Path) -> Iterator[None]:
    """Turn an error of the file system into a `SinkError` that says what to do."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise SinkError(
            f"cannot write {path}: {reason}; make room or mend the folder, or choose another with --out"
        ) from error
