"""A Unitree G1 whose legs are kept by the public tracker SONIC: poses on a ZeroMQ socket."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Final

from pydantic import Field

from imitor import hookimpl
from imitor.commands.command import Command
from imitor.commands.g1 import BREADTH_FIRST
from imitor.commands.joints import places
from imitor.commands.robot_sink import BlindConfig, BlindRobotSink, Hiccup
from imitor.commands.sonic import RATE_HZ, pose
from imitor.errors import SinkError

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

log = logging.getLogger("imitor")
_WAITING: Final = 50
"""Messages that wait for a slow receiver, a second of them; further ones are dropped."""


class SonicZmqConfig(BlindConfig):
    """Where the tracker subscribes."""

    host: str = Field(
        "127.0.0.1",
        description="Address of the interface to publish at; 127.0.0.1 serves this machine alone, * everybody [-].",
    )
    port: int = Field(
        5556, ge=0, le=65535, description="Port that the tracker subscribes to; 0 takes a free one [-]."
    )


class SonicZmq(BlindRobotSink[SonicZmqConfig]):
    """Publishes poses for the tracker SONIC of the Unitree G1 (ZeroMQ)."""

    name = "zmq"
    extra = "trackers"
    module = "zmq"

    _socket: Any = None
    _context: Any = None

    def prepare(self, robot: RobotModel) -> None:
        """Look the joints up, and compare the rate.

        Raises:
            SinkError: The robot is no G1 with 29 joints; or it shall move, and the rate is not the tracker's.
        """
        self._order = places(robot, BREADTH_FIRST, "SONIC")
        self._turn = self.command.q[[6, 3, 4, 5]]
        rate = self.run.rate_hz
        if abs(rate - RATE_HZ) > 0.01 * RATE_HZ:
            told = f"SONIC plays {RATE_HZ:g} poses a second, and {rate:g} are made; set rate_hz: {RATE_HZ:g}"
            if self.armed:
                raise SinkError(told)
            log.warning("zmq: %s", told)

    def connect(self) -> None:
        """Publish at the address.

        Raises:
            SinkError: The address is taken or no address of this machine.
        """
        zmq = self.package()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.setsockopt(zmq.LINGER, 200)
        self._socket.setsockopt(zmq.SNDHWM, _WAITING)
        address = f"tcp://{self.config.host}:{self.config.port}"
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            raise SinkError(
                f"cannot publish at {address}: {error}; is the port taken, or the address another's?"
            ) from None
        self.address = str(self._socket.getsockopt_string(zmq.LAST_ENDPOINT))

    def send(self, command: Command) -> None:
        """Publish one pose."""
        zmq = self.package()
        turn = command.q[[6, 3, 4, 5]]
        if turn.dot(self._turn) < 0.0:  # the same rotation, written so that it does not jump
            turn = -turn
        self._turn = turn
        message = pose(command.index, turn, command.joints[self._order], command.joint_speeds[self._order])
        try:
            self._socket.send(message, zmq.NOBLOCK)
        except zmq.ZMQError as error:
            raise Hiccup(str(error)) from None

    def close(self) -> None:
        """Close the socket; safe to call again."""
        if self._socket is not None:
            self._socket.close()
            self._context.term()
            self._socket = self._context = None


@hookimpl
def imitor_components() -> list[type[SonicZmq]]:
    """Register the sink."""
    return [SonicZmq]
