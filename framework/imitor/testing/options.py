"""Names, descriptions and options: what a user reads and writes."""

from __future__ import annotations

import re
import types
from collections.abc import Iterator, Mapping
from typing import Any, Final, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from imitor.kinds import Config, kind_of
from imitor.spec.schema import PipelineSpec, StageSpec
from imitor.spec.yaml_marks import parse_document
from imitor.testing.expect import AnyComponent, configure, expect, required_options

_HUMAN: Final = frozenset({"support", "com", "orientation", "markers", "targets"})
_UNIT: Final = re.compile(r"\[[^\[\]]+\]")


def check_names(cls: AnyComponent) -> None:
    """Check name, summary, and the words of ``wants`` and ``gives``."""
    expect(cls.name, cls, "it has no `name`")
    expect(
        re.fullmatch(r"[a-z][a-z0-9_]*", cls.name), cls, f"its name '{cls.name}' is not in lower_snake_case"
    )
    expect(
        "__doc__" in vars(cls) and cls.summary(), cls, "it has no docstring; its first line is the summary"
    )
    expect(kind_of(cls) == cls.kind, cls, f"its kind is '{cls.kind}', its base class is of '{kind_of(cls)}'")
    strange = (cls.wants - _HUMAN - {"configuration"}) | (cls.gives - _HUMAN)
    expect(
        not strange, cls, f"wants or gives {', '.join(sorted(strange))}; known: {', '.join(sorted(_HUMAN))}"
    )


def check_config(cls: AnyComponent, config: Mapping[str, Any] | None = None) -> None:
    """Check that options are described with units, are refused when unknown, and survive YAML.

    Args:
        cls: The plugin.
        config: Options; those without a default are needed for the way through YAML.
    """
    kind = cls.config_type
    expect(issubclass(kind, Config), cls, f"its options {kind.__qualname__} do not derive from imitor.Config")
    for path, field in _fields(kind):
        expect(field.description, cls, f"option {path} has no description")
        numeric = _is_numeric(field.annotation)
        expect(
            not numeric or _UNIT.search(field.description or ""),
            cls,
            f"option {path} is a number without a unit in its description; end it with [m], [rad], [-] ...",
        )
    required = required_options(kind)
    try:
        kind()
    except ValidationError as error:
        wrong = [e for e in error.errors() if e["type"] != "missing"]
        expect(not wrong and required, cls, f"its defaults are refused: {error}")
    else:
        expect(not required, cls, f"options {', '.join(required)} have no default")
    for mapping in ({"no_such_option": 1}, {**(config or {}), "no_such_option": 1}):
        try:
            kind.model_validate(mapping)
        except ValidationError:
            continue
        expect(False, cls, "it accepts options that it does not have; keep Config's extra='forbid'")
    if config is not None or not required:
        _check_round_trip(cls, configure(cls, config))


def _fields(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Yield the fields of a model and of the models in it."""
    for name, field in model.model_fields.items():
        yield f"{prefix}{name}", field
        for part in _parts(field.annotation):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from _fields(part, f"{prefix}{name}.")


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield the types that an annotation is made of."""
    origin = get_origin(annotation)
    if origin is None:
        yield annotation
    elif origin in (Union, types.UnionType) or isinstance(origin, type):
        arguments = get_args(annotation)
        if isinstance(origin, type) and issubclass(origin, Mapping):
            arguments = arguments[1:]  # keys are names
        for argument in arguments:
            yield from _parts(argument)
    elif hasattr(annotation, "__metadata__"):
        yield from _parts(annotation.__origin__)


def _is_numeric(annotation: Any) -> bool:
    return any(part in (int, float) for part in _parts(annotation))


def _check_round_trip(cls: AnyComponent, config: Config) -> None:
    """Write a pipeline with the plugin as YAML and read its options again."""
    stage = StageSpec(cls.kind, cls.name, "checked", config, "")
    spec = PipelineSpec(
        name="", path=None, robot="", rate_hz=None, speed=1.0, settle_s=0.0, environment=[], seed=0,
        source=stage, stages=[], sinks=[],
    )  # fmt: skip
    text = spec.to_yaml()
    document = parse_document(text, "options.yaml")
    expect(not document.problems, cls, f"its options do not survive YAML: {document.problems}")
    options = {key: value for key, value in document.data["source"].items() if key != "use"}
    try:
        again = cls.config_type.model_validate(options)
    except ValidationError as error:
        expect(False, cls, f"its own options, written as YAML, are refused: {error}")
    else:
        expect(
            again == config, cls, f"its options change on the way through YAML: {config!r}, then {again!r}"
        )
