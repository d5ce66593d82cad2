"""``imitor new``: what it writes works, for every kind, in a real pipeline."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from imitor.cli import main
from imitor.kinds import KINDS, RunInfo, Sink
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_text

PIPELINE = """\
imitor: 1
robot: romeo
source: {use: %(source)s}
stages:
  - filter: support_by_height
  - %(filter)s
  - mapper: %(mapper)s
  - solver: prioritized
    order: [[com]]
  - %(late)s
sinks: []
"""
NAME = "my_part"


def written(kind: str, folder: Path, name: str = NAME) -> ModuleType:
    assert main(["new", kind, name, "--dir", str(folder)]) == 0
    path = folder / f"imitor_{name}.py"
    spec = importlib.util.spec_from_file_location(f"imitor_{name}_{kind}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def pipeline_with(kind: str, module: ModuleType) -> Pipeline:
    registry = Registry(entry_points=False)
    registry.register(module, module.__name__)
    parts = {"source": "performer", "filter": "filter: human_com", "mapper": "segment_scaling"}
    parts["late"] = "solver: prioritized\n    id: again\n    order: [[com]]"
    if kind in ("source", "mapper"):
        parts[kind] = NAME
    elif kind == "filter":
        parts["filter"] = f"filter: {NAME}"
    elif kind != "sink":
        parts["late"] = f"{kind}: {NAME}"
    return Pipeline(load_text(PIPELINE % parts, registry), registry)


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_new_plugin_runs(kind: str, tmp_path: Path) -> None:
    module = written(kind, tmp_path)
    pipeline = pipeline_with(kind, module)
    sink: Sink[Any] | None = None
    if kind == "sink":
        sink = module.MyPart(module.MyPartConfig())
        sink.open(RunInfo(tmp_path, pipeline.robot, pipeline.skeleton, pipeline.rate_hz, pipeline.stack))
    n = 0
    for record in pipeline.records(5):
        n += 1
        assert np.isfinite(record.state.q).all()
        if sink is not None:
            sink.write(record)
    pipeline.close()
    assert n == 5
    if sink is not None:
        (path,) = sink.finish().files
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        assert table.shape == (5, 1 + pipeline.robot.n)


@pytest.mark.parametrize("kind", list(KINDS))
def test_its_own_test_passes(kind: str, tmp_path: Path) -> None:
    assert main(["new", kind, NAME, "--dir", str(tmp_path)]) == 0
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("kind", list(KINDS))
def test_it_is_formatted_and_clean(kind: str, tmp_path: Path) -> None:
    assert main(["new", kind, NAME, "--dir", str(tmp_path)]) == 0
    for path in tmp_path.rglob("*.py"):
        text = path.read_text()
        compile(text, str(path), "exec")
        assert max(map(len, text.splitlines())) <= 110
        assert "\n\n\n\n" not in text
        assert "{{" not in text


def test_the_entry_point_names_the_module(tmp_path: Path) -> None:
    import tomllib

    assert main(["new", "filter", NAME, "--dir", str(tmp_path)]) == 0
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text())
    assert project["project"]["name"] == "imitor-my-part"
    assert project["project"]["entry-points"]["imitor"] == {NAME: f"imitor_{NAME}"}
    assert project["tool"]["setuptools"]["py-modules"] == [f"imitor_{NAME}"]


def test_a_name_like_a_class_of_imitor_works(tmp_path: Path) -> None:
    module = written("filter", tmp_path, "filter")
    assert module.FilterPlugin.name == "filter"


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "pyproject.toml").write_text("mine")
    assert main(["new", "sink", NAME, "--dir", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f"already there: {tmp_path}/pyproject.toml; nothing was written, choose another --dir\n"
    )
    assert [p.name for p in tmp_path.iterdir()] == ["pyproject.toml"]
    assert (tmp_path / "pyproject.toml").read_text() == "mine"


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        ("fliter", "x", "there is no kind 'fliter'; did you mean 'filter'?\n"),
        (
            "filter",
            "My-Filter",
            "'My-Filter' cannot be a plugin's name; use lower-case letters, digits and _\n",
        ),
        ("filter", "class", "'class' cannot be a plugin's name; use lower-case letters, digits and _\n"),
        ("filter", "../x", "'../x' cannot be a plugin's name; use lower-case letters, digits and _\n"),
    ],
)
def test_refused(kind: str, name: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", kind, name, "--dir", str(tmp_path / "new")]) == 2
    assert capsys.readouterr().err == said
    assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["new", "filter", NAME, "--dir", str(tmp_path / "file")]) == 2
    assert "cannot write to" in capsys.readouterr().err
