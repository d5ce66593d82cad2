"""Cells of the table of parts in every combination: what runs stands, and what is refused says why."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

from imitor.registry import Registry

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture
def swap(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("swap")


@pytest.mark.parametrize(
    ("mapper", "stabilizer", "solver", "robot"),
    [
        ("normalized_model", "com_anticipation", "placo", "nao_v4"),  # nine levels in one quadratic program
        ("virtual_marker_fit", "contact_transition", "damped_least_squares", "hrp2"),
    ],
)
def test_a_cell_stands_within_limits(
    swap: ModuleType, mapper: str, stabilizer: str, solver: str, robot: str
) -> None:
    cell = swap.Combination(mapper, stabilizer, solver)
    found = swap.outcome(cell, Registry(entry_points=False), robot, ["step_forward"], 1.0)
    assert (found.refused, found.faults, found.stands) == ("", [], 1.0)


def test_a_refused_cell_says_why(swap: ModuleType) -> None:
    cell = swap.Combination("virtual_marker_fit", "com_anticipation", "prioritized")
    found = swap.outcome(cell, Registry(entry_points=False), "hrp2", ["step_forward"], 1.0)
    assert found.refused == ("stages[3] anticipate: needs the task 'com', which no stage before it declares")
    assert swap.cell(found) == "refused"
