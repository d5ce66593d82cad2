"""What all sinks that move a robot have in common, with a robot made of Python."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor.commands.approach import Approach
from imitor.commands.command import Command
from imitor.commands.joints import places, renamed
from imitor.commands.pace import Pace
from imitor.commands.robot_sink import BlindConfig, BlindRobotSink, Hiccup, RobotConfig, RobotSink
from imitor.errors import SinkError, UnknownJoint
from imitor.kinds import Sink
from imitor.testing import make_robot
from imitor.types import STATUS, Array
from sink_peers import RATE_HZ, moved, opened, records, run_of, written


class Toy(RobotSink[RobotConfig]):
    """A robot made of Python."""

    name = "toy"
    posture: ClassVar[Mapping[str, float] | None] = None

    def connect(self) -> None:
        self.told: list[Array] = []
        self.speeds: list[Array] = []
        self.states: list[int] = []
        self.deaf = self.closed = False

    def present(self) -> Mapping[str, float] | None:
        return self.posture

    def send(self, command: Command) -> None:
        if self.deaf:
            raise Hiccup("it is deaf")
        self.told.append(command.joints.copy())
        self.speeds.append(command.v.copy())
        self.states.append(command.status)

    def close(self) -> None:
        self.closed = True


class BlindToy(BlindRobotSink[BlindConfig]):
    """A robot that tells nothing."""

    name = "blind_toy"

    def send(self, command: Command) -> None:
        self.first = getattr(self, "first", command.joints.copy())


G1 = make_robot()
KNEE = G1.joint_index("left_knee_joint")


def at(robot: Any = G1, **joints: float) -> dict[str, float]:
    return dict(zip(robot.joint_names, moved(robot, **joints)[7:].tolist(), strict=True))


class Clock:
    """Time that passes by sleeping alone."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def perf_counter(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("imitor.commands.pace.time", clock)
    monkeypatch.setattr("imitor.commands.robot_sink.time", clock)
    return clock


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot's left knee is 0.5 rad from where the standing posture has it."""
    monkeypatch.setattr(Toy, "posture", at(left_knee_joint=float(G1.standing[7 + KNEE]) + 0.5))


def test_files_want_every_frame_and_robots_the_clock() -> None:
    assert (Sink.realtime, RobotSink.realtime) == (False, True)


def test_unarmed_nothing_is_connected_or_sent(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    run = run_of(tmp_path, G1)
    with caplog.at_level(logging.INFO, "imitor"):
        sink = opened(Toy, run)
        written(sink, run, [G1.standing] * 5)
    assert not hasattr(sink, "told")
    assert [r.getMessage() for r in caplog.records] == [
        "toy: dry run, nothing is sent and nothing moves; --arm lets it move"
    ]
    assert sink.finish().figures == {
        "toy": {"armed": False, "commands": 5, "sent": 0, "not_sent": 0, "not_finite": 0, "approach_s": 0.0}
    }


@pytest.mark.parametrize(
    ("posture", "said"),
    [
        (None, "the robot does not tell where its joints are, so it is not moved"),
        ({"left_knee_joint": 0.1}, "does not tell where left_hip_pitch_joint"),
        (at(left_knee_joint=9.0), r"left_knee_joint is at 9.00 rad, outside .* is it a unitree_g1\?"),
        (at(left_knee_joint=float("nan")), r"left_knee_joint is at nan rad"),
    ],
)
def test_a_robot_whose_posture_is_unknown_is_not_moved(
    posture: Any, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Toy, "posture", posture)
    sink = Toy(RobotConfig(armed=True))
    with pytest.raises(SinkError, match=said):
        sink.open(run_of(tmp_path, G1).info)
    assert sink.closed and not sink.told


def test_live_it_blends_from_where_the_robot_is(tmp_path: Path, elsewhere: None) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(Toy, run, armed=True)
    written(sink, run, [G1.standing] * 100)
    knee = np.array(sink.told)[:, KNEE] - G1.standing[7 + KNEE]
    speed = np.abs(np.diff(np.r_[0.5, knee])) * RATE_HZ
    assert speed.max() == pytest.approx(0.5, rel=0.01)  # blend_speed_rad_s, and the whole of it
    assert (np.diff(knee) <= 1e-12).all() and knee[-1] == 0.0
    assert knee[74] == 0.0 and knee[73] > 0.0  # 1.5 times 0.5 rad at 0.5 rad/s
    assert sink.finish().figures["toy"]["approach_s"] == 1.5
    others = np.delete(np.array(sink.told), KNEE, axis=1)
    assert (others == np.delete(G1.standing[7:], KNEE)).all()


def test_live_the_blend_follows_the_person(tmp_path: Path, elsewhere: None) -> None:
    """The commands move meanwhile; what is told arrives at them in time and never jumps."""
    run = run_of(tmp_path, G1)
    sink = opened(Toy, run, armed=True)
    t = np.arange(150) / RATE_HZ
    wanted = G1.standing[7 + KNEE] + 0.3 * np.sin(3.0 * t)
    written(sink, run, [moved(G1, left_knee_joint=float(w)) for w in wanted])
    told = np.array(sink.told)[:, KNEE]
    assert told[75:] == pytest.approx(wanted[75:], abs=1e-12)
    speed = np.abs(np.diff(told)) * RATE_HZ
    assert speed.max() <= 0.9 + 0.5 + 1.5 * 0.3 / 1.5  # of the person, of the way, of the way's growing


def test_a_recording_waits_until_the_robot_is_there(tmp_path: Path, elsewhere: None, clock: Clock) -> None:
    run = run_of(tmp_path, G1, live=False)
    sink = opened(Toy, run, armed=True, blend_speed_rad_s=3.0)
    written(sink, run, [moved(G1, left_elbow_joint=0.1 * i) for i in range(3)])
    told = np.array(sink.told)
    assert len(told) == 15 + 3  # 1.5 * 0.6 rad of the elbow at 3 rad/s are 0.3 s
    assert (told[14] == told[15]).all()
    assert told[15:, KNEE].tolist() == [G1.standing[7 + KNEE]] * 3
    assert clock.now_s == pytest.approx(17 / RATE_HZ)  # at the pace of real time
    assert sink.states == [1] * 15 + [0] * 3


def test_the_way_keeps_the_speed_limits() -> None:
    approach = Approach(np.zeros(2), np.array([0.2, 9.0]), np.full(2, np.inf), 0.1, blend_speed=1.0)
    told = [np.zeros(2), *(approach.step(np.array([0.4, 0.4])) for _ in range(40))]
    assert np.abs(np.diff(told, axis=0)).max(axis=0) == pytest.approx([0.02, 0.02], rel=0.05)
    assert told[-1].tolist() == [0.4, 0.4]
    jump = [approach.step(np.array([-1.0, -1.0])) for _ in range(2)]  # no guard would let this through
    assert np.diff([told[-1], *jump], axis=0).tolist() == pytest.approx(
        np.array([[-0.02, -0.9], [-0.02, -0.5]])
    )


@given(st.floats(-2.0, 2.0), st.floats(0.1, 20.0), st.floats(0.1, 3.0))
def test_the_way_takes_half_of_the_acceleration_limits(far: float, most: float, blend_speed: float) -> None:
    approach = Approach(np.zeros(1), np.array([5.0]), np.array([most]), 0.02, blend_speed)
    told = [0.0, 0.0]
    while not approach.done:
        told.append(float(approach.step(np.array([far]))[0]))
        assert len(told) < 5000
    told += [float(approach.step(np.array([far]))[0])] * 2
    assert told[-1] == pytest.approx(far)
    assert np.abs(np.diff(told, 2)).max() / 0.02**2 <= 0.5 * most * (1.0 + 1e-6)


def test_commands_stay_within_limits_and_finite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Toy, "posture", at())
    run = run_of(tmp_path, G1)
    sink = opened(Toy, run, armed=True)
    beyond = G1.standing.copy()
    beyond[7:] = G1.upper + 1.0
    broken = np.full_like(beyond, np.nan)
    written(sink, run, [beyond] * 500)
    assert np.array(sink.told).max(axis=0) == pytest.approx(G1.upper)
    written(sink, run, [broken] * 2)
    assert (sink.told[-1] == G1.upper).all() and sink.states[-1] == 1
    assert sink.finish().figures["toy"]["not_finite"] == 2


def test_velocities_are_differences_at_the_output_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A base that faces left and walks that way at 0.5 m/s while it turns at 0.2 rad/s."""
    monkeypatch.setattr(Toy, "posture", at())
    run = run_of(tmp_path, G1)
    sink = opened(Toy, run, armed=True)
    qs = []
    for i in range(4):
        q, yaw = G1.standing.copy(), np.pi / 2 + 0.2 * i / RATE_HZ
        q[1] = 0.5 * i / RATE_HZ
        q[3:7] = 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)
        q[7 + KNEE] += 0.3 * i / RATE_HZ
        qs.append(q)
    written(sink, run, qs)
    assert sink.speeds[0] == pytest.approx(0.0)
    for v in sink.speeds[1:]:
        assert v[[0, 1, 2]] == pytest.approx([0.5, 0.0, 0.0], abs=0.01)
        assert v[[3, 4, 5]] == pytest.approx([0.0, 0.0, 0.2], abs=1e-9)
        assert v[6 + KNEE] == pytest.approx(0.3)
    sink.finish()
    assert (sink.speeds[-1] == 0.0).all() and (sink.told[-1] == sink.told[-2]).all()  # left at rest
    sink.finish()
    assert len(sink.told) == 5


def test_a_hiccup_passes_and_a_long_one_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, clock: Clock
) -> None:
    monkeypatch.setattr(Toy, "posture", at())
    run = run_of(tmp_path, G1)
    sink = opened(Toy, run, armed=True, give_up_s=0.05)
    sink.deaf = True
    written(sink, run, [G1.standing] * 3)
    sink.deaf = False
    written(sink, run, [G1.standing])
    assert [r.getMessage() for r in caplog.records] == ["toy: a command did not get through: it is deaf"]
    sink.deaf = True
    written(sink, run, [G1.standing])
    clock.sleep(0.06)
    with pytest.raises(
        SinkError,
        match=r"^for 0.05 s no command has got through: it is deaf; the robot keeps what it was told last$",
    ):
        written(sink, run, [G1.standing])
    assert (sink.finish().figures["toy"]["sent"], sink.finish().figures["toy"]["not_sent"]) == (1, 5)


def test_a_robot_that_tells_nothing_is_taken_to_stand(tmp_path: Path) -> None:
    run = run_of(tmp_path, G1)
    raised = moved(G1, left_elbow_joint=0.1, right_elbow_joint=-0.2)
    sink = opened(BlindToy, run, armed=True, start_posture={"{side}_elbow_joint": (0.1, -0.2)})
    for record in records(run, [raised]):
        sink.write(record)
    assert sink.first == pytest.approx(raised[7:])
    assert sink.finish().figures["blind_toy"]["approach_s"] == 0.0
    with pytest.raises(
        UnknownJoint, match=r"^start_posture: robot 'unitree_g1' has no link or joint 'elbow'"
    ):
        opened(BlindToy, run, armed=True, start_posture={"elbow": 0.1})


def test_a_missing_package_names_the_extra() -> None:
    class Needy(Toy):
        """Need what is not there."""

        module, extra = "no_such_package", "nao"

    with pytest.raises(
        SinkError,
        match=r"^it needs the package no_such_package, which is not installed: pip install 'imitor\[nao\]'$",
    ):
        Needy(RobotConfig()).start()


def test_pace_lets_through_once_a_period_and_makes_up_for_little(clock: Clock) -> None:
    pace, through = Pace(0.02), []
    for busy in (0.0, 0.0, 0.03, 0.0, 0.0, 0.09, 0.0, 0.0):
        clock.sleep(busy)
        pace.wait()
        through.append(round(clock.now_s, 6))
    # late by 10 ms the next is in time again; late by more than a period there is no burst afterwards
    assert through == [0.0, 0.02, 0.05, 0.06, 0.08, 0.17, 0.19, 0.21]


def test_joint_names_of_the_receiver() -> None:
    names = renamed(G1, {"{side}_knee_joint": "{S}Knee", "waist_yaw_joint": "Waist"})
    expected = {"left_knee_joint": "LKnee", "right_knee_joint": "RKnee", "waist_yaw_joint": "Waist"}
    assert names == [expected.get(n, n) for n in G1.joint_names]
    with pytest.raises(UnknownJoint, match=r"^joints: .*no link or joint 'knee'"):
        renamed(G1, {"knee": "K"})
    with pytest.raises(SinkError, match=r"option `joints` gives the name K to two joints"):
        renamed(G1, {"left_knee_joint": "K", "right_knee_joint": "K"})


def test_an_order_fits_one_robot_alone() -> None:
    backwards = list(reversed(G1.joint_names))
    assert places(G1, backwards, "X").tolist() == list(range(28, -1, -1))
    with pytest.raises(
        SinkError,
        match=r"^X moves 29 joints, and robot 'nao_v4' lacks left_wrist_yaw_joint|^X moves 29 joints",
    ):
        places(make_robot("nao_v4"), backwards, "X")
    with pytest.raises(
        SinkError, match=r"^X moves 28 joints, and robot 'unitree_g1' has right_wrist_yaw_joint besides"
    ):
        places(G1, G1.joint_names[:-1], "X")


@pytest.mark.usefixtures("elsewhere")
def test_a_stop_holds_the_robot_on_its_way_to_the_first_command_too(tmp_path: Path) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(Toy, run, armed=True)
    written(sink, run, [G1.standing] * 10)
    stopped_at = sink.told[-1]
    written(sink, run, [G1.standing] * 10, status=STATUS.index("stopped"))
    assert np.array_equal(sink.told, [*sink.told[:10], *[stopped_at] * 10])
    written(sink, run, [G1.standing] * 200)
    knee = np.array(sink.told)[:, KNEE]
    assert np.abs(np.diff(knee)).max() <= 0.5 / RATE_HZ + 1e-9  # and goes on as slowly
    assert sink.told[-1] == pytest.approx(G1.standing[7:])
