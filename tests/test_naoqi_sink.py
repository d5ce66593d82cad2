"""The sink ``naoqi`` moves a robot that speaks the real protocol; robot and sink in processes of their own."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.errors import SinkError
from imitor.plugins.robots.naoqi import Naoqi
from imitor.testing import make_robot
from sink_peers import opened, run_of, written

pytest.importorskip("qi")
HERE = Path(__file__).parent
NAO = make_robot("nao_v4")
PATIENCE_S = 60.0


def played(robot: dict[str, Any], **options: Any) -> tuple[list[list[Any]], dict[str, Any]]:
    """Return what the robot was told, and how the sink ended: its figures or its error."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *(p for p in sys.path if p)])}
    with subprocess.Popen(
        [sys.executable, str(HERE / "naoqi_robot.py"), json.dumps(robot)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as peer:  # fmt: skip
        try:
            assert peer.stdout is not None
            port = json.loads(peer.stdout.readline())[1].rsplit(":", 1)[1]
            client = subprocess.run(
                [sys.executable, str(HERE / "naoqi_client.py"), port, json.dumps(options)],
                capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=environment,
            )  # fmt: skip
            told, _ = peer.communicate("", timeout=PATIENCE_S)
        finally:
            peer.kill()
    assert client.stdout, client.stderr
    return [json.loads(line) for line in told.splitlines()], json.loads(client.stdout.splitlines()[-1])


def test_a_robot_goes_slowly_to_the_first_command() -> None:
    start = dict(zip(NAO.joint_names, NAO.standing[7:].tolist(), strict=True))
    start["LShoulderPitch"] -= 0.1
    told, ended = played({"angles": start}, n=25, speed_fraction=0.8)
    assert told[:4] == [
        ["setIdlePostureEnabled", "Body", False], ["setBreathEnabled", "Body", False], ["getAngles", True],
        ["getAngles", True],
    ]  # fmt: skip
    calls = told[4:]
    assert {c[0] for c in calls} == {"setAngles"} and {c[3] for c in calls} == {0.8}
    assert {tuple(c[1]) for c in calls} == {tuple(NAO.joint_names)}  # no hands
    shoulder = np.array([c[2] for c in calls])[:, NAO.joint_index("LShoulderPitch")]
    assert shoulder[0] < start["LShoulderPitch"] + 0.02
    assert np.diff(shoulder).max() == pytest.approx(0.5 / 50.0, rel=0.05)  # blend_speed_rad_s
    assert calls[-1][2] == pytest.approx(NAO.standing[7:])
    figures = ended["naoqi"]
    assert (figures["commands"], figures["sent"] + figures["not_sent"]) == (25, 25)
    assert figures["approach_s"] == pytest.approx(0.3)


def test_both_hips_are_told_what_one_motor_can_do() -> None:
    told, _ = played({"angles": {"LHipYawPitch": -0.1, "RHipYawPitch": -0.3}}, n=10)
    left, right = (NAO.joint_index(f"{side}HipYawPitch") for side in "LR")
    angles = np.array([c[2] for c in told if c[0] == "setAngles"])
    assert (angles[:, left] == angles[:, right]).all() and angles[0, left] < -0.09


def test_no_more_commands_than_the_robot_takes_up() -> None:
    told, ended = played({}, n=21, rate_hz=100.0)
    figures = ended["naoqi"]
    assert figures["left_out"] == 10 and figures["commands"] == 21
    assert len([c for c in told if c[0] == "setAngles"]) == 21 - 10 + 1 - figures["not_sent"]  # and the end


def test_motors_that_are_off_stay_off_unless_asked_for() -> None:
    told, ended = played({"stiffness": 0.0})
    assert told == []
    assert ended["error"].startswith("the motors of HeadYaw, HeadPitch,")
    assert ended["error"].endswith(
        "are off; wake the robot up (press its chest button twice), or set the option `wake_up`"
    )
    told, ended = played({"stiffness": 0.0}, wake_up=True, still=False, n=3)
    assert told[:2] == [["wakeUp"], ["getAngles", True]] and "naoqi" in ended


def test_a_robot_with_other_joints_is_not_moved() -> None:
    told, ended = played({"without": ["LWristYaw"]})
    assert told == [] and "has no joint LWristYaw (it has HeadYaw, " in ended["error"]


def test_a_posture_that_cannot_be_is_not_blended_from() -> None:
    told, ended = played({"angles": {"LKneePitch": 3.0}})
    assert not [c for c in told if c[0] == "setAngles"]
    assert ended["error"].startswith("the robot tells that LKneePitch is at 3.00 rad, outside -0.09 to 2.11")


def test_a_robot_that_hangs_is_told() -> None:
    told, ended = played({"deaf_s": 3.0}, n=60, give_up_s=0.2)
    assert ended["error"] == (
        "for 0.2 s no command has got through: the robot has not yet answered the command before; "
        "the robot keeps what it was told last"
    )
    assert len([c for c in told if c[0] == "setAngles"]) <= 1


def test_nobody_at_the_address() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *(p for p in sys.path if p)])}
    client = subprocess.run(
        [sys.executable, str(HERE / "naoqi_client.py"), "1", "{}"],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=environment,
    )  # fmt: skip
    assert json.loads(client.stdout.splitlines()[-1])["error"] == (
        "tcp://127.0.0.1:1: Connect error: 111: Connection refused; "
        "is the robot switched on and in this network, and are `host` and `port` its own?"
    )


def test_what_listens_there_is_no_robot(tmp_path: Path) -> None:
    """qi itself hangs or crashes here."""
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        port = mute.getsockname()[1]
        with pytest.raises(
            SinkError, match=rf"^tcp://127.0.0.1:{port}: no answer in 0.2 s; is the robot switched on"
        ):
            opened(Naoqi, run_of(tmp_path, NAO), armed=True, port=port, timeout_s=0.2)


def test_unarmed_no_robot_is_needed(tmp_path: Path) -> None:
    run = run_of(tmp_path, NAO)
    sink = opened(Naoqi, run)
    written(sink, run, [NAO.standing] * 3)
    assert sink.finish().figures["naoqi"]["sent"] == 0
    sink.close()


def test_the_package_is_needed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SinkError, match=r"pip install 'imitor\[nao\]'$"):
        opened(Naoqi, run_of(tmp_path, NAO))
