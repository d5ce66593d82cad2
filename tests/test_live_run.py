"""Live runs over a real socket: what is received is recorded, commands keep their rate, the newest frame wins."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor import Config, Postprocessor
from imitor.live.operator import Operator
from imitor.live.run import AT_REST_RAD_S
from imitor.registry import Registry
from imitor.run import run
from imitor.safety.tracking import Request
from imitor.spec import load_pipeline
from live_tools import Kept, free_port, later, live, registry, sender

STAND = ("--source", "performer", "--set", "source.scenario=wave", "--rate", "100")
HZ = "rate_hz=100"


@pytest.mark.parametrize("preset", ["retarget", "koenemann_2014"])
def test_the_recording_of_a_live_run_gives_the_same_configurations(preset: str, tmp_path: Path) -> None:
    port = free_port()
    with sender(port, *STAND, "--loss", "5", "--jitter", "15", "--reorder", "3", "--duplicate", "3"):
        result = live(preset, tmp_path / "live", port, frames=150, sets=[HZ])
    assert result.status == "done"
    plugins = Registry(entry_points=False)
    spec = load_pipeline(preset, plugins, input=tmp_path / "live/received.npz", sets=[HZ])
    again = run(spec, plugins, out_dir=tmp_path / "again")
    assert again.status == "done"
    assert (tmp_path / "live/motion.npz").read_bytes() == (tmp_path / "again/motion.npz").read_bytes()
    assert result.metrics["live"]["reception"]["lost"] > 0


def test_commands_leave_at_their_rate_between_slower_solutions(tmp_path: Path) -> None:
    port = free_port()
    with sender(port, *STAND[:-1], "30"):
        result = live("retarget", tmp_path / "run", port, frames=60, sets=[HZ, "source.rate_hz=30"])
    robot = Kept.told[-1]
    told = result.metrics["live"]
    assert told["step_rate_hz"] == 30
    assert told["output"]["rate_hz"] == robot.rate_hz == 100
    seconds = robot.time_s[-1] - robot.time_s[0]
    assert len(robot.q) == pytest.approx(100 * seconds, rel=0.1)
    steps = np.abs(np.diff(robot.joints(), axis=0))
    assert (steps <= robot.robot.speed / 100 + 1e-9).all()
    moving = steps.max(axis=1) > 0
    assert moving.mean() > 0.5  # in steps of its own between the solutions, not in one of three


class Slow(Postprocessor[Config]):
    """Takes ten periods."""

    name = "slow"

    def step(self, stack: Any, state: Any) -> None:
        time.sleep(0.1)


def test_a_stage_that_is_too_slow_delays_nothing_for_long(tmp_path: Path) -> None:
    plugins = registry()
    plugins.add(Slow, "tests")
    text = Path("pipelines/retarget.yaml").read_text(encoding="utf-8")
    pipeline = tmp_path / "slow.yaml"
    pipeline.write_text(text.replace("sinks:", "  - postprocessor: slow\nsinks:"), encoding="utf-8")
    port = free_port()
    with sender(port, *STAND):
        result = live(str(pipeline), tmp_path / "run", port, plugins=plugins, frames=30, sets=[HZ])
    told = result.metrics["live"]
    assert told["overruns"] >= 30
    assert told["replaced"] > 100  # the newest frame wins
    # no queue: beside the step's own time at most what is left of a frame that was under way
    assert told["latency_to_solution"]["median_ms"] < 1.5 * told["compute"]["median_ms"]
    assert told["output"]["sent"] > 5 * 30  # commands go on


def test_a_source_that_is_too_fast_is_followed_at_the_rate_of_the_pipeline(tmp_path: Path) -> None:
    port = free_port()
    with sender(port, *STAND[:-1], "1000"):
        result = live("retarget", tmp_path / "run", port, frames=200, sets=[HZ, "source.rate_hz=1000"])
    told = result.metrics["live"]
    assert told["step_rate_hz"] == 100
    assert told["replaced"] > 500
    assert result.metrics["duration_s"] > 1.8


class Scripted(Operator):
    """Asks at given steps, and quits."""

    def __init__(self, asks: dict[int, Request], quits_at: int) -> None:
        super().__init__()
        self._asks, self._quits_at, self._step = asks, quits_at, -1

    def take(self) -> Request:
        self._step += 1
        self.quits = self._step >= self._quits_at
        return self._asks.get(self._step, Request.NONE)


def test_the_operator_pauses_resumes_and_quits(tmp_path: Path) -> None:
    port, operator = free_port(), Scripted({50: Request.PAUSE, 150: Request.RESUME}, 300)
    with sender(port, *STAND):
        result = live("retarget", tmp_path / "run", port, sets=[HZ], operator=operator)
    assert result.status == "done"
    motion = np.load(tmp_path / "run/motion.npz")
    held = motion["status"] == "held"
    steps = np.abs(np.diff(motion["joint_position_rad"], axis=0))
    assert held[50:150].all()
    assert steps[120:149].max() <= AT_REST_RAD_S / 100  # it stands
    back = 50 + int(np.argmin(held[50:]))
    assert not held[back:300].any()
    assert held[-1]
    assert steps[-1].max() <= AT_REST_RAD_S / 100  # brought to rest


def test_ctrl_c_brings_the_robot_to_rest_and_keeps_everything(tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "run"
    command = [
        sys.executable, "-m", "imitor.cli", "run", "retarget", "--live", "--source", "joints_udp", "--set",
        f"source.port={port}", "--set", "source.wait_s=60", "--out", str(out),
    ]  # fmt: skip
    with sender(port, *STAND), subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "listening" in line:
                break
        time.sleep(2.0)
        os.kill(process.pid, signal.SIGINT)
        rest = process.stderr.read()
        assert process.wait(60) == 130, rest
    assert "Traceback" not in rest
    motion = np.load(out / "motion.npz")
    assert motion["status"][-1] == "held"
    assert np.abs(np.diff(motion["joint_position_rad"][-2:], axis=0)).max() <= AT_REST_RAD_S / 30
    assert (out / "received.npz").is_file()
    assert json.loads((out / "metrics.json").read_text())["live"]["steps"] == len(motion["status"])


def test_a_sender_that_goes_away_is_held_then_stopped(tmp_path: Path) -> None:
    port, operator = free_port(), Operator()
    with sender(port, *STAND, "--seconds", "4") as process:
        timer = later(12.0, operator.press, "q")
        result = live(
            "retarget",
            tmp_path / "run",
            port,
            sets=[HZ, "tracking.stop_s=0.5"],
            operator=operator,
            frames=900,
        )
        timer.cancel()
        del process
    assert result.status == "stopped"
    assert "the whole body" in result.message
    status = np.load(tmp_path / "run/motion.npz")["status"].tolist()
    first = status.index("stopped")
    assert status[first - 35 : first].count("held") >= 30
    joints = np.load(tmp_path / "run/motion.npz")["joint_position_rad"]
    assert (joints[first + 20 :] == joints[first + 20]).all()
    robot = Kept.told[-1]
    assert robot.status[-1] == 2


def test_nobody_sends(tmp_path: Path) -> None:
    from imitor.errors import ImitorError

    with pytest.raises(ImitorError, match="nothing arrived at 127"):
        live("retarget", tmp_path / "run", free_port(), sets=["source.wait_s=0.3"])
    assert not (tmp_path / "run").exists()
