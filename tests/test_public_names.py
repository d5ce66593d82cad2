"""The public names of the package: complete, importable, cheap, and one copy of each module."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import imitor
import imitor.testing

PACKAGE = Path(imitor.__file__).parent
KERNEL = sorted(
    m.name
    for m in pkgutil.walk_packages([str(PACKAGE)], "imitor.")
    if not m.name.startswith("imitor.plugins") and not m.name.endswith("__main__")
)


@pytest.mark.parametrize("package", [imitor, imitor.testing])
def test_every_public_name_is_there_and_explained(package: object) -> None:
    names = package.__all__  # type: ignore[attr-defined]
    assert len(names) == len(set(names))
    for name in names:
        value = getattr(package, name)
        if callable(value) and value is not imitor.hookimpl:
            assert value.__doc__, f"{name} has no docstring"


def test_what_a_plugin_author_needs_is_public() -> None:
    from imitor.kinds import KINDS

    for base in KINDS.values():
        assert getattr(imitor, base.__name__) is base
        assert base.__name__ in imitor.__all__


def test_importing_the_package_is_cheap() -> None:
    heavy = (
        "pinocchio",
        "placo",
        "mujoco",
        "fcl",
        "rerun",
        "scipy",
        "trimesh",
        "PIL",
        "rich",
        "imitor.robot.model",
    )
    code = f"import sys, imitor\nprint([h for h in {heavy} if h in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_package_keeps_blas_to_one_thread() -> None:
    code = "import imitor, os; print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])"
    import os

    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.split() == ["1", "1"]


@pytest.mark.parametrize("name", KERNEL)
def test_every_module_imports_and_says_what_it_is(name: str) -> None:
    module = importlib.import_module(name)
    assert (module.__doc__ or "").strip()


def test_plugins_do_not_import_one_another() -> None:
    for path in sorted((PACKAGE / "plugins").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            wrong = [n for n in names if n.startswith("imitor.plugins")]
            assert not wrong, f"{path.name} imports {wrong}"


def test_the_framework_knows_no_plugin() -> None:
    for path in sorted(PACKAGE.rglob("*.py")):
        relative = path.relative_to(PACKAGE)
        if relative.parts[0] == "plugins":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert not (node.module or "").startswith("imitor.plugins."), (
                    f"{relative} imports {node.module}"
                )
            if isinstance(node, ast.Import):
                assert not any(a.name.startswith("imitor.plugins.") for a in node.names), str(relative)


def test_plugins_import_heavy_packages_in_methods_only() -> None:
    heavy = {"pinocchio", "placo", "mujoco", "fcl", "rerun", "scipy", "trimesh", "PIL", "rich"}
    for path in sorted((PACKAGE / "plugins").rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import):
                assert not {a.name.split(".")[0] for a in node.names} & heavy, path.name
            if isinstance(node, ast.ImportFrom):
                assert (node.module or "").split(".")[0] not in heavy, path.name
