"""Every broken input gets its message and its exit status, as a user would see them, and never a traceback."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from broken_inputs import CASES, Case, prepare
from imitor.cli import main


def answer(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Return exit status and all that is printed."""
    argv = case.command.split()
    if not case.first:
        status = main(argv)
        return status, "".join(reversed(capfd.readouterr()))
    code = f"{case.first}\nimport sys\nfrom imitor.cli import main\nsys.exit(main({argv!r}))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stderr + done.stdout


def matches(line: str, expected: str) -> bool:
    """Tell whether a line is the expected one, or begins so."""
    return line == expected or (expected.endswith("…") and line.startswith(expected[:-1]))


@pytest.mark.parametrize("case", CASES, ids=[f"{c.group}: {c.wrong}" for c in CASES])
def test_is_answered(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    prepare(case, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.delenv("MY_ROBOT", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    status, text = answer(case, tmp_path, capfd)
    lines, expected = text.splitlines(), case.said.splitlines()
    starts = range(max(len(lines) - len(expected) + 1, 1))
    assert any(all(map(matches, lines[i:], expected)) for i in starts), text
    assert status == case.status, text
    assert "Traceback" not in text
    assert "internal error" not in text
    if case.status == 2:
        assert not (tmp_path / "out").is_dir()
    if case.kept:
        with np.load(tmp_path / "out" / "motion.npz") as motion:
            assert motion["time_s"].shape == (case.kept,)
    assert not list(tmp_path.glob("out/.*")), "half a file was left"


def test_there_are_many_of_all_sorts() -> None:
    assert len(CASES) >= 60
    assert len({c.group for c in CASES}) == 6
    assert {c.status for c in CASES} == {0, 1, 2, 130}
    assert len({(c.group, c.wrong) for c in CASES}) == len(CASES)
