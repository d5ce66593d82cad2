"""Fixtures that all tests share."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("untimed", deadline=None)  # a busy machine is no failure
settings.register_profile(
    "repeatable", parent=settings.get_profile("untimed"), derandomize=True, database=None
)
settings.load_profile("repeatable" if os.environ.get("IMITOR_REPEATABLE") else "untimed")

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of shared captures: ``IMITOR_SHARED`` or ``../shared`` beside the project.

    Where ``IMITOR_REQUIRE_SHARED`` is set, a missing folder fails instead of skipping.
    """
    folder = Path(os.environ.get("IMITOR_SHARED", ROOT.parent / "shared"))
    if not (folder / "mocap").is_dir():
        message = f"no shared captures at {folder}; set IMITOR_SHARED to their folder"
        if os.environ.get("IMITOR_REQUIRE_SHARED"):
            pytest.fail(message)
        pytest.skip(message)
    return folder


def pytest_sessionfinish() -> None:
    """Refuse second copies of our modules, imported by folder name instead of through the package."""
    twins = sorted(m for m in sys.modules if m.split(".")[0] in {"framework", "plugins"})
    assert not twins, f"imported by folder name: {twins}"
