"""The sink ``mujoco_live``: commands in physics as they come."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.cli import main
from imitor.errors import SinkError
from imitor.plugins.robots.mujoco_live import MujocoLive
from imitor.record import Motion
from imitor.robot.model import RobotModel
from imitor.simulation.body import Body, Surroundings
from imitor.simulation.drives import make_drives
from imitor.simulation.live import LiveRun
from imitor.simulation.playback import play
from imitor.simulation.verdict import FallRule, figures
from imitor.testing import make_robot
from sink_peers import RATE_HZ, moved, opened, run_of, written

G1 = make_robot()


def waving(robot: RobotModel = G1, seconds: float = 2.0) -> list[Any]:
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    return [moved(robot, left_elbow_joint=0.6 + 0.4 * np.sin(4.0 * s)) for s in t]


def verdict(sink: MujocoLive) -> dict[str, Any]:
    found: dict[str, Any] = sink.finish().figures["simulation"]
    return found


def test_a_robot_that_waves_stays_up(tmp_path: Path) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(MujocoLive, run)
    written(sink, run, waving())
    found = verdict(sink)
    assert (found["fell"], found["frames"], found["survived_s"]) == (False, 100, 2.0)
    assert found["joint_error_rad"]["max"] < 0.06  # as the arm starts at 1.6 rad/s
    assert found["joint_error_rad"]["rms"] < 0.01 and found["base_error_m"]["max"] < 0.01
    assert found["step_s"] == 0.002 and found["torque_to_limit"]["saturated_share"] < 0.1
    assert "armed" not in sink.finish().figures["mujoco_live"]
    sink.close()
    sink.close()


def test_it_stands_where_the_commands_begin(tmp_path: Path) -> None:
    """Two metres away and facing left; what it does there is what it does here."""
    run = run_of(tmp_path, G1)
    here = opened(MujocoLive, run)
    written(here, run, waving())
    there = opened(MujocoLive, run)
    far = []
    for q in waving():
        q[:2] = 2.0, -1.0
        q[3:7] = 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)
        far.append(q)
    written(there, run, far)
    a, b = verdict(here), verdict(there)
    assert b["joint_error_rad"]["rms"] == pytest.approx(a["joint_error_rad"]["rms"], rel=1e-3)
    assert b["base_error_m"]["rms"] == pytest.approx(a["base_error_m"]["rms"], rel=0.05, abs=1e-4)
    here.close()
    there.close()


def test_it_blends_from_standing_and_measures_only_then(tmp_path: Path) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(MujocoLive, run)
    written(sink, run, [moved(G1, left_elbow_joint=0.1)] * 100)
    report = sink.finish().figures
    assert report["mujoco_live"]["approach_s"] == 1.5  # 1.5 times 0.5 rad at 0.5 rad/s
    assert report["simulation"]["frames"] == 100 - 75 + 1
    assert report["simulation"]["joint_error_rad"]["max"] < 0.03
    sink.close()


def test_a_fall_is_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(MujocoLive, run, blend_speed_rad_s=3.0)
    leaning = moved(G1, left_ankle_pitch_joint=0.4, right_ankle_pitch_joint=0.4)
    with caplog.at_level(logging.INFO, "imitor"):
        written(sink, run, [leaning] * 150)
    found = verdict(sink)
    assert found["fell"] and 0.3 < found["fall_time_s"] < 3.0
    assert [r.getMessage() for r in caplog.records if "fell" in r.getMessage()] == [
        f"mujoco_live: the robot fell after {found['fall_time_s']:.2f} s: {found['fall_reason']}"
    ]
    sink.close()


def test_command_by_command_is_as_at_once() -> None:
    """The same physics as the sink `mujoco` has, which knows the whole motion."""
    configurations = np.array(waving())
    drives = make_drives(G1, kp_per_effort=30.0, kv_per_kp=0.05)
    body = Body(G1, drives, Surroundings())
    n = len(configurations)
    motion = Motion(
        G1.name, np.arange(n) / RATE_HZ, G1.joint_names, configurations[:, 7:], configurations[:, :3],
        configurations[:, [6, 3, 4, 5]], np.ones((n, 2), dtype=bool), ["ok"] * n,
    )  # fmt: skip
    at_once = figures(play(body, motion, settle_s=0.5), body)
    live = LiveRun(
        Body(G1, drives, Surroundings()), 1.0 / RATE_HZ, FallRule(), velocity_reference=True, observer=None
    )
    live.place(configurations[0], 0.5)
    for q in configurations[1:]:
        live.step(q)
    found = live.figures()
    live.close()
    assert found["joint_error_rad"]["rms"] == pytest.approx(at_once["joint_error_rad"]["rms"], rel=0.2)
    assert found["torque_to_limit"]["max"] == pytest.approx(at_once["torque_to_limit"]["max"], rel=0.1)


def test_a_simulation_that_diverges_is_a_fall() -> None:
    drives = make_drives(G1, kp_per_effort=30.0, kv_per_kp=0.05)

    def shake(_model: Any, data: Any) -> None:
        data.qvel[:] = np.inf

    live = LiveRun(
        Body(G1, drives, Surroundings()), 0.02, FallRule(), velocity_reference=False, observer=shake
    )
    live.place(G1.standing, 0.0)
    for _ in range(3):
        live.step(G1.standing)
    found = live.figures()
    live.close()
    assert (found["fell"], found["fall_reason"], found["frames"]) == (True, "the simulation diverged", 0)


class Viewer:
    """Stands in for the window."""

    def __init__(self) -> None:
        self.shown, self.closed = 0, False

    def is_running(self) -> bool:
        return True

    def sync(self) -> None:
        self.shown += 1

    def close(self) -> None:
        self.closed = True


def test_the_window_is_fed_and_does_not_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import mujoco.viewer

    def sleep(_seconds: float) -> None:
        raise AssertionError("the runner keeps time")

    viewer = Viewer()
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("imitor.simulation.window.headless", lambda: False)
    monkeypatch.setattr("imitor.simulation.window.time.sleep", sleep)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", lambda _model, _data, **_how: viewer)
    run = run_of(tmp_path, G1, view=True)
    sink = opened(MujocoLive, run)
    written(sink, run, waving(seconds=0.5))
    sink.finish()
    sink.close()
    assert viewer.closed and 20 <= viewer.shown <= 31  # half a second at 60 Hz or a little less


def test_a_window_needs_a_display(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imitor.simulation.window.headless", lambda: True)
    with pytest.raises(SinkError, match="no display"):
        opened(MujocoLive, run_of(tmp_path, G1, view=True))


def test_in_a_pipeline(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    argv = ["run", "retarget", "--sink", "mujoco_live", "--frames", "10", "--set", "source.scenario=stand"]
    assert main([*argv, "--set", "mujoco_live.blend_speed_rad_s=3", "--out", str(tmp_path)]) == 0
    assert "simulation: it did not fall in" in capsys.readouterr().out
    assert json.loads((tmp_path / "metrics.json").read_text())["simulation"]["fell"] is False
    assert main([*argv, "--arm", "--out", str(tmp_path)]) == 2
    assert "--arm needs a sink that moves a real robot, and this pipeline has none" in capsys.readouterr().err
