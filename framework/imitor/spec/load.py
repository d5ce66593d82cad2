"""A pipeline's text and the command line's changes become a specification, or every problem at once."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from imitor.environment import Box, Cylinder, Mesh, standing_with
from imitor.errors import Problem, SpecError, did_you_mean
from imitor.kinds import STAGE_KINDS, Config
from imitor.registry import Registry
from imitor.spec import overrides
from imitor.spec.cards import check_environment, check_robot, find_pipeline, read_text
from imitor.spec.check_order import Entry, check_order
from imitor.spec.document import Loc, dotted
from imitor.spec.schema import VERSION, PipelineDocument, PipelineSpec, StageSpec
from imitor.spec.yaml_marks import parse_document, validate

_ID: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")


def load_pipeline(
    name_or_path: str,
    registry: Registry,
    *,
    robot: str | None = None,
    input: Path | None = None,
    source: str | None = None,
    sets: Sequence[str] = (),
    uses: Sequence[str] = (),
    add_sinks: Sequence[str] = (),
) -> PipelineSpec:
    """Load a pipeline from a file or a preset and change it as the command line asks.

    Args:
        name_or_path: Name of a preset, or path of a YAML file.
        registry: The plugins.
        robot: Replaces the robot.
        input: A recording; replaces the source by the one that recognises it.
        source: Name of the source to use.
        sets: ``ID.option=value`` each.
        uses: ``ID=PLUGIN`` each.
        add_sinks: Names of sinks to add where they are missing.

    Raises:
        SpecError: Something is wrong; carries every problem found.
    """
    path = find_pipeline(name_or_path, registry)
    loader = _Loader(read_text(path), str(path), registry, path)
    loader.change_inputs(robot, input, source)
    loader.change_stages(sets, uses, add_sinks)
    return loader.build()


def load_text(text: str, registry: Registry, path: str = "<text>") -> PipelineSpec:
    """Load a pipeline from a text.

    Raises:
        SpecError: Something is wrong; carries every problem found.
    """
    return _Loader(text, path, registry, None).build()


def load_source(
    registry: Registry, *, input: Path | None = None, source: str | None = None, sets: Sequence[str] = ()
) -> StageSpec:
    """Return a source without a pipeline, by the options of the command line alone.

    Args:
        registry: The plugins.
        input: A recording, read by the source that recognises it.
        source: Name of the source to use.
        sets: ``source.option=value`` each.

    Raises:
        SpecError: Something is wrong; carries every problem found.
    """
    loader = _Loader("source: {}", "command line", registry, None)
    loader.change_inputs(None, input, source)
    loader.problems = [replace(p, path=p.path.removeprefix("--input ")) for p in loader.problems]
    for text in sets:
        if text.startswith("source."):
            loader.change_stages([text], (), ())
        else:
            message = "there is only a source here"
            loader.problems.append(Problem(f"--set {text}", 0, 0, "", message, "write source.option=value"))
    entry = None
    if not loader.problems:
        entry = loader.single("source", loader.data["source"], "source")
    loader.refuse_problems()
    if entry is None:
        raise SpecError([Problem("command line", 0, 0, "", "the source could not be read")])
    return _finished(entry)


class _Loader:
    def __init__(self, text: str, name: str, registry: Registry, path: Path | None) -> None:
        self.document = parse_document(text, name, environment=os.environ)
        self.registry, self.path = registry, path
        self.problems: list[Problem] = list(self.document.problems)
        self.dropped: list[str] = []
        self.ids: dict[str, Loc] = {}
        if not isinstance(self.document.data, dict):
            raise SpecError(self.problems)
        self.data: dict[str, Any] = self.document.data

    def change_inputs(self, robot: str | None, recording: Path | None, source: str | None) -> None:
        if robot is not None:
            overrides.override_robot(self.document, robot)
        self.problems += overrides.override_source(self.document, recording, source, self.registry)

    def change_stages(self, sets: Sequence[str], uses: Sequence[str], add_sinks: Sequence[str]) -> None:
        overrides.add_sinks(self.document, add_sinks)
        for use in uses:
            self.problems += overrides.swap(self.document, use, self.registry, self.dropped)
        for text in sets:
            self.problems += overrides.set_option(self.document, text, self.registry)

    def build(self) -> PipelineSpec:
        data = self.data
        top, problems = validate(PipelineDocument, data, self.document, ())
        self.problems += problems
        if type(data.get("imitor")) is int and data["imitor"] != VERSION:
            message = f"version {data['imitor']} of the format is unknown here"
            self.add(("imitor",), message, f"write imitor: {VERSION}")
        robot = data.get("robot")
        if isinstance(robot, str):
            robot, problems = check_robot(robot, self.document, self.registry, self.path and self.path.parent)
            self.problems += problems
        environment: list[dict[str, Any]] = []
        if top is not None:
            environment, problems = check_environment(
                top.environment, self.document, self.path and self.path.parent
            )
            self.problems += problems
        source = self.single("source", data["source"], "source") if "source" in data else None
        stages, sinks = self.group(data, "stages"), self.group(data, "sinks")
        if isinstance(data.get("stages"), list) and len(stages) == len(data["stages"]):
            self.problems += check_order(source, stages, self.document, self.registry)
        self.refuse_problems()
        if top is None or source is None:
            raise SpecError([Problem(self.document.path, 0, 0, "", "the pipeline could not be read")])
        environment = self.standing(environment, top.environment, source.name)
        return PipelineSpec(
            name=Path(self.document.path).stem,
            path=self.path,
            robot=str(Path(str(robot)).resolve()) if Path(str(robot)).is_file() else str(robot),
            rate_hz=top.rate_hz,
            speed=top.speed,
            settle_s=top.settle_s,
            environment=environment,
            seed=top.seed,
            tracking=top.tracking,
            source=_finished(source),
            stages=[_finished(s) for s in stages],
            sinks=[_finished(s) for s in sinks],
            dropped=self.dropped,
        )

    def standing(
        self, environment: list[dict[str, Any]], items: Sequence[Box | Cylinder | Mesh], source: str
    ) -> list[dict[str, Any]]:
        """Leave out the objects of other sources, and say so."""
        there = standing_with(source, items)
        others = dict.fromkeys(item.only_with for item in items if item.only_with not in (None, source))
        if others:
            out = [item.name for item, here in zip(items, there, strict=True) if not here]
            kept = next(item.name for item in items if item.only_with in others)
            self.dropped.append(
                f"environment: without {', '.join(out)}, which belong to the source {' or '.join(map(repr, others))}, "
                f"not to '{source}'; to keep one: --set environment.{kept}.only_with=null"
            )
        kept_data = [data for data, here in zip(environment, there, strict=True) if here]
        return [{k: v for k, v in data.items() if k != "only_with"} for data in kept_data]

    def group(self, data: dict[str, Any], name: str) -> list[Entry]:
        entries = data.get(name)
        found = []
        for i, entry in enumerate(entries if isinstance(entries, list) else []):
            read = self.stage((name, i), entry) if name == "stages" else self.single("sink", entry, name, i)
            if read is not None:
                found.append(read)
        return found

    def stage(self, loc: Loc, entry: Any) -> Entry | None:
        """Read ``{KIND: NAME, id: ..., ...options}``."""
        if not isinstance(entry, dict):
            hint = ""
            if isinstance(entry, str):
                kinds = [r.kind for r in self.registry if r.name == entry and r.kind in STAGE_KINDS]
                hint = f"write '{kinds[0]}: {entry}'" if kinds else ""
            self.add(loc, "a stage is a mapping that starts with its kind, such as 'filter: NAME'", hint)
            return None
        kinds = [k for k in entry if k in STAGE_KINDS]
        if not kinds:
            near = next((k for k in entry if did_you_mean(k, STAGE_KINDS)), None)
            hint = did_you_mean(near, STAGE_KINDS) if near else ""
            place = (*loc, near) if near else loc
            self.add(place, f"a stage names its kind: {', '.join(STAGE_KINDS)}", hint, key=True)
            return None
        if len(kinds) > 1:
            self.add(
                (*loc, kinds[1]),
                f"a stage is of one kind, here {kinds[0]} and {kinds[1]}",
                "make it two stages",
                key=True,
            )
            return None
        return self.plugin(kinds[0], kinds[0], entry, loc)

    def single(self, kind: str, entry: Any, *loc: str | int) -> Entry | None:
        """Read ``{use: NAME, ...options}``."""
        if not isinstance(entry, dict):
            hint = (
                f"write {{use: {entry}}}"
                if isinstance(entry, str) and self.registry.find(kind, entry)
                else ""
            )
            self.add(loc, f"a {kind} is a mapping, such as {{use: NAME}}", hint)
            return None
        if "use" not in entry:
            near = next((k for k in entry if k == kind or did_you_mean(k, ["use"])), None)
            self.add(
                (*loc, near) if near else loc, f"a {kind} names its plugin: use: NAME", key=near is not None
            )
            return None
        return self.plugin(kind, "use", entry, loc)

    def plugin(self, kind: str, key: str, entry: dict[str, Any], loc: Loc) -> Entry | None:
        name = entry[key]
        if not isinstance(name, str):
            self.add((*loc, key), f"should be the name of a {kind}", f"imitor list {kind} shows them")
            return None
        given = entry.get("id", name) if kind != "source" else "source"
        ident = self.identify(given, loc, key)
        found = self.registry.find(kind, name)
        if found is None:
            message, hint = overrides.unknown_plugin(kind, name, self.registry)
            self.add((*loc, key), message, hint)
            return Entry(kind, name, ident, loc)
        skip = {key} if kind == "source" else {key, "id"}
        options = {k: v for k, v in entry.items() if k not in skip}
        config, problems = validate(found.component.config_type, options, self.document, loc, owner=name)
        self.problems += problems
        return Entry(kind, name, ident, loc, found.component, config)

    def identify(self, given: Any, loc: Loc, key: str) -> str:
        entry = self.document.at(loc)
        place = (*loc, "id") if "id" in entry else (*loc, key)
        if not isinstance(given, str) or not _ID.fullmatch(given):
            self.add(place, "an id is a word of letters, digits, _ and -, and starts with a letter")
            return str(given)
        if given in self.ids:
            first = self.document.mark_of(self.ids[given])
            spot = f"line {first.line}" if first.line else dotted(self.ids[given])
            self.add(place, f"id '{given}' is used before, in {spot}", "give this one another: 'id: ...'")
        else:
            self.ids[given] = loc
        return given

    def add(self, loc: Loc, message: str, suggestion: str = "", *, key: bool = False) -> None:
        self.problems.append(self.document.problem(loc, message, suggestion, key=key))

    def refuse_problems(self) -> None:
        """Raise what was found, in the order of the file; of a broken value, only that it is broken."""
        broken = {p.where for p in self.document.problems if p.where}
        found = dict.fromkeys(
            p for p in self.problems if p.where not in broken or p in self.document.problems
        )
        if found:
            raise SpecError(sorted(found, key=lambda p: (p.path != self.document.path, p.line, p.column)))


def _finished(entry: Entry) -> StageSpec:
    return StageSpec(entry.kind, entry.name, entry.id, entry.config or Config(), dotted(entry.loc))
