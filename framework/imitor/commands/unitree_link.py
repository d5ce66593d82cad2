"""A thread that keeps telling Unitree's motors what to do, faster than commands are made, and hears where they are."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from imitor.commands import unitree_hg as hg
from imitor.errors import SinkError
from imitor.types import Array

STATE: Final = "rt/lowstate"
LOWCMD: Final = "rt/lowcmd"
ARM_SDK: Final = "rt/arm_sdk"
WEIGHT: Final = 29
"""In `ARM_SDK` the position of this motor is the share that the commands get of waist and arms [-]."""
_LISTEN_S: Final = 0.05
_LOOPBACK: Final = (
    "<General><Interfaces><NetworkInterface name='{}' multicast='false'/></Interfaces></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery>"
)
_NETWORK: Final = "<General><Interfaces><NetworkInterface name='{}'/></Interfaces></General>"


class Link:
    """A DDS participant with a writer of commands and a reader of the robot's state.

    Args:
        interface: Name of the network interface, e.g. ``eth0``; ``lo`` stays on this machine. Not looked at where
            the environment's ``CYCLONEDDS_URI`` says more.
        domain: Number of the DDS domain.
        topic: `LOWCMD` or `ARM_SDK`.
        publish_hz: Messages a second [Hz].
        period_s: Time between commands, over which positions go evenly from one to the next [s].

    Raises:
        SinkError: The network interface cannot be used.
    """

    def __init__(self, interface: str, domain: int, topic: str, publish_hz: float, period_s: float) -> None:
        from cyclonedds.core import DDSException, Policy, Qos
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        newest = Qos(Policy.History.KeepLast(1))
        try:
            self._domain = None
            if "CYCLONEDDS_URI" not in os.environ:
                self._domain = Domain(domain, _configuration(interface))
            self._participant = DomainParticipant(domain)
            self._writer = DataWriter(self._participant, Topic(self._participant, topic, hg.LowCmd_), newest)
            self._reader = DataReader(
                self._participant, Topic(self._participant, STATE, hg.LowState_), newest
            )
        except DDSException as error:
            raise SinkError(_why(error, interface, domain)) from None
        self._period_s, self._publish_s = period_s, 1.0 / publish_hz
        self._lock = threading.Lock()
        self._command = hg.new_command()
        self._motors: Sequence[int] = ()
        self._from: Array = np.zeros(0)
        self._to: Array = np.zeros(0)
        self._since_s = 0.0
        self._weight = self._weight_to = self._weight_step = 0.0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="imitor-unitree", daemon=True)
        self.error: Exception | None = None
        self.heard_s = -np.inf
        self.published = 0

    def listen(self, timeout_s: float = 0.0) -> Any:
        """Return the robot's newest state, or ``None`` when it tells nothing within a time [s]."""
        end = time.perf_counter() + timeout_s
        while True:
            for state in self._reader.take(1):
                self.heard_s = time.perf_counter()
                return state
            if time.perf_counter() >= end:
                return None
            time.sleep(0.01)

    @property
    def running(self) -> bool:
        """Whether messages are published."""
        return self._thread.is_alive()

    def start(self, motors: Sequence[int], present: Array, kp: Array, kd: Array, mode_machine: int) -> None:
        """Begin to publish, with the present posture.

        Args:
            motors: Which motors are moved.
            present: Where they are, shape (len(motors),) [rad].
            kp: Stiffness, likewise [N m/rad].
            kd: Damping, likewise [N m s/rad].
            mode_machine: As the robot tells.
        """
        self._motors = list(motors)
        self._from, self._to = present.copy(), present.copy()
        self._command.mode_machine = mode_machine
        for motor, p, d in zip(self._motors, kp.tolist(), kd.tolist(), strict=True):
            m = self._command.motor_cmd[motor]
            m.mode, m.kp, m.kd = 1, p, d
        self._thread.start()

    def tell(self, joints: Array) -> None:
        """Set where the motors are to be one period from now, shape (len(motors),) [rad]."""
        with self._lock:
            now = time.perf_counter()
            self._from, self._to, self._since_s = self._at(now), joints, now

    def ramp(self, weight: float, seconds: float) -> None:
        """Let the share that the commands get go evenly to a value [-] within a time [s]."""
        with self._lock:
            self._weight_to = weight
            steps = max(1.0, seconds / self._publish_s)
            self._weight_step = abs(weight - self._weight) / steps

    @property
    def weight(self) -> float:
        """The share that the commands get now [-]."""
        return self._weight

    def _at(self, now: float) -> Array:
        share = min(1.0, (now - self._since_s) / self._period_s)
        return self._from + share * (self._to - self._from)

    def _run(self) -> None:
        due = time.perf_counter()
        try:
            while not self._ending.wait(max(0.0, due - time.perf_counter())):
                now = time.perf_counter()
                due = max(due + self._publish_s, now)
                if now - self.heard_s > _LISTEN_S:
                    self.listen()
                self._publish(now)
        except Exception as error:  # told by whoever commands next
            self.error = error

    def _publish(self, now: float) -> None:
        command = self._command
        with self._lock:
            joints = self._at(now)
            step = self._weight_step
            self._weight += min(step, max(-step, self._weight_to - self._weight))
            command.motor_cmd[WEIGHT].q = self._weight
        for motor, value in zip(self._motors, joints.tolist(), strict=True):
            command.motor_cmd[motor].q = value
        command.crc = hg.checksum(command)
        self._writer.write(command)
        self.published += 1

    def close(self) -> None:
        """Stop publishing."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        self._reader = self._writer = self._participant = self._domain = None


def _why(error: Any, interface: str, domain: int) -> str:
    if error.code == error.DDS_RETCODE_PRECONDITION_NOT_MET:
        return f"DDS domain {domain} is in use in this process; one sink 'unitree' a run is enough"
    return (
        f"the network interface '{interface}' cannot be used; option `interface` takes its name, such as eth0 "
        "(ip link lists them)"
    )


def _configuration(interface: str) -> str:
    inside = (_LOOPBACK if interface == "lo" else _NETWORK).format(interface)
    return f"<CycloneDDS><Domain>{inside}</Domain></CycloneDDS>"


__all__ = ["ARM_SDK", "LOWCMD", "STATE", "WEIGHT", "Link"]
