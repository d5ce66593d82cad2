"""The programs of the papers run, write their page, and count phases of support as they should."""

from __future__ import annotations

import importlib
import itertools
import os
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from captured_people import small_trc

PAPERS = Path(__file__).resolve().parents[1] / "benchmarks" / "papers"
SUPPORTS: Any = runpy.run_path(str(PAPERS / "supports.py"))
BOTH, LEFT, RIGHT, NONE = (True, True), (True, False), (False, True), (False, False)


def program(name: str, *options: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k != "IMITOR_SHARED"}
    command = [sys.executable, str(PAPERS / name), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def test_a_short_slice_writes_tables_and_a_figure(tmp_path: Path) -> None:
    page = tmp_path / "presets" / "koenemann_2014.md"
    page.parent.mkdir()
    page.write_text("# koenemann_2014\n\nWritten by hand.\n")
    cases = ("single_leg_balance", "CMU 49_18, on one leg")
    done = program("koenemann_2014.py", *cases, "--quick", "--frames", "30", "--docs", str(tmp_path))
    assert done.returncode == 0, done.stderr
    text = page.read_text()
    assert text.startswith("# koenemann_2014\n\nWritten by hand.\n")
    assert text.count("| paper | ours | command |") == 1
    assert "| `single_leg_balance` | 30 |" in text
    assert "Left out: CMU 49_18, on one leg: no folder of captures" in text
    figures = list((tmp_path / "img" / "papers").glob("*.png"))
    assert [f.name for f in figures] == ["koenemann_2014_single_leg_balance.png"]
    assert figures[0].stat().st_size < 200_000
    assert f"../img/papers/{figures[0].name}" in text
    with Image.open(figures[0]) as picture:
        assert picture.size == (1500, 1900)


def test_captures_are_tabled_and_refusals_say_why(tmp_path: Path) -> None:
    folder, docs = tmp_path / "mocap" / "some_trc", tmp_path / "docs"
    folder.mkdir(parents=True)
    small_trc(folder)
    options = "--captures", str(tmp_path / "mocap"), "--frames", "5", "--docs", str(docs)
    done = program("captures.py", *options)
    assert done.returncode == 0, done.stderr
    ran = (docs / "presets" / "montecillo_2010.md").read_text()
    assert "1 of 1 recordings run" in ran
    assert "| `some_trc/person.trc` | cmu_41 |" in ran
    refused = (docs / "presets" / "tomic_2018.md").read_text()
    assert "0 of 1 recordings run" in refused
    assert (
        "- refused: stages[0] map: needs the human's targets, which nothing before it gives: "
        "`some_trc/person.trc`" in refused
    )


def test_the_written_part_is_replaced_and_the_rest_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(PAPERS))
    page = importlib.import_module("page")
    for text in ("first", "second"):
        path = page.write(tmp_path, "some_preset", "benchmarks/some.py", text)
        if text == "first":
            path.write_text(path.read_text() + "\n## Departures\n")
    assert path.read_text() == (
        "# some_preset\n\n<!-- Written by: python benchmarks/some.py -->\n\nsecond\n\n"
        "<!-- End of the written part. -->\n\n## Departures\n"
    )


def test_an_unknown_case_is_refused() -> None:
    done = program("koenemann_2014.py", "no_such_case")
    assert done.returncode == 1
    assert "no case is called no_such_case; there are: single_leg_balance" in done.stderr


@given(st.lists(st.sampled_from([BOTH, LEFT, RIGHT, NONE]), min_size=1, max_size=40))
def test_phases_cover_every_frame_once(feet: list[tuple[bool, bool]]) -> None:
    found = SUPPORTS["phases"](np.array(feet))
    frames = [i for p in found for i in range(p.first, p.last + 1)]
    assert frames == list(range(len(feet)))
    assert all(a.mode != b.mode for a, b in itertools.pairwise(found))


@pytest.mark.parametrize(
    ("robot", "delays"),
    [
        ([BOTH] * 5 + [LEFT] * 3 + [BOTH] * 6 + [RIGHT] * 4 + [BOTH] * 2, [2, 2]),  # late, but both
        ([BOTH] * 14 + [RIGHT] * 4 + [BOTH] * 2, [None, 2]),  # never on the left foot
        (
            [BOTH] * 13 + [LEFT] * 5 + [BOTH] * 2,
            [None, None],
        ),  # on the left one only when the right one is asked for
    ],
)
def test_a_single_support_is_executed_before_the_next_is_asked_for(
    robot: list[tuple[bool, bool]], delays: list[int | None]
) -> None:
    human = np.array([BOTH] * 3 + [LEFT] * 4 + [BOTH] * 5 + [RIGHT] * 4 + [BOTH] * 4)
    pairs = list(SUPPORTS["executed"](human, np.array(robot)))
    assert [None if r is None else r.first - h.first for h, r in pairs] == delays


def test_a_foot_in_the_air_counts_where_it_last_stood() -> None:
    support = np.array([BOTH, BOTH, LEFT, LEFT, BOTH])
    left = np.tile([0.0, 0.1, 0.0], (5, 1))
    right = np.array([[0, -0.1, 0], [0, -0.1, 0], [-0.3, 0.05, 0.2], [0.5, 0.09, 0.3], [0.1, -0.1, 0]])
    com = np.tile([0.0, 0.05, 0.3], (5, 1))
    offsets = SUPPORTS["offsets"](com, [left, right], support)
    np.testing.assert_allclose(offsets, [0.25, 0.25, 0.25, 0.25, 0.2], atol=1e-12)
