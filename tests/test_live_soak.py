"""Two minutes of a live run over a bad network; an hour of it: ``python benchmarks/live_soak.py --minutes 60``."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from live_tools import free_port

PROGRAM = Path(__file__).parents[1] / "benchmarks/live_soak.py"


@pytest.mark.slow
def test_two_minutes_over_a_bad_network(tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    command = [sys.executable, str(PROGRAM), "--minutes", "2", "--port", str(free_port()), "--json", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["ended"] == "done"
    assert found["commands"] > 10_000
    assert found["commands not finite"] == found["commands outside limits"] == found["commands too fast"] == 0
    assert found["reception"]["lost"] > 100
    assert found["reception"]["malformed"] == 0
    assert found["memory grown [%]"] <= 2.0
