"""What the command line changes in a pipeline: ``--robot``, ``--input``, ``--source``, ``--use``, ``--set``.

The document itself is changed before it is validated, so that file and command line pass the same checks.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from imitor.errors import Problem
from imitor.kinds import STAGE_KINDS, Config, Source
from imitor.registry import Registry
from imitor.spec.cards import hint_for, known
from imitor.spec.document import Document, Loc
from imitor.spec.yaml_marks import parse_value

_TOP_LEVEL: Final = ("robot", "rate_hz", "speed", "settle_s", "seed", "environment")
_TRACKING: Final = "tracking"
_ENVIRONMENT: Final = "environment"
"""The keys of the top level that have options of their own; those of the environment are found by an object's name."""
_RESERVED: Final = ("use", "id", *STAGE_KINDS)


def named(data: Any) -> Iterator[tuple[Loc, str, str, str]]:
    """Yield (place, kind, plugin name, id) of the source, the stages and the sinks that can be recognised."""
    if not isinstance(data, dict):
        return
    source = data.get("source")
    if isinstance(source, dict) and isinstance(source.get("use"), str):
        yield ("source",), "source", source["use"], "source"
    for group in ("stages", "sinks"):
        entries = data.get(group)
        for i, entry in enumerate(entries if isinstance(entries, list) else []):
            if not isinstance(entry, dict):
                continue
            kinds = (
                [k for k in STAGE_KINDS if k in entry]
                if group == "stages"
                else ["use"]
                if "use" in entry
                else []
            )
            if len(kinds) == 1 and isinstance(entry[kinds[0]], str):
                name = entry[kinds[0]]
                yield (group, i), kinds[0] if group == "stages" else "sink", name, str(entry.get("id", name))


def override_robot(document: Document, robot: str) -> None:
    """Replace the robot."""
    document.override(("robot",), robot, f"--robot {robot}")


def override_source(
    document: Document, path: Path | None, name: str | None, registry: Registry
) -> list[Problem]:
    """Replace the source by one that reads a file, or by the one named."""
    origin = f"--input {path}" if path is not None else f"--source {name}"
    if path is None and name is None:
        return []
    if name is not None and registry.find("source", name) is None:
        return [_missing_plugin(f"--source {name}", "", "source", name, registry)]
    if path is not None and not path.exists():
        return [Problem(origin, 0, 0, "", "there is no such file")]
    if path is not None and name is None:
        found = [r.name for r in registry if r.kind == "source" and _recognises(r.component, path)]
        if len(found) != 1:
            if found:
                message = f"{' and '.join(found)} can read this file"
                return [Problem(origin, 0, 0, "", message, "say which: --source NAME")]
            readers = [
                f"{r.name} ({' '.join(r.component.extensions)})"
                for r in registry
                if issubclass(r.component, Source) and r.component.extensions
            ]
            return [Problem(origin, 0, 0, "", "no source recognises this file", known(readers))]
        name = found[0]
    data: dict[str, Any] = {"use": name}
    if path is not None:
        component = registry.get("source", str(name))
        if "path" not in component.config_type.model_fields:
            return [Problem(origin, 0, 0, "", f"source '{name}' reads no file")]
        data["path"] = str(path)
    document.override(("source",), data, origin)
    return []


def _recognises(component: Any, path: Path) -> bool:
    try:
        return bool(component.recognises(path))
    except OSError:
        return False


def add_sinks(document: Document, names: Sequence[str]) -> None:
    """Append sinks that are not there yet."""
    for name in names:
        sinks = document.data.setdefault("sinks", [])
        if isinstance(sinks, list) and not any(isinstance(s, dict) and s.get("use") == name for s in sinks):
            sinks.append(None)
            document.override(("sinks", len(sinks) - 1), {"use": name}, f"sink {name}")


def swap(document: Document, text: str, registry: Registry, dropped: list[str]) -> list[Problem]:
    """Carry out one ``--use ID=PLUGIN``: the id and the options that the new plugin also has are kept."""
    origin = f"--use {text}"
    ident, equals, name = text.partition("=")
    if not (ident and equals and name):
        return [Problem(origin, 0, 0, "", "should be ID=PLUGIN, e.g. --use posture=placo")]
    place = _find(document, ident)
    if isinstance(place, str):
        return [Problem(origin, 0, 0, "", f"no stage is called '{ident}'", place)]
    loc, kind, old = place
    if registry.find(kind, name) is None:
        return [_missing_plugin(origin, "", kind, name, registry)]
    entry = document.at(loc)
    key = kind if loc[0] == "stages" else "use"
    document.override((*loc, key), name, origin)
    if kind != "source" and "id" not in entry:
        document.override((*loc, "id"), ident, origin)
    options = {k: v for k, v in entry.items() if k not in _RESERVED}
    unknown, unfit = _unfit(registry.get(kind, name).config_type, options)
    for gone, why in (
        (unknown, "has no such option"),
        (unfit, f"does not take the value it had for '{old}'"),
    ):
        for option in gone:
            del entry[option]
        if gone:
            dropped.append(f"{origin}: dropped {', '.join(gone)}; '{name}' {why}")
    return []


def _unfit(config: type[Config], options: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Return the options that a plugin does not have, and those whose values it does not take."""
    unknown = [k for k in options if k not in config.model_fields]
    kept = {k: v for k, v in options.items() if k in config.model_fields}
    wrong: set[Any] = set()
    try:
        config.model_validate_json(json.dumps(kept), strict=True)
    except ValidationError as error:
        wrong = {fault["loc"][0] for fault in error.errors() if fault["loc"]}
    return unknown, [k for k in kept if k in wrong]


def set_option(document: Document, text: str, registry: Registry) -> list[Problem]:
    """Carry out one ``--set ID.option=value`` or ``--set KEY=value``."""
    origin = f"--set {text}"
    target, equals, value = text.partition("=")
    steps = target.strip().split(".")
    if not equals or not all(steps):
        return [Problem(origin, 0, 0, "", "should be ID.option=value, e.g. --set balance.damping=0.1")]
    parsed = parse_value(value, origin)
    if parsed.problems:
        return parsed.problems
    if len(steps) == 1:
        if steps[0] not in _TOP_LEVEL:
            hint = hint_for(steps[0], _TOP_LEVEL)
            return [
                Problem(origin, 0, 0, "", f"'{steps[0]}' is no key to set; of a stage: ID.option=value", hint)
            ]
        document.override((steps[0],), parsed.data, origin)
        return []
    if steps[0] == _TRACKING:
        if _TRACKING not in document.data:
            document.override((_TRACKING,), {}, origin)
        return _put(document, (_TRACKING,), steps[1:], parsed.data, origin)
    if steps[0] == _ENVIRONMENT:
        return _set_object(document, steps[1:], parsed.data, origin)
    place = _find(document, steps[0])
    if isinstance(place, str):
        return [Problem(origin, 0, 0, "", f"no stage is called '{steps[0]}'", place)]
    loc, kind, name = place
    if steps[1] in _RESERVED:
        return [
            Problem(origin, 0, 0, "", f"'{steps[1]}' is no option", f"swap a plugin: --use {steps[0]}=PLUGIN")
        ]
    found = registry.find(kind, name)
    if len(steps) > 2 and found is not None and steps[1] not in document.at(loc):
        default = _default(found.component.config_type, steps[1])
        if default is not None:
            document.override((*loc, steps[1]), default, origin)
    return _put(document, loc, steps[1:], parsed.data, origin)


def _set_object(document: Document, steps: list[str], value: Any, origin: str) -> list[Problem]:
    """Set an option of an object of the environment."""
    objects = document.data.get(_ENVIRONMENT)
    names = [
        o.get("name") if isinstance(o, dict) else None for o in (objects if isinstance(objects, list) else [])
    ]
    if steps[0] not in names:
        known = [n for n in names if isinstance(n, str)]
        hint = hint_for(steps[0], known) if known else "there is none; set the whole list: environment=[...]"
        return [Problem(origin, 0, 0, "", f"the environment has no object '{steps[0]}'", hint)]
    loc: Loc = (_ENVIRONMENT, names.index(steps[0]))
    if len(steps) == 1:
        document.override(loc, value, origin)
        return []
    if steps[1] == "position_m" and len(steps) == 3 and "position_m" not in objects[loc[1]]:
        document.override((*loc, "position_m"), [0.0, 0.0, 0.0], origin)
    return _put(document, loc, steps[1:], value, origin)


def _put(document: Document, loc: Loc, steps: list[str], value: Any, origin: str) -> list[Problem]:
    """Put a value at steps below a place, making mappings on the way."""
    for step in steps[:-1]:
        around = document.at(loc)
        here: str | int = int(step) if isinstance(around, list) and re.fullmatch(r"\d+", step) else step
        if isinstance(around, dict) and here not in around:
            document.override((*loc, here), {}, origin)
        loc = (*loc, here)
    around, last = document.at(loc), steps[-1]
    if isinstance(around, list):
        if not re.fullmatch(r"\d+", last) or int(last) >= len(around):
            return [
                Problem(origin, 0, 0, "", f"'{last}' is no index; the list has {len(around)} items, from 0")
            ]
        document.override((*loc, int(last)), value, origin)
    elif isinstance(around, dict):
        document.override((*loc, last), value, origin)
    else:
        return [Problem(origin, 0, 0, "", f"there is no '{last}': what stands before it is a single value")]
    return []


def _default(config: type[Config], option: str) -> Any:
    """Return the default of an option as plain data, if it is a mapping or list."""
    field = config.model_fields.get(option)
    if field is None or field.is_required():
        return None
    value = config.model_construct(**{option: field.get_default(call_default_factory=True)}).model_dump(
        mode="json"
    )
    return value[option] if isinstance(value[option], dict | list) else None


def _find(document: Document, ident: str) -> tuple[Loc, str, str] | str:
    """Return place, kind and plugin of the stage with an id, or a suggestion."""
    ids = []
    for loc, kind, name, other in named(document.data):
        if other == ident:
            return loc, kind, name
        ids.append(other)
    return hint_for(ident, ids)


def _missing_plugin(origin: str, where: str, kind: str, name: str, registry: Registry) -> Problem:
    message, hint = unknown_plugin(kind, name, registry)
    return Problem(origin, 0, 0, where, message, hint)


def unknown_plugin(kind: str, name: str, registry: Registry) -> tuple[str, str]:
    """Return what to say about a plugin that is not there: message and suggestion."""
    for failure in registry.failures:
        if name in (failure.plugin, failure.module.rsplit(".", 1)[-1]):
            return f"plugin '{failure.plugin}' ({failure.module}) failed to load: {failure.error}", ""
    others = [r.kind for r in registry if r.name == name]
    hint = f"it is a {others[0]}" if others else hint_for(name, registry.names(kind))
    return f"no {kind} is called '{name}'", hint
