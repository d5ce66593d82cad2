"""The JSON Schema of a pipeline, for editors: completion, hover texts and red lines while writing.

``python -m imitor.spec.json_schema`` writes the schema of the built-in plugins beside the presets, whose
first line names it: ``# yaml-language-server: $schema=imitor.schema.json``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from imitor.atomic import atomic
from imitor.kinds import STAGE_KINDS
from imitor.registry import Registered, Registry
from imitor.spec.schema import VERSION, PipelineDocument

FILE_NAME: Final = "imitor.schema.json"
_ID: Final = {
    "type": "string",
    "pattern": "^[A-Za-z_][A-Za-z0-9_-]*$",
    "description": "Name of this stage in the pipeline; default: the plugin's name.",
}


def pipeline_schema(registry: Registry) -> dict[str, Any]:
    """Return the JSON Schema (draft 7) of a pipeline with the plugins of a registry."""
    definitions: dict[str, Any] = {}
    variants: dict[str, list[dict[str, str]]] = {"source": [], "stages": [], "sink": []}
    for entry in registry:
        name = f"{entry.kind}-{entry.name}"
        definitions[name] = _plugin(entry, definitions)
        group = "stages" if entry.kind in STAGE_KINDS else entry.kind
        variants[group].append({"$ref": f"#/$defs/{name}"})
    top = PipelineDocument.model_json_schema()
    definitions |= top.pop("$defs", {})
    properties = top["properties"]
    for text in properties.values():
        text.pop("title", None)
    properties["imitor"]["const"] = VERSION
    robots = sorted(registry.cards("robots"))
    properties["robot"]["anyOf"] = [{"enum": robots}, {"type": "string", "pattern": r"\.ya?ml$|/|^\$\{"}]
    properties["source"] = {"description": properties["source"]["description"], "anyOf": variants["source"]}
    properties["stages"]["items"] = {"anyOf": variants["stages"]}
    properties["sinks"]["items"] = {"anyOf": variants["sink"]}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "imitor pipeline",
        "type": "object",
        "properties": properties,
        "required": ["imitor", "robot", "source", "stages"],
        "additionalProperties": False,
        "$defs": definitions,
    }


def _plugin(entry: Registered, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of one stage; schemas of models inside its options go into ``definitions``."""
    prefix = f"{entry.kind}-{entry.name}-"
    options = entry.component.config_type.model_json_schema(ref_template=f"#/$defs/{prefix}{{model}}")
    for inner, schema in options.pop("$defs", {}).items():
        definitions[prefix + inner] = schema
    key = entry.kind if entry.kind in STAGE_KINDS else "use"
    properties: dict[str, Any] = {key: {"const": entry.name, "description": entry.component.summary()}}
    if entry.kind != "source":
        properties["id"] = _ID
    return {
        "title": f"{entry.kind} {entry.name}",
        "description": entry.component.summary(),
        "type": "object",
        "properties": {**properties, **options.get("properties", {})},
        "required": [key, *options.get("required", [])],
        "additionalProperties": False,
    }


def schema_text(registry: Registry) -> str:
    """Return the schema as the text of a file."""
    return json.dumps(pipeline_schema(registry), indent=1, ensure_ascii=False) + "\n"


def write_schema(path: Path, registry: Registry) -> None:
    """Write the schema to a file."""
    with atomic(path) as temporary:
        temporary.write_text(schema_text(registry), encoding="utf-8")


def committed_path() -> Path:
    """Return the file beside the presets."""
    return Path(__file__).resolve().parents[1] / "pipelines" / FILE_NAME


if __name__ == "__main__":
    write_schema(committed_path(), Registry(entry_points=False))
