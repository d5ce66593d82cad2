"""The sink ``mujoco``: the finished motion of a pipeline in physics, its verdict in ``metrics.json``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from imitor.cli import main
from imitor.errors import ImitorError
from imitor.record import Motion
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.run import RunResult, run
from imitor.spec import load_text

PIPELINE = """
imitor: 1
robot: {robot}
rate_hz: 60
source: {{use: performer, scenario: {scenario}}}
stages:
  - filter: support_by_height
    speed_m_s: 0.4
  - filter: human_com
  - mapper: segment_scaling
  - solver: prioritized
    order:
      - [left_foot, right_foot, left_ankle, right_ankle]
      - [left_upper_arm, right_upper_arm, left_forearm, right_forearm, left_thigh, right_thigh, left_shank,
         right_shank, torso, waist, chest]
    null_space: {{posture: -0.02}}
sinks:
  - {{use: mujoco{options}}}
"""
REGISTRY = Registry(entry_points=False)


def simulate(
    out: Path, robot: str = "unitree_g1", scenario: str = "stand", options: str = "", **how: Any
) -> RunResult:
    text = PIPELINE.format(robot=robot, scenario=scenario, options=options and f", {options}")
    return run(load_text(text, REGISTRY, "test"), REGISTRY, out_dir=out, **how)


def verdict(result: RunResult) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((result.out_dir / "metrics.json").read_text())["simulation"]
    return found


@pytest.mark.parametrize("scenario", ["stand", "wave"])
@pytest.mark.parametrize("robot", ["unitree_g1", "talos", "nao_v4", "hrp2"])
def test_robots_that_stand_and_wave_stay_up(tmp_path: Path, robot: str, scenario: str) -> None:
    result = simulate(tmp_path, robot, scenario)
    assert (result.status, result.message) == ("done", "")
    found = verdict(result)
    assert (found["fell"], found["fall_reason"]) == (False, "")
    assert found["frames"] == result.frames
    assert found["zmp_margin_double_support_m"]["min"] > 0.0


@pytest.mark.parametrize("scenario", ["single_leg_balance", "two_steps_and_reach", "step_forward"])
def test_the_stabilised_preset_stays_up_on_one_foot(
    scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No controller helps: NAO's servos follow the commands, and the statically stable motion is enough."""
    argv = [
        "run",
        "koenemann_2014",
        "--set",
        f"source.scenario={scenario}",
        "--simulate",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(argv) == 0
    found = json.loads((tmp_path / "out" / "metrics.json").read_text())["simulation"]
    assert (found["fell"], found["fall_reason"]) == (False, "")
    assert found["zmp_margin_single_support_m"]["frames"] > 30
    assert f"simulation: it did not fall in {found['survived_s']:.2f} s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("robot", "joint"), [("talos", "torso_2_joint"), ("unitree_g1", "waist_pitch_joint")]
)
def test_a_deep_squat_without_stabilizer_asks_for_all_the_torque_there_is(
    tmp_path: Path, robot: str, joint: str
) -> None:
    """Holding the trunk that far forward takes its servo's whole torque; the verdict shows that it saturates."""
    result = simulate(tmp_path, robot, "squat")
    assert result.status == "done"  # a fall is a verdict, not a failure
    model = RobotModel.load(robot, REGISTRY)
    motion = Motion.load(tmp_path / "motion.npz")
    row = 6 + model.joint_index(joint)
    holding = max(
        abs(pin.computeGeneralizedGravity(model.model, model.data, q)[row]) for q in motion.configurations()
    )
    found = verdict(result)
    assert found["fell"] and holding > 0.9 * model.model.effortLimit[row]
    assert found["torque_to_limit"]["joint"] == joint and found["torque_to_limit"]["saturated_share"] > 0.1


def test_the_file_holds_what_the_robot_did(tmp_path: Path) -> None:
    result = simulate(tmp_path, max_frames=40)
    assert tmp_path / "simulation.npz" in result.files
    with np.load(tmp_path / "simulation.npz") as arrays:
        assert arrays["joint_position_rad"].shape == arrays["torque_nm"].shape == (40, 29)
        assert arrays["zmp_m"].shape == (40, 2) and not arrays["fallen"].any()
        motion = Motion.load(tmp_path / "motion.npz")
        assert np.array_equal(arrays["time_s"], motion.time_s)
        error = np.abs(arrays["joint_position_rad"] - motion.joint_position_rad)
    assert error.max() == pytest.approx(verdict(result)["joint_error_rad"]["max"], rel=1e-4)


def test_no_file_where_none_is_wanted(tmp_path: Path) -> None:
    result = simulate(tmp_path, options="file: false", max_frames=5)
    assert not [p for p in tmp_path.iterdir() if p.name.startswith("simulation")]
    assert verdict(result)["frames"] == 5


def test_video_without_display(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path / "cache"))
    out = tmp_path / "run"
    result = simulate(out, options="video: true, fps: 10, size_px: [128, 96]", max_frames=60)
    assert result.status == "done", result.message
    with Image.open(out / "simulation.gif") as film:
        assert (film.size, film.n_frames) == ((128, 96), 10)
    with Image.open(out / "simulation.png") as sheet:
        assert sheet.width == 1600


def test_wrong_options_are_refused_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(ImitorError, match=r"sinks\[0\].*kp_nm_per_rad.*no link or joint 'knee'"):
        simulate(tmp_path / "run", options="kp_nm_per_rad: {knee: 3}")
    assert not (tmp_path / "run").exists()


def test_a_window_needs_a_display(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imitor.simulation.window.headless", lambda: True)
    with pytest.raises(ImitorError, match="no display"):
        simulate(tmp_path, view=True)


class Viewer:
    """Stands in for the window."""

    def __init__(self) -> None:
        self.shown, self.closed = 0, False

    def is_running(self) -> bool:
        return self.shown < 5  # then a person closes it

    def sync(self) -> None:
        self.shown += 1

    def close(self) -> None:
        self.closed = True


def test_the_window_shows_the_robot_until_it_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import mujoco.viewer

    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("imitor.simulation.window.headless", lambda: False)
    viewer, models = Viewer(), []

    def launch(model: Any, _data: Any, **_how: Any) -> Viewer:
        models.append(model)
        return viewer

    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    result = simulate(tmp_path / "run", view=True, max_frames=10)
    assert (result.status, viewer.shown, viewer.closed) == ("done", 5, True)
    assert models[0].nmesh > 10  # the robot is seen as it looks
    unseen = simulate(tmp_path / "unseen", max_frames=10)
    a, b = verdict(result), verdict(unseen)
    del a["real_time_factor"], b["real_time_factor"]
    assert a == b


def test_simulate_on_the_command_line(tmp_path: Path) -> None:
    assert main(["run", "retarget", "--set", "source.scenario=stand", "--simulate", "--frames", "30",
                 "--out", str(tmp_path), "--quiet"]) == 0  # fmt: skip
    assert json.loads((tmp_path / "metrics.json").read_text())["simulation"]["fell"] is False
