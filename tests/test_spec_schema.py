"""The JSON Schema: what it allows, and that the file beside the presets is in step with the code."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from imitor.registry import Registry
from imitor.spec.json_schema import committed_path, pipeline_schema, schema_text
from toy_plugins import TOYS, toy_registry


@pytest.fixture
def schema(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    return pipeline_schema(toy_registry(tmp_path, monkeypatch))


def test_the_file_beside_the_presets_is_in_step() -> None:
    """When this fails: python -m imitor.spec.json_schema."""
    assert committed_path().read_text(encoding="utf-8") == schema_text(Registry(entry_points=False))


def test_every_plugin_is_a_choice(schema: dict[str, Any]) -> None:
    chosen = [
        option["$ref"].rsplit("/", 1)[1]
        for group in (schema["properties"]["source"], schema["properties"]["stages"]["items"],
                      schema["properties"]["sinks"]["items"])
        for option in group["anyOf"]
    ]  # fmt: skip
    assert sorted(chosen) == sorted(f"{toy.kind}-{toy.name}" for toy in TOYS)
    assert all(name in schema["$defs"] for name in chosen)


def test_a_plugin_s_options(schema: dict[str, Any]) -> None:
    fast = schema["$defs"]["solver-fast"]
    assert fast["properties"]["solver"] == {"const": "fast", "description": "Solve quickly."}
    assert fast["required"] == ["solver"]
    assert fast["additionalProperties"] is False
    assert fast["properties"]["damping"] == {
        "default": 0.1, "description": "Damping [-].", "maximum": 10, "minimum": 0, "title": "Damping",
        "type": "number",
    }  # fmt: skip
    assert schema["$defs"]["source-clip"]["required"] == ["use", "path"]
    assert "id" not in schema["$defs"]["source-clip"]["properties"]


def test_every_reference_has_its_definition(schema: dict[str, Any]) -> None:
    def references(part: Any) -> list[str]:
        if isinstance(part, dict):
            own = [part["$ref"]] if isinstance(part.get("$ref"), str) else []
            return own + [r for inner in part.values() for r in references(inner)]
        return [r for inner in part for r in references(inner)] if isinstance(part, list) else []

    found = references(json.loads(json.dumps(schema)))
    assert "#/$defs/solver-fast-Tolerance" in found
    assert all(r.removeprefix("#/$defs/") in schema["$defs"] for r in found)


def test_robots_are_suggested_and_cards_allowed(schema: dict[str, Any]) -> None:
    names, path = schema["properties"]["robot"]["anyOf"]
    assert "toybot" in names["enum"]
    assert path["type"] == "string"
