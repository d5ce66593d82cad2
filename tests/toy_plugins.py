"""Small plugins of every kind for tests of the pipeline loader and the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import pytest
from pydantic import Field

from imitor import (
    Config,
    Filter,
    Mapper,
    Postprocessor,
    Sink,
    Solver,
    Source,
    Stabilizer,
    Strictness,
    TaskKind,
)
from imitor.hooks import hookimpl
from imitor.registry import Failure, Registry


class ClipConfig(Config):
    path: str = Field(description="The recording.")
    scale: float = Field(1.0, gt=0, description="Length of one unit [m].")


class Clip(Source[ClipConfig]):
    """Read a .clip file."""

    name = "clip"
    extensions = (".clip", ".both")


class OtherClip(Source[ClipConfig]):
    """Read a .both file."""

    name = "other_clip"
    extensions = (".both",)


class ActorConfig(Config):
    scenario: Literal["stand", "walk"] = Field("stand", description="What is played.")
    note: str = Field("", description="Free text.")


class Actor(Source[ActorConfig]):
    """Play a scene."""

    name = "actor"
    gives = frozenset({"support"})


class MarkConfig(Config):
    threshold_m: float = Field(0.05, gt=0, description="Height of the floor contact [m].")


class Mark(Filter[MarkConfig]):
    """Mark the feet in support."""

    name = "mark"
    gives = frozenset({"support"})


class Weigh(Filter[Config]):
    """Find the centre of mass."""

    name = "weigh"
    gives = frozenset({"com"})


class Imitate(Mapper[Config]):
    """Turn the human into tasks."""

    name = "imitate"
    wants = frozenset({"support"})
    declares: ClassVar[Mapping[str, TaskKind]] = {
        "left_foot": TaskKind.POSE,
        "right_foot": TaskKind.POSE,
        "head": TaskKind.DIRECTION,
        "com": TaskKind.COM,
    }


class Lower(Stabilizer[Config]):
    """Lower the centre of mass."""

    name = "lower"
    wants = frozenset({"com"})
    needs_tasks = frozenset({"com", "waist"})


class Retarget(Stabilizer[Config]):
    """Move the feet."""

    name = "retarget"
    wants = frozenset({"configuration"})
    needs_tasks = frozenset({"left_foot"})
    declares: ClassVar[Mapping[str, TaskKind]] = {"waist": TaskKind.ORIENTATION}


class Tolerance(Config):
    position_m: float = Field(0.001, gt=0, description="Position [m].")
    orientation_rad: float = Field(0.01, gt=0, description="Orientation [rad].")


class FastConfig(Config):
    order: Sequence[Sequence[str]] = Field(
        [["left_foot", "right_foot"], ["com"]], description="Levels of tasks."
    )
    damping: float = Field(0.1, ge=0, le=10, description="Damping [-].")
    iterations: dict[str, int] = Field({"arms": 30, "legs": 5}, description="Iterations by limb.")
    tolerance: Tolerance = Field(default_factory=Tolerance.model_construct, description="When to stop.")
    verbose: bool = Field(False, description="Say more.")
    reach: float | tuple[float, float] = Field(1.0, description="Reach [m].")


class Fast(Solver[FastConfig]):
    """Solve quickly."""

    name = "fast"
    serves: ClassVar[Mapping[TaskKind, Strictness]] = {
        TaskKind.POSE: Strictness.WEIGHTED,
        TaskKind.COM: Strictness.WEIGHTED,
    }


class ExactConfig(Config):
    order: Sequence[Sequence[str]] = Field([["left_foot"]], description="Levels of tasks.")
    damping: float = Field(0.0, ge=0, le=1, description="Damping [-].")
    iterations: int = Field(10, ge=1, description="Iterations [-].")


class Exact(Solver[ExactConfig]):
    """Solve exactly."""

    name = "exact"


class BlendConfig(Config):
    gain: float = Field(0.3, gt=0, le=1, description="Share of the newest pose [-].")


class Blend(Postprocessor[BlendConfig]):
    """Smooth the motion."""

    name = "blend"


class LogConfig(Config):
    file: str = Field("log.txt", description="Name of the file.")
    armed: bool = Field(False, description="Move the robot.")


class Log(Sink[LogConfig]):
    """Write a log."""

    name = "log"


TOYS: list[Any] = [
    Clip, OtherClip, Actor, Mark, Weigh, Imitate, Lower, Retarget, Fast, Exact, Blend, Log,
]  # fmt: skip

GOOD = """\
imitor: 1
robot: toybot
source: {use: actor}
stages:
  - mapper: imitate
  - solver: fast
    damping: 0.5
  - postprocessor: blend
sinks:
  - {use: log}
"""

CARD = """\
imitor_robot: 1
title: Toy robot
licence: BSD-3-Clause
model: {file: toybot.urdf}
roles: {waist: base, foot: "{side}_foot"}
soles: {frame: "{side}_foot", polygon_m: [[0.1, 0.05], [-0.1, 0.05], [-0.1, -0.05], [0.1, -0.05]]}
"""


def toy_registry(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Registry:
    """Return a registry with the toys alone, one robot, one preset and one plugin that failed to load."""
    for name, text in (("robots/toybot.yaml", CARD), ("pipelines/toy.yaml", GOOD)):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr("imitor.registry._builtin_modules", list)
    registry = Registry(entry_points=False)

    class Plugin:
        @hookimpl
        def imitor_components(self) -> list[Any]:
            return TOYS

        @hookimpl
        def imitor_cards(self) -> list[Path]:
            return [folder]

    registry.register(Plugin(), "toys")
    registry.failures.append(Failure("acme", "acme_imitor.solvers", "No module named 'acme_sdk'", ""))
    return registry
