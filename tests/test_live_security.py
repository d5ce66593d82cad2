"""Sockets stay on this machine unless told otherwise, nothing is unpickled, and a pipeline's text cannot run code."""

from __future__ import annotations

import ast
import ipaddress
from pathlib import Path
from typing import Any

import pytest

from imitor.errors import SpecError
from imitor.kinds import Sink
from imitor.live.receiver import LARGEST_DATAGRAM
from imitor.live.source import LiveSource
from imitor.registry import Registry
from imitor.spec import load_text

ROOT = Path(__file__).parents[1]
REGISTRY = Registry(entry_points=False)
WITH_HOST = [r.component for r in REGISTRY if "host" in r.component.config_type.model_fields]
DANGEROUS = {"pickle", "cPickle", "marshal", "shelve", "dill", "joblib"}


@pytest.mark.parametrize("component", WITH_HOST, ids=[c.name for c in WITH_HOST])
def test_hosts_are_this_machine_by_default(component: Any) -> None:
    default = component.config_type.model_fields["host"].default
    assert ipaddress.ip_address(default).is_loopback


def test_live_sources_and_robots_are_among_them() -> None:
    names = {c.name for c in WITH_HOST}
    assert names >= {r.name for r in REGISTRY if issubclass(r.component, LiveSource)}
    assert names >= {"udp_json", "zmq", "redis", "naoqi"}
    assert any(issubclass(r.component, Sink) for r in REGISTRY)


def test_nothing_is_unpickled_or_evaluated() -> None:
    for path in [*(ROOT / "framework").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not DANGEROUS.intersection(n.split(".")[0] for n in names), path
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("eval", "exec"), path


def test_a_datagram_is_bounded() -> None:
    assert LARGEST_DATAGRAM <= 65535


@pytest.mark.parametrize(
    "value", ["!!python/object/apply:os.system [touch gone]", "!!python/name:os.system", "!ruby/object {}"]
)
def test_a_pipeline_cannot_run_code(value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = f"imitor: 1\nrobot: unitree_g1\nsource: {{use: performer, scenario: {value}}}\nstages: []\n"
    with pytest.raises(SpecError):
        load_text(text, REGISTRY)
    assert not list(tmp_path.iterdir())
