"""The exceptions of imitor. One root; facts are attributes, the message says what to do.

ImitorError
├── SpecError(problems)          a pipeline, card or option is wrong     exit status 2
├── PluginError(plugin)
│   ├── PluginLoadError          a plugin could not be imported         exit status 2
│   └── DuplicateComponent       a name is registered twice             exit status 2
├── RobotError                   a model or card does not fit           exit status 2
│   ├── UnknownLink
│   └── UnknownJoint
├── SourceError(path, line)      an input file or stream is wrong       exit status 2
└── RunError(frame, stage)       something failed while running         exit status 1
    ├── NoSolution
    └── SinkError
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path


def did_you_mean(given: str, legal: Iterable[str]) -> str:
    """Return ``"did you mean 'x'?"`` for the closest legal word, or an empty string."""
    close = difflib.get_close_matches(given, list(legal), n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else ""


def told(error: BaseException) -> str:
    """Return an error's message; one that is not ours is named, so that its author can find it."""
    text = str(error).rstrip(".")
    if isinstance(error, ImitorError):
        return text
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}{f': {error.filename}' if error.filename else ''}"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class ImitorError(Exception):
    """Root of all errors that imitor raises on purpose."""

    exit_status = 2


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong in a text file, at a place a person can go to."""

    path: str
    line: int  # from 1; 0 when no line is known
    column: int  # from 1; 0 when no column is known
    where: str  # dotted path in the document, e.g. ``stages[2].gain``
    message: str
    suggestion: str = ""
    source_line: str = ""

    def __str__(self) -> str:
        place = ":".join([self.path, *[str(n) for n in (self.line, self.column) if n]])
        head = f"{place}: {self.where}: {self.message}" if self.where else f"{place}: {self.message}"
        if not self.source_line:
            return f"{head}; {self.suggestion}" if self.suggestion else head
        number = f"{self.line:>6} | "
        caret = " " * 6 + " | " + " " * max(self.column - 1, 0) + "^"
        return "\n".join([head, number + self.source_line, f"{caret} {self.suggestion}".rstrip()])


class SpecError(ImitorError):
    """A pipeline, card or option is wrong; carries every problem found."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = list(problems)
        n = len(self.problems)
        tail = f"{n} problem{'s' if n != 1 else ''} found; nothing was run"
        super().__init__("\n".join([*map(str, self.problems), tail]))


class PluginError(ImitorError):
    """A plugin is at fault."""

    def __init__(self, plugin: str, message: str) -> None:
        self.plugin = plugin
        super().__init__(message)


class PluginLoadError(PluginError):
    """A plugin that is needed could not be imported."""


class DuplicateComponent(PluginError):
    """Two plugins register the same name for the same kind."""


class RobotError(ImitorError):
    """A robot's card and model do not fit together, or a request does not fit the robot."""


class UnknownLink(RobotError):
    """A link or frame name is not in the robot's model."""

    def __init__(self, robot: str, name: str, legal: Sequence[str], where: str = "") -> None:
        self.robot, self.name, self.legal = robot, name, list(legal)
        hint = did_you_mean(name, legal)
        prefix = f"{where}: " if where else ""
        super().__init__(
            f"{prefix}robot '{robot}' has no link or joint '{name}'"
            + (f"; {hint}" if hint else "")
            + f" ({len(self.legal)} names: imitor robot check {robot})"
        )


class UnknownJoint(UnknownLink):
    """A joint name is not in the robot's model."""


class SourceError(ImitorError):
    """An input file or stream cannot be used."""

    def __init__(self, path: str | Path, message: str, line: int | None = None) -> None:
        self.path, self.line = str(path), line
        place = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{place}: {message}")


class RunError(ImitorError):
    """A stage failed while the pipeline ran; the frames before are kept."""

    exit_status = 1

    def __init__(
        self, message: str, *, frame: int | None = None, time_s: float | None = None, stage: str = ""
    ) -> None:
        self.frame, self.time_s, self.stage = frame, time_s, stage
        place = []
        if frame is not None:
            place.append(f"frame {frame}" + (f" (t={time_s:.3f} s)" if time_s is not None else ""))
        if stage:
            place.append(stage)
        super().__init__(f"{', '.join(place)}: {message}" if place else message)


class NoSolution(RunError):
    """A solver found no configuration for a frame."""


class SinkError(RunError):
    """A sink could not write; what was finished is kept."""
