"""Show one plugin, robot, preset, skeleton or marker set.

Of a plugin: what it does, and its options with type, default and unit. Of a robot: its card and model. Of a
preset: where it comes from, and the pipeline with every default written out.
"""

from __future__ import annotations

import argparse
import inspect
import re
import types
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from imitor.cli import common
from imitor.cli.tables import table
from imitor.errors import ImitorError, SpecError
from imitor.registry import Registered, Registry
from imitor.spec import load_pipeline
from imitor.spec.cards import hint_for


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "name", metavar="NAME", help="name of a plugin, robot, preset, skeleton or marker set"
    )
    common.add_without(parser)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    registry = common.make_registry(args.without)
    name = args.name
    cards = {folder: registry.cards(folder) for folder in ("robots", "pipelines", "skeletons", "markersets")}
    parts = [plugin_text(r) for r in registry if r.name == name]
    if name in cards["robots"]:
        parts.append(_robot(name, registry))
    if name in cards["pipelines"]:
        parts.append(_preset(name, cards["pipelines"][name], registry))
    for folder in ("skeletons", "markersets"):
        if name in cards[folder]:
            parts.append(cards[folder][name].read_text(encoding="utf-8").rstrip())
    if not parts:
        failed = next((f for f in registry.failures if name in (f.plugin, f.module.rsplit(".", 1)[-1])), None)
        if failed is not None:
            raise ImitorError(f"plugin '{failed.plugin}' ({failed.module}) failed to load: {failed.error}")
        names = {r.name for r in registry}.union(*cards.values())
        raise ImitorError(f"nothing is called '{name}'; {hint_for(name, names)} (imitor list)")
    print("\n\n".join(parts))
    return 0


def _robot(name: str, registry: Registry) -> str:
    from imitor.robot.card import load_card
    from imitor.robot.describe import describe

    return f"robot {describe(load_card(name, registry))}"


def _preset(name: str, path: Path, registry: Registry) -> str:
    header = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        if "yaml-language-server" not in line:
            header.append(line)
    try:
        body = load_pipeline(name, registry).to_yaml()
    except SpecError as error:
        body = f"# this preset cannot run here:\n{error}"
    return "\n".join([f"preset {name}", "", *header, body.rstrip()])


def plugin_text(entry: Registered) -> str:
    """Return the description of a plugin."""
    component = entry.component
    facts = [
        (label, ", ".join(sorted(map(str, value))))
        for label, value in (
            ("needs", component.wants),
            ("needs tasks", getattr(component, "needs_tasks", ())),
            ("gives", component.gives),
            ("declares tasks", getattr(component, "declares", ())),
            ("reads", getattr(component, "extensions", ())),
        )
        if value
    ]
    serves = getattr(component, "serves", {})
    if serves:
        facts.append(("serves", ", ".join(f"{kind} ({how})" for kind, how in serves.items())))
    if component.extra:
        facts.append(("install", f"pip install 'imitor[{component.extra}]'"))
    facts.append(("from", entry.origin))
    parts = [f"{entry.kind} {entry.name}", inspect.cleandoc(component.__doc__ or ""), table(facts, indent="")]
    rows = option_rows(component.config_type)
    parts.append(
        "options\n" + table([["name", "type", "default", "meaning"], *rows]) if rows else "no options"
    )
    return "\n\n".join(parts)


def option_rows(model: type[BaseModel], prefix: str = "") -> list[list[str]]:
    """Return (name, type, default, description) of every option; those of nested models with dotted names."""
    rows = []
    for name, field in model.model_fields.items():
        annotation = field.annotation
        rows.append([prefix + name, type_text(annotation), _default(field), field.description or ""])
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            rows += option_rows(annotation, f"{prefix}{name}.")
    return rows


def type_text(annotation: Any) -> str:
    """Return a type in plain words."""
    origin, inside = get_origin(annotation), get_args(annotation)
    plain = {float: "number", int: "whole number", str: "text", bool: "true/false", Path: "path", Any: "any"}
    if annotation in plain:
        return plain[annotation]
    if annotation is type(None):
        return "null"
    if origin is Annotated:
        return type_text(inside[0])
    if origin is Literal:
        return " | ".join(map(str, inside))
    if origin in (Union, types.UnionType):
        return " | ".join(type_text(a) for a in inside)
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return " | ".join(str(member.value) for member in annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "mapping"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"mapping to {type_text(inside[-1])}"
    if inside:
        words = dict.fromkeys(type_text(a) for a in inside if a is not Ellipsis)
        return f"list of {' and '.join(words)}"
    return str(getattr(annotation, "__name__", annotation))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return ""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    text = str(value.value) if isinstance(value, Enum) else str(value)
    return re.sub(r"'([A-Za-z_]\w*)'", r"\1", text) if isinstance(value, dict | list | tuple) else text
