"""The form of a pipeline: what a document may hold, and what the framework makes of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import BaseModel, ConfigDict, Field

from imitor.environment import Obstacle
from imitor.kinds import Config
from imitor.safety.tracking import TrackingOptions
from imitor.spec.scalars import STR, escape, plain_tag

VERSION: Final = 1
"""Version of the pipeline format: the value of the key ``imitor``."""


class PipelineDocument(BaseModel):
    """The top level of a pipeline. Stages are checked one by one, each against the options of its plugin."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    imitor: int = Field(description="Version of the pipeline format: 1.")
    robot: str = Field(description="Name of a robot (imitor list robots) or path of a robot card.")
    rate_hz: float | None = Field(
        None, gt=0, le=1000, description="Frames per second of the output; default: the source's rate [Hz]."
    )
    speed: float = Field(
        1.0,
        gt=0,
        le=10,
        description="Playback speed of a recording; 0.5 gives a slow robot twice the time [-].",
    )
    settle_s: float = Field(
        0.0, ge=0, le=600, description="How long the last human frame is held so that transitions finish [s]."
    )
    seed: int = Field(0, ge=0, description="Seed of everything random [-].")
    tracking: TrackingOptions = Field(
        TrackingOptions(), description="What happens when the person is lost, and how they come back."
    )
    environment: list[Obstacle] = Field([], description="Objects around the robot: boxes, cylinders, meshes.")
    source: Any = Field(description="Where human motion comes from: {use: NAME, ...options}.")
    stages: list[Any] = Field(description="Stages in order: {KIND: NAME, ...options}.")
    sinks: list[Any] = Field([], description="Where results go: {use: NAME, ...options}.")


@dataclass(frozen=True)
class StageSpec:
    """One plugin of a pipeline with its options; also the source and the sinks.

    Attributes:
        kind: Kind of the plugin, e.g. ``solver``.
        name: Name of the plugin.
        id: Name of this stage in the pipeline, unique; ``source`` for the source.
        config: Validated options.
        where: Place in the document, for messages: ``stages[2]``.
    """

    kind: str
    name: str
    id: str
    config: Config
    where: str

    def options(self) -> dict[str, Any]:
        """Return the options as plain data, defaults included."""
        return self.config.model_dump(mode="json")


@dataclass(frozen=True)
class PipelineSpec:
    """A validated pipeline. Two are equal when they do the same, whatever file they come from.

    Attributes:
        name: Name of the preset or file, for titles.
        path: The file, if it comes from one.
        robot: Name of a robot or path of a card.
        rate_hz: Output rate [Hz]; ``None`` takes the source's.
        speed: Playback speed of the recording [-].
        settle_s: How long the last human frame is held [s].
        environment: Objects around the robot with this source, every default but an absent rotation written out.
        seed: Seed of everything random.
        tracking: What happens when the person is lost.
        source: The source.
        stages: Filters, mappers, stabilizers, solvers and post-processors in order.
        sinks: The sinks.
        dropped: Messages about what was left out: options that a swapped plugin does not have, objects that belong to
            another source.
    """

    name: str = field(compare=False)
    path: Path | None = field(compare=False)
    robot: str
    rate_hz: float | None
    speed: float
    settle_s: float
    environment: list[dict[str, Any]]
    seed: int
    source: StageSpec
    stages: list[StageSpec]
    sinks: list[StageSpec]
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    dropped: list[str] = field(default_factory=list, compare=False)

    def to_yaml(self) -> str:
        """Return the pipeline with every default written out; it loads again to an equal specification."""
        data: dict[str, Any] = {"imitor": VERSION, "robot": self.robot}
        if self.rate_hz is not None:
            data["rate_hz"] = self.rate_hz
        data |= {
            "speed": self.speed,
            "settle_s": self.settle_s,
            "seed": self.seed,
            "tracking": self.tracking.model_dump(mode="json"),
            "environment": self.environment,
        }
        data["source"] = {"use": self.source.name, **self.source.options()}
        data["stages"] = [{s.kind: s.name, "id": s.id, **s.options()} for s in self.stages]
        data["sinks"] = [{"use": s.name, "id": s.id, **s.options()} for s in self.sinks]
        text: str = yaml.dump(
            escaped(data),
            Dumper=_Dumper,
            sort_keys=False,
            default_flow_style=None,
            width=100,
            allow_unicode=True,
        )
        return text


def escaped(data: Any) -> Any:
    """Return data whose texts read back as they are: ``${`` is no substitution."""
    if isinstance(data, str):
        return escape(data)
    if isinstance(data, dict):
        return {key: escaped(value) for key, value in data.items()}
    return [escaped(item) for item in data] if isinstance(data, list) else data


class _Dumper(yaml.SafeDumper):
    """Write YAML that means the same by YAML 1.2: ``'1e-4'`` keeps its quotes when it is text."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    if not text.isprintable():
        style: str | None = '"'  # only there are line breaks and control characters written as escapes
    else:
        style = None if plain_tag(text) == STR else "'"
    return dumper.represent_scalar(STR, text, style=style)


_Dumper.add_representer(str, _represent_text)
