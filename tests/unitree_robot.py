"""A G1 in a process of its own, on DDS over the loopback: ``python unitree_robot.py DOMAIN TOPIC OPTIONS``.

Tells its state; when its standard input ends, it prints every command as JSON, one a line. Options as JSON: q
(motor -> position), mute.
"""

from __future__ import annotations

import json
import os
import struct
import sys
import threading
import time
from typing import Any

os.environ["CYCLONEDDS_URI"] = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery>"
    "</Domain></CycloneDDS>"
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from imitor.commands.unitree_hg import IMUState_, LowCmd_, LowState_, MotorState_


def bitwise_crc(command: LowCmd_) -> int:
    """The checksum, bit by bit and word by word."""
    motors: list[Any] = []
    for m in command.motor_cmd:
        motors += [m.mode, m.q, m.dq, m.tau, m.kp, m.kd, m.reserve]
    packed = struct.pack(
        "<2B2x" + 35 * "B3x5fI" + "4I", command.mode_pr, command.mode_machine, *motors, *command.reserve
    )
    crc = 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", packed):
        for bit in range(31, -1, -1):
            top = crc >> 31
            crc = crc << 1 & 0xFFFFFFFF
            crc ^= 0x04C11DB7 * (top ^ (word >> bit & 1))
    return crc


def main() -> None:
    domain, topic, options = int(sys.argv[1]), sys.argv[2], json.loads(sys.argv[3])
    ending, told = threading.Event(), []

    def wait() -> None:
        sys.stdin.read()
        ending.set()

    threading.Thread(target=wait, daemon=True).start()
    participant = DomainParticipant(domain)
    reader = DataReader(participant, Topic(participant, topic, LowCmd_))
    writer = DataWriter(participant, Topic(participant, "rt/lowstate", LowState_))
    q = {int(k): v for k, v in options.get("q", {}).items()}
    motors = [
        MotorState_(1, q.get(i, 0.0), 0.0, 0.0, 0.0, [30, 30], 48.0, [0, 0], 0, [0] * 4) for i in range(35)
    ]
    imu = IMUState_([1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, [0.0] * 3, 30)
    state = LowState_([1, 0], 0, 5, 0, imu, motors, [0] * 40, [0] * 4, 0)
    print(json.dumps("ready"), flush=True)
    while not ending.is_set():
        if not options.get("mute"):
            state.tick += 1
            writer.write(state)
        told += [c for c in reader.take(10) if isinstance(c, LowCmd_)]  # and none of one who left
        time.sleep(0.005)
    for c in told:
        text = {
            "machine": c.mode_machine, "sound": bitwise_crc(c) == c.crc, "weight": c.motor_cmd[29].q,
            "on": [i for i, m in enumerate(c.motor_cmd) if m.mode == 1],
            "q": [m.q for m in c.motor_cmd], "kp": [m.kp for m in c.motor_cmd],
            "kd": [m.kd for m in c.motor_cmd], "dq": max(abs(m.dq) + abs(m.tau) for m in c.motor_cmd),
        }  # fmt: skip
        print(json.dumps(text))
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
