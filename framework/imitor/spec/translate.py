"""What pydantic finds wrong, said in the words of the file and at its lines."""

from __future__ import annotations

import json
import re
import types
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from imitor.errors import Problem, did_you_mean
from imitor.spec.document import Document, Loc, contains

M = TypeVar("M", bound=BaseModel)

_NUMBER: Final = re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
_BOOL_WORDS: Final = {"on": "true", "yes": "true", "off": "false", "no": "false"}
_PLAIN_WORDS: Final = (
    ("a valid array", "a list"),
    ("a valid list", "a list"),
    ("a valid tuple", "a list"),
    ("a valid dictionary or instance of", "a mapping for"),
    ("a valid dictionary", "a mapping"),
    ("a valid boolean", "true or false"),
    ("an object", "a mapping"),
    ("a valid number", "a number"),
    ("a valid integer", "a whole number"),
    ("a valid string", "text"),
)


def validate(
    model: type[M], data: Any, document: Document, prefix: Loc, *, owner: str = ""
) -> tuple[M | None, list[Problem]]:
    """Validate data by a model as a person reads YAML: no text is taken for a number, no ``true`` for 1.

    Args:
        model: The pydantic model.
        data: Data at ``prefix``, or made from it.
        document: Where the data is written.
        prefix: Place of the data in the document.
        owner: Name of what has these options, for messages.

    Returns:
        The object, or ``None`` and the problems.
    """
    try:
        # JSON mode: strict about scalars, yet takes a list for a tuple and a word for a path or an enum.
        return model.model_validate_json(json.dumps(data), strict=True), []
    except ValidationError as error:
        return None, translate(error, document, prefix, model, owner=owner)


def translate(
    error: ValidationError, document: Document, prefix: Loc, model: type[BaseModel], *, owner: str = ""
) -> list[Problem]:
    """Return the problems of a validation error at their places in the document.

    Args:
        error: What pydantic raised for the data at ``prefix``.
        document: Where that data is written.
        prefix: Place of the data in the document.
        model: The model, whose fields are the legal keys.
        owner: Name of what has these options, e.g. a plugin's name.
    """
    found: dict[tuple[Loc, str], list[tuple[str, str]]] = {}
    faults = [(_clean(e["loc"], document.at(prefix), e["type"]), e) for e in error.errors(include_url=False)]
    unions = [(loc, cut) for (loc, cut, _), _ in faults if cut is not None]
    for (loc, cut, at_key), fault in faults:
        # Of the branches of a union, only those count that got furthest into the data.
        if cut is not None and any(
            c == cut and other[:cut] == loc[:cut] and len(other) > len(loc) for other, c in unions
        ):
            continue
        where, side, message, suggestion = _say(dict(fault), loc, at_key, model, owner)
        found.setdefault(((*prefix, *where), side), []).append((message, suggestion))
    problems = []
    for (loc, side), said in found.items():
        message = _join([m for m, _ in said])
        suggestion = next((s for _, s in said if s), "")
        problems.append(document.problem(loc, message, suggestion, key=side == "key"))
    return problems


def _clean(loc: tuple[Any, ...], data: Any, kind: str) -> tuple[Loc, int | None, bool]:
    """Strip union tags: return the place, the depth of the first union if any, whether a key is meant."""
    at_key = bool(loc) and loc[-1] == "[key]"
    steps: list[str | int] = []
    cut: int | None = None
    for i, step in enumerate(loc[:-1] if at_key else loc):
        if contains(data, step):
            data = data[step]
            steps.append(step)
        elif kind == "missing" and i == len(loc) - 1:
            steps.append(step)
        elif cut is None:
            cut = len(steps)
    return tuple(steps), cut, at_key


def _say(
    fault: dict[str, Any], loc: Loc, at_key: bool, model: type[BaseModel], owner: str
) -> tuple[Loc, str, str, str]:
    """Return the place, whether its key or value is meant, the message and a suggestion."""
    kind, ctx, given = fault["type"], fault.get("ctx", {}), fault["input"]
    if kind == "extra_forbidden":
        legal = legal_keys(model, loc[:-1])
        message = f"'{owner}' has no such option" if owner and len(loc) == 1 else "there is no such key here"
        hint = did_you_mean(str(loc[-1]), legal)
        if not hint and legal:
            hint = f"it has: {', '.join(sorted(legal))}" if len(legal) <= 12 else ""
        return loc, "key", message, hint
    if kind == "missing":
        text = legal_keys(model, loc[:-1]).get(str(loc[-1]), "")
        return loc, "value", "required, but not given", text
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        key = str(ctx.get("discriminator", "")).strip("'")
        words = re.findall(r"'([^']*)'", str(ctx.get("expected_tags", "")))
        if kind == "union_tag_not_found":
            return (*loc, key), "value", "required, but not given", ""
        message = f"should be {_either(words)}, got {show(ctx.get('tag'))}"
        return (*loc, key), "value", message, did_you_mean(str(ctx.get("tag")), words)
    side = "key" if at_key else "value"
    if kind in ("value_error", "assertion_error"):
        return loc, side, str(ctx.get("error", fault["msg"])), ""
    message = fault["msg"][:1].lower() + fault["msg"][1:]
    for theirs, ours in _PLAIN_WORDS:
        message = message.replace(theirs, ours)
    return loc, side, f"{message}, got {show(given)}", _remedy(kind, given, str(ctx.get("expected", "")))


def _remedy(kind: str, given: Any, expected: str) -> str:
    if kind in ("literal_error", "enum"):
        return did_you_mean(str(given), re.findall(r"'([^']*)'", expected))
    if kind == "bool_type" and isinstance(given, str) and given.lower() in _BOOL_WORDS:
        return f"write {_BOOL_WORDS[given.lower()]}"
    if kind in ("float_type", "int_type", "float_parsing", "int_parsing") and isinstance(given, str):
        return "remove the quotes" if _NUMBER.match(given) else ""
    if kind == "string_type" and isinstance(given, int | float | bool):
        return "write it in quotes"
    return ""


def show(value: Any) -> str:
    """Return a short text of a value, as a person would write it in YAML."""
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if value is None:
        return "nothing"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _either(words: list[str]) -> str:
    quoted = [f"'{w}'" for w in words]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def _join(messages: list[str]) -> str:
    """Join what the branches of a union say of one value: ``input should be a number or a list, got 'x'``."""
    unique = list(dict.fromkeys(messages))
    if len(unique) == 1:
        return unique[0]
    parts = [m.rsplit(", got ", 1) for m in unique]
    start = "input should be "
    if all(len(p) == 2 and p[0].startswith(start) and p[1] == parts[0][1] for p in parts):
        return f"{start}{' or '.join(p[0].removeprefix(start) for p in parts)}, got {parts[0][1]}"
    return "; or ".join(unique)


def legal_keys(model: type[BaseModel], loc: Loc) -> dict[str, str]:
    """Return the keys that a model allows at a place in it, with their descriptions."""
    models: list[type[BaseModel]] = [model]
    annotations: list[Any] = []
    for step in loc:
        inner = [
            m.model_fields[step].annotation
            for m in models
            if isinstance(step, str) and step in m.model_fields
        ]
        inner += [a for outer in annotations for a in _inside(outer)]
        annotations = inner
        models = [m for a in inner for m in _models(a)]
    return {(f.alias or name): (f.description or "") for m in models for name, f in m.model_fields.items()}


def _models(annotation: Any) -> Iterable[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) is Annotated:
        yield from _models(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, types.UnionType):
        for part in get_args(annotation):
            yield from _models(part)


def _inside(annotation: Any) -> Iterable[Any]:
    """Yield the annotations of the items of a list or mapping annotation."""
    if get_origin(annotation) in (Union, types.UnionType):
        for part in get_args(annotation):
            yield from _inside(part)
    elif get_origin(annotation) is not None:
        yield from (a for a in get_args(annotation)[-1:] if a is not Ellipsis)
