"""Importing a plugin must be cheap: every command imports all plugins."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from typing import Final

from imitor.testing.expect import AnyComponent, expect

HEAVY_PACKAGES: Final = ("pinocchio", "placo", "mujoco", "fcl", "rerun", "scipy", "trimesh", "PIL", "rich")
"""Packages that a plugin imports inside its methods."""

_PROBE: Final = """
import importlib, importlib.util, json, sys
name, file, heavy = json.loads(sys.argv[1])
try:
    importlib.import_module(name)
except ModuleNotFoundError as error:
    if error.name != name.split(".")[0] or not file:
        raise
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
print(json.dumps([h for h in heavy if h in sys.modules]))
"""


def check_import(cls: AnyComponent) -> None:
    """Import the plugin's module in a fresh interpreter: none of `HEAVY_PACKAGES` may come with it."""
    module = sys.modules.get(cls.__module__)
    failed, found = heavy_imports(cls.__module__, getattr(module, "__file__", "") or "")
    expect(not failed, cls, f"its module {cls.__module__} cannot be imported by itself: {failed}")
    expect(
        not found,
        cls,
        f"importing {cls.__module__} imports {', '.join(found)}; import them inside the methods that need them",
    )


@functools.cache
def heavy_imports(module: str, file: str) -> tuple[str, tuple[str, ...]]:
    """Return why a module cannot be imported (or an empty text) and the heavy packages it imports."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run(
        [sys.executable, "-c", _PROBE, json.dumps([module, file, HEAVY_PACKAGES])],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        return (lines[-1] if lines else f"exit status {done.returncode}"), ()
    return "", tuple(json.loads(done.stdout.splitlines()[-1]))
