"""The sink ``unitree`` moves a G1 that speaks DDS; robot and sink in processes of their own."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from imitor.errors import SinkError, UnknownJoint
from imitor.testing import make_robot
from sink_peers import opened, run_of, written

pytest.importorskip("cyclonedds")

from imitor.commands.unitree_hg import LowCmd_, checksum, crc32_mpeg2, new_command
from imitor.plugins.robots.unitree import GAINS, Unitree, UnitreeConfig

HERE = Path(__file__).parent
G1 = make_robot()
STANDING = G1.standing[7:]
PATIENCE_S = 60.0


def played(robot: dict[str, Any], **options: Any) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return what the robot was told, and how the sink ended: its figures or its error."""
    domain = random.SystemRandom().randrange(20, 200)  # others test here as well
    topic = f"rt/{options.get('mode', 'arm_sdk')}"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *(p for p in sys.path if p)])}
    with subprocess.Popen(
        [sys.executable, str(HERE / "unitree_robot.py"), str(domain), topic, json.dumps(robot)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
    ) as peer:  # fmt: skip
        try:
            assert peer.stdout is not None
            assert json.loads(peer.stdout.readline()) == "ready"
            client = subprocess.run(
                [sys.executable, str(HERE / "unitree_client.py"), json.dumps(options | {"domain": domain})],
                capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=environment,
            )  # fmt: skip
            told, _ = peer.communicate("", timeout=PATIENCE_S)
        finally:
            peer.kill()
    assert client.stdout, client.stderr
    return [json.loads(line) for line in told.splitlines()], json.loads(client.stdout.splitlines()[-1])


def near_standing(**elsewhere: float) -> dict[str, Any]:
    """Return a robot in the standing posture but for some joints."""
    q = dict(enumerate(STANDING.tolist()))
    return {"q": q | {G1.joint_index(name): value for name, value in elsewhere.items()}}


def test_the_checksum_is_the_makers() -> None:
    command = new_command()
    command.mode_machine = 5
    motor = command.motor_cmd[3]
    motor.mode, motor.q, motor.kp = 1, 0.5, 100.0
    assert checksum(command) == 357433963
    assert crc32_mpeg2(b"123456789") == 0x0376E6E7  # the catalogue's check value


def test_bytes_are_those_of_cyclonedds() -> None:
    command, rng = new_command(), random.Random(1)
    command.mode_pr, command.mode_machine, command.reserve, command.crc = 1, 5, [1, 2, 3, 4], 77
    for i, m in enumerate(command.motor_cmd):
        m.mode, m.q, m.dq, m.tau, m.kp, m.kd, m.reserve = i, *(rng.random() for _ in range(5)), i
    plain: Any = super(LowCmd_, command)
    for version in (None, False, True):
        assert command.serialize(use_version_2=version) == plain.serialize(use_version_2=version)
    again = LowCmd_.deserialize(command.serialize())
    assert again.crc == 77 and again.motor_cmd[34].reserve == 34


def test_arms_are_taken_over_slowly() -> None:
    told, ended = played(near_standing(left_elbow_joint=0.5), n=40, take_over_s=0.4, hand_back_s=0.3,
                         kp_nm_per_rad={"{side}_elbow_joint": 70})  # fmt: skip
    assert all(c["sound"] and c["machine"] == 5 and c["dq"] == 0.0 for c in told)
    assert all(c["on"] == list(range(12, 29)) for c in told)  # the legs are the maker's
    weight = np.array([c["weight"] for c in told])
    assert weight[0] < 0.2 and weight.max() == 1.0 and weight[-1] == pytest.approx(0.0)
    q = np.array([c["q"] for c in told])
    elbow = G1.joint_index("left_elbow_joint")
    assert q[0, elbow] == pytest.approx(0.5, abs=0.02)
    assert (np.diff(q[:, elbow]) > -1e-6).all()
    assert q[-1, :29] == pytest.approx(np.r_[np.zeros(12), STANDING[12:]], abs=1e-6)
    gains = np.where(np.arange(29) >= 12, GAINS[:, 0], 0.0)
    gains[[elbow, G1.joint_index("right_elbow_joint")]] = 70.0
    assert told[-1]["kp"][:29] == pytest.approx(gains)
    assert ended["unitree"]["sent"] == 40 and ended["unitree"]["published"] >= len(told)


def test_every_motor_when_asked_for() -> None:
    told, ended = played(near_standing(), n=15, mode="lowcmd")
    assert all(c["sound"] and c["on"] == list(range(29)) and c["weight"] == 0.0 for c in told)
    assert told[-1]["q"][:29] == pytest.approx(STANDING, abs=1e-6)
    assert (told[-1]["kp"][:29], told[-1]["kd"][:29]) == (GAINS[:, 0].tolist(), GAINS[:, 1].tolist())
    assert ended["unitree"]["sent"] == 15


def test_a_silent_robot_is_not_moved() -> None:
    told, ended = played({"mute": True}, timeout_s=0.3)
    assert told == []
    assert ended["error"] == (
        "no G1 told its state on interface 'lo' in 0.3 s; is the robot switched on, and is this its network? "
        "Set the option `interface`"
    )


def test_a_posture_that_cannot_be_is_not_blended_from() -> None:
    told, ended = played(near_standing(left_knee_joint=-1.0))
    assert told == [] and ended["error"].startswith(
        "the robot tells that left_knee_joint is at -1.00 rad, outside"
    )


def test_an_interface_that_is_not_there() -> None:
    told, ended = played({}, interface="none0")
    assert told == [] and ended["error"].startswith("the network interface 'none0' cannot be used; option")


def test_unarmed_no_robot_is_needed(tmp_path: Path) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(Unitree, run)
    written(sink, run, [G1.standing] * 3)
    assert sink.finish().figures["unitree"]["published"] == 0
    sink.close()


def test_wrong_options_and_robots(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match=r"'<x/>' is no name of a network interface, such as eth0"):
        UnitreeConfig(interface="<x/>")
    with pytest.raises(
        UnknownJoint, match=r"^kd_nm_s_per_rad: robot 'unitree_g1' has no link or joint 'knee'"
    ):
        opened(Unitree, run_of(tmp_path, G1), kd_nm_s_per_rad={"knee": 1.0})
    with pytest.raises(SinkError, match=r"^the Unitree G1 moves 29 joints, and robot 'romeo' lacks"):
        opened(Unitree, run_of(tmp_path, "romeo"))
