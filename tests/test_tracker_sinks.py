"""The sinks ``udp_json``, ``zmq`` and ``redis``, each with a receiver at the other end of a real socket."""

from __future__ import annotations

import contextlib
import json
import logging
import signal
import socket
import struct
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.commands.command import Command
from imitor.commands.g1 import BREADTH_FIRST, DEPTH_FIRST
from imitor.commands.twist2 import roll_pitch
from imitor.commands.udp_json import LARGEST, Encoder, Received, decode, names_hash
from imitor.errors import SinkError
from imitor.plugins.robots.sonic_zmq import SonicZmq
from imitor.plugins.robots.twist2_redis import Twist2Redis
from imitor.plugins.robots.udp_json import UdpJson, UdpJsonConfig
from imitor.testing import make_robot
from live_tools import heeds_interrupts
from sink_peers import RATE_HZ, moved, opened, records, run_of, written

G1 = make_robot()


def walking(n: int = 3) -> list[Any]:
    """Return configurations of a G1 that walks at 0.5 m/s, turning at 0.2 rad/s, and bends its left elbow."""
    out = []
    for i in range(n):
        q = moved(G1, left_elbow_joint=0.6 + 0.01 * i)
        yaw = 0.2 * i / RATE_HZ
        q[0] = 0.5 * i / RATE_HZ
        q[3:7] = 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)
        out.append(q)
    return out


# ---------------------------------------------------------------- joint orders


def test_orders_of_the_g1_are_permutations_of_its_joints() -> None:
    assert list(DEPTH_FIRST) == list(G1.joint_names)
    assert sorted(BREADTH_FIRST) == sorted(DEPTH_FIRST)
    # by hand, from the tree: hips and waist, then their children
    assert BREADTH_FIRST[:6] == (
        "left_hip_pitch_joint", "right_hip_pitch_joint", "waist_yaw_joint", "left_hip_roll_joint",
        "right_hip_roll_joint", "waist_roll_joint",
    )  # fmt: skip
    assert BREADTH_FIRST[-2:] == ("left_wrist_yaw_joint", "right_wrist_yaw_joint")


def test_breadth_first_is_the_order_of_the_tree() -> None:
    """Levels of the model's own tree; within a level in the order of the parents."""
    model, level, order = G1.model, [1], []
    while level:
        level = [j for parent in level for j in range(2, model.njoints) if model.parents[j] == parent]
        order += [model.names[j] for j in level]
    assert tuple(order) == BREADTH_FIRST


# ---------------------------------------------------------------- JSON


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(5.0)
        yield sock


def test_datagrams_carry_the_commands(tmp_path: Path, listener: socket.socket) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(UdpJson, run, armed=True, port=listener.getsockname()[1], joints={"{side}_knee_joint": "{S}Knee"},
                  start_posture={"left_elbow_joint": 0.6})  # fmt: skip
    configurations = walking()
    for record in records(run, configurations):
        record.state.contact[:], record.state.status = (True, False), 2
        sink.write(record)
    report = sink.finish().figures["udp_json"]
    sink.close()
    names = json.loads(listener.recv(2048))
    assert (names["schema"], names["version"], names["robot"]) == ("imitor-joints", 1, "unitree_g1")
    assert (names["count"], names["first"]) == (29, 0)
    assert names["names"][3:5] == ["LKnee", "left_ankle_pitch_joint"]
    datagrams = [listener.recv(2048) for _ in range(4)]
    assert max(map(len, datagrams)) < LARGEST
    commands = [decode(d) for d in datagrams]
    for i, (command, q) in enumerate(zip(commands, configurations, strict=False)):
        assert (command.seq, command.period_s, command.status) == (i, 0.02, "stopped")
        assert command.hash == names["hash"] == names_hash(names["names"])
        assert command.position == pytest.approx(q[7:], abs=1e-5)
        assert command.base_position == pytest.approx(q[:3], abs=1e-5)
        assert command.base_quaternion == pytest.approx(q[[6, 3, 4, 5]], abs=1e-5)
        assert command.contact == [True, False]
    assert [c.t_s for c in commands] == sorted(c.t_s for c in commands)
    assert commands[3].seq == 3 and commands[3].position == commands[2].position  # the end, at rest
    assert (report["commands"], report["sent"], report["unheard"]) == (3, 3, 0)


def test_ctrl_c_leaves_the_robot_where_it_is(tmp_path: Path, listener: socket.socket) -> None:
    listener.settimeout(60.0)
    command = (
        f"run retarget --sink udp_json --set udp_json.port={listener.getsockname()[1]} --arm --quiet --out"
    )
    commands: list[Received] = []

    def hear() -> None:
        if b"imitor-joints" not in (datagram := listener.recv(2048)):
            commands.append(decode(datagram))

    with subprocess.Popen(heeds_interrupts(*command.split(), str(tmp_path))) as running:
        while [c.status for c in commands].count("ok") < 3:  # on the way to the first command it is held
            hear()
        running.send_signal(signal.SIGINT)
        assert running.wait(60.0) == 130
    listener.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        while True:
            hear()
    assert [c.seq for c in commands] == sorted({c.seq for c in commands})
    step = np.abs(np.subtract(commands[-1].position, commands[-2].position)).max()
    assert step < 0.02  # the same again; one more step if it came between thinking and sending
    assert json.loads((tmp_path / "metrics.json").read_text())["status"] == "interrupted"


def test_unarmed_no_datagram_leaves(tmp_path: Path, listener: socket.socket) -> None:
    run = run_of(tmp_path, G1)
    sink = opened(UdpJson, run, port=listener.getsockname()[1])
    written(sink, run, walking())
    sink.finish()
    sink.close()
    listener.settimeout(0.05)
    with pytest.raises(TimeoutError):
        listener.recv(2048)


def test_nobody_needs_to_listen(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    run = run_of(tmp_path, G1)
    sink = opened(UdpJson, run, armed=True, port=port)
    written(sink, run, walking(10))
    sink.close()
    assert [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING] == [
        f"udp_json: nobody listens at 127.0.0.1:{port} yet"
    ]
    assert sink.finish().figures["udp_json"]["unheard"] > 0


def test_a_host_is_an_address() -> None:
    with pytest.raises(ValueError, match=r"'robot.local' is no IP address, such as 127.0.0.1"):
        UdpJsonConfig(host="robot.local")


def test_many_joints_take_several_datagrams_of_names_and_too_many_are_refused() -> None:
    names = [f"a_joint_with_a_rather_long_name_{i:02}" for i in range(60)]
    encoder = Encoder("robot", names, 0.02)
    parts = [json.loads(d) for d in encoder.names()]
    assert [n for p in parts for n in p["names"]] == names
    assert [p["first"] for p in parts] == np.cumsum([0, *(len(p["names"]) for p in parts)])[:-1].tolist()
    assert len(parts) == 2 and all(len(d) <= LARGEST for d in encoder.names())
    with pytest.raises(ValueError, match=r"^200 joints make datagrams of \d+ bytes; 1400 is the most$"):
        Encoder("robot", [str(i) for i in range(200)], 0.02)


def test_the_largest_command_of_every_robot_fits() -> None:
    for name in ("unitree_g1", "talos", "romeo", "nao_v4", "hrp2"):
        robot = make_robot(name)
        command = Command.of(robot)
        command.index, command.q[:3], command.joints[:] = 2**40, -9999.123456, -3.141592
        datagram = Encoder(name, robot.joint_names, 1 / 3).command(command, 123456789.123456)
        assert len(datagram) <= LARGEST and len(decode(datagram).position) == robot.n


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": "other"}, "no 'imitor-command' of version 1"),
        ({"version": 2}, "no 'imitor-command' of version 1"),
        ({"position": [1.0, "x"]}, "position is no list of numbers"),
        ({"position": [1.0, 1e999]}, "position is no list of numbers"),
        ({"contact": [1]}, "contact is no list of 2 numbers"),
        ({"base": None}, "no base"),
        ({"seq": True}, "status or seq is wrong"),
        ({"status": "fine"}, "status or seq is wrong"),
        ({"t": None}, "t is no list of 1 numbers"),
        ({"extra": "x" * 2000}, r"\d+ bytes are more than 1400"),
    ],
)
def test_damaged_commands_are_refused(change: dict[str, Any], said: str) -> None:
    sound = Encoder("nao", ["a", "b"], 0.02).command(Command.of(G1), 1.0)
    assert decode(sound).status == "ok"
    with pytest.raises(ValueError, match=said):
        decode(json.dumps(json.loads(sound) | change).encode())


@pytest.mark.parametrize("junk", [b"", b"\xff\xfe", b"[1]", b"{", b"[" * 1399])
def test_what_is_no_json_is_refused(junk: bytes) -> None:
    with pytest.raises(ValueError):
        decode(junk)


# ---------------------------------------------------------------- SONIC


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read a message with nothing of ours, as its format is described: header and arrays."""
    assert message[:4] == b"pose"
    header = json.loads(message[4 : 4 + 1280].split(b"\0", 1)[0])
    words = {"f32": "f", "f64": "d", "i32": "i", "i64": "q"}
    at, out = 4 + 1280, {}
    for field in header["fields"]:
        n = int(np.prod(field["shape"]))
        layout = f"<{n}{words[field['dtype']]}"
        out[field["name"]] = np.array(struct.unpack_from(layout, message, at)).reshape(field["shape"])
        at += struct.calcsize(layout)
    assert at == len(message)
    return header, out


def test_poses_for_sonic(tmp_path: Path) -> None:
    zmq: Any = pytest.importorskip("zmq")
    run = run_of(tmp_path, G1)
    sink = opened(SonicZmq, run, armed=True, port=0)
    with zmq.Context() as context, context.socket(zmq.SUB) as tracker:
        tracker.setsockopt(zmq.RCVTIMEO, 5000)
        tracker.setsockopt(zmq.SUBSCRIBE, b"pose")
        tracker.connect(sink.address)
        configurations = walking(400)
        configurations[0][3:7] *= -1.0  # the same rotation
        got = []
        for record in records(
            run, configurations
        ):  # a subscriber misses what is published before it is known
            sink.write(record)
            if tracker.poll(20):
                got.append(unpack(tracker.recv()))
            if len(got) == 5:
                break
        sink.finish()
        last = unpack(tracker.recv())
    sink.close()
    header, first = got[0]
    assert {k: header[k] for k in ("v", "endian", "count")} == {"v": 1, "endian": "le", "count": 1}
    assert {f["name"]: f["shape"] for f in header["fields"]} == {
        "body_quat": [1, 4], "frame_index": [1], "joint_pos": [1, 29], "joint_vel": [1, 29],
    }  # fmt: skip
    elbow = BREADTH_FIRST.index("left_elbow_joint")
    for _, fields in got:
        i = int(fields["frame_index"][0])
        expected = dict(zip(G1.joint_names, configurations[i][7:], strict=True))
        assert fields["joint_pos"][0] == pytest.approx([expected[n] for n in BREADTH_FIRST], abs=1e-6)
        assert np.delete(fields["joint_vel"][0], elbow) == pytest.approx(0.0)
        assert fields["body_quat"][0] == pytest.approx(np.abs(configurations[i][[6, 3, 4, 5]]), abs=1e-6)
        assert i == 0 or fields["joint_vel"][0, elbow] == pytest.approx(0.5)
    index = [int(f["frame_index"][0]) for _, f in got]
    assert index == list(range(index[0], index[0] + 5)) and int(last[1]["frame_index"][0]) == index[-1] + 1
    assert (last[1]["joint_vel"] == 0.0).all()
    assert int(first["frame_index"][0]) == index[0]


def test_sonic_wants_its_rate_and_its_robot(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pytest.importorskip("zmq")
    slow = run_of(tmp_path, G1, rate_hz=30.0)
    told = "SONIC plays 50 poses a second, and 30 are made; set rate_hz: 50"
    with pytest.raises(SinkError, match=f"^{told}$"):
        opened(SonicZmq, slow, armed=True, port=0)
    opened(SonicZmq, slow)
    assert [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING] == [f"zmq: {told}"]
    with pytest.raises(
        SinkError, match=r"^SONIC moves 29 joints, and robot 'nao_v4' lacks left_hip_pitch_joint"
    ):
        opened(SonicZmq, run_of(tmp_path, "nao_v4"))


def test_a_taken_port_is_told(tmp_path: Path) -> None:
    pytest.importorskip("zmq")
    run = run_of(tmp_path, G1)
    first = opened(SonicZmq, run, armed=True, port=0)
    port = int(first.address.rsplit(":", 1)[1])
    with pytest.raises(SinkError, match=rf"^cannot publish at tcp://127.0.0.1:{port}: .*is the port taken"):
        opened(SonicZmq, run, armed=True, port=port)
    first.close()


# ---------------------------------------------------------------- TWIST2


@pytest.fixture
def store() -> Iterator[Any]:
    """A Redis server of another make, in a thread."""
    fakeredis: Any = pytest.importorskip("fakeredis")
    pytest.importorskip("redis")
    server = fakeredis.TcpFakeServer(("127.0.0.1", 0), server_type="redis")
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join(5.0)


def test_poses_for_twist2(tmp_path: Path, store: Any) -> None:
    import redis

    port = store.server_address[1]
    run = run_of(tmp_path, G1)
    sink = opened(Twist2Redis, run, armed=True, port=port, timeout_s=5.0)
    reader: Any = redis.Redis(port=port)
    bodies, times = [], []
    for record in records(run, walking(4)):
        sink.write(record)
        bodies.append(json.loads(reader.get("action_body_unitree_g1_with_hands")))
        times.append(int(reader.get("t_action")))
    sink.finish()
    last = json.loads(reader.get("action_body_unitree_g1_with_hands"))
    hands = [json.loads(reader.get(f"action_hand_{s}_unitree_g1_with_hands")) for s in ("left", "right")]
    neck = json.loads(reader.get("action_neck_unitree_g1_with_hands"))
    reader.close()
    sink.close()
    assert (hands, neck) == ([[0.0] * 7] * 2, [0.0] * 2)
    for body, q in zip(bodies, walking(4), strict=True):
        assert len(body) == 35
        assert body[2:5] == pytest.approx([q[2], 0.0, 0.0])
        assert body[6:] == pytest.approx(q[7:], abs=1e-9)  # limb after limb is the G1's own order
    for body in bodies[1:]:
        assert body[:2] == pytest.approx([0.5, 0.0], abs=0.01) and body[5] == pytest.approx(0.2)
    assert [last[0], last[1], last[5]] == [0.0] * 3 and last[6:] == bodies[-1][6:]  # it does not walk on
    assert times == sorted(times) and times[0] > 1.7e12


def test_hands_are_left_to_others(tmp_path: Path, store: Any) -> None:
    import redis

    run = run_of(tmp_path, G1)
    port = store.server_address[1]
    sink = opened(Twist2Redis, run, armed=True, port=port, timeout_s=5.0, hands_and_neck=False)
    written(sink, run, walking(1))
    reader: Any = redis.Redis(port=port)
    assert sorted(reader.keys()) == [b"action_body_unitree_g1_with_hands", b"t_action"]
    reader.close()
    sink.close()


def test_no_store_no_robot(tmp_path: Path) -> None:
    pytest.importorskip("redis")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(
        SinkError, match=rf"^no Redis store answers at 127.0.0.1:{port}: .*set `host` and `port`$"
    ):
        opened(Twist2Redis, run_of(tmp_path, G1), armed=True, port=port)
    with pytest.raises(
        SinkError, match=r"^TWIST2 moves 29 joints, and robot 'talos' lacks left_hip_pitch_joint"
    ):
        opened(Twist2Redis, run_of(tmp_path, "talos"))


def test_roll_and_pitch_are_those_of_the_rotation_matrix() -> None:
    import pinocchio as pin

    for rpy in np.random.default_rng(3).uniform(-1.4, 1.4, (20, 3)):
        q = pin.Quaternion(pin.rpy.rpyToMatrix(rpy)).coeffs()
        assert roll_pitch(q) == pytest.approx(rpy[:2])
