"""Robots of any kind: commands as JSON in datagrams, easy to receive in any language."""

from __future__ import annotations

import ipaddress
import logging
import socket
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pydantic import Field, field_validator

from imitor import hookimpl
from imitor.commands.command import Command
from imitor.commands.joints import renamed
from imitor.commands.robot_sink import BlindConfig, BlindRobotSink, Hiccup
from imitor.commands.udp_json import Encoder
from imitor.errors import SinkError

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

log = logging.getLogger("imitor")


class UdpJsonConfig(BlindConfig):
    """Where to send, and what the joints are called there."""

    host: str = Field("127.0.0.1", description="Address of the receiver; 127.0.0.1 is this machine [-].")
    port: int = Field(9860, ge=1, le=65535, description="Port of the receiver [-].")
    names_every_s: float = Field(
        1.0, gt=0, le=60, description="How often the joint names are sent again [s]."
    )
    joints: Mapping[str, str] = Field(
        {}, description="Joint or template -> its name at the receiver, where it has another [-]."
    )

    @field_validator("host")
    @classmethod
    def _address(cls, host: str) -> str:
        try:
            ipaddress.ip_address(host)
        except ValueError:
            raise ValueError(f"'{host}' is no IP address, such as 127.0.0.1") from None
        return host


class UdpJson(BlindRobotSink[UdpJsonConfig]):
    """Sends joint positions, base pose, contact and status as JSON datagrams (UDP)."""

    name = "udp_json"

    _socket: socket.socket | None = None

    def prepare(self, robot: RobotModel) -> None:
        """Name the joints and make sure that they fit into a datagram.

        Raises:
            SinkError: They do not.
        """
        try:
            self._encoder = Encoder(robot.name, renamed(robot, self.config.joints), 1.0 / self.run.rate_hz)
        except ValueError as error:
            raise SinkError(str(error)) from None
        self._names_at_s = -self.config.names_every_s
        self._unheard = 0

    def connect(self) -> None:
        """Open the socket.

        Raises:
            SinkError: There is no way to the receiver.
        """
        c = self.config
        family = socket.AF_INET6 if ":" in c.host else socket.AF_INET
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.connect((c.host, c.port))
        except OSError as error:
            sock.close()
            raise SinkError(
                f"there is no way to {c.host}:{c.port}: {error.strerror}; is the network up?"
            ) from None
        sock.setblocking(False)
        self._socket = sock

    def send(self, command: Command) -> None:
        """Send one datagram, and the joint names when they are due."""
        now = time.monotonic()
        datagrams = [self._encoder.command(command, now)]
        if now - self._names_at_s >= self.config.names_every_s or command.index == 0:
            self._names_at_s = now
            datagrams = [*self._encoder.names(), *datagrams]
        for datagram in datagrams:
            self._put(datagram)

    def _put(self, datagram: bytes) -> None:
        if self._socket is None:
            raise Hiccup("the socket is closed")
        try:
            self._socket.send(datagram)
        except ConnectionRefusedError:  # told of an earlier datagram; a receiver may come at any time
            self._unheard += 1
            if self._unheard == 1:
                log.warning("udp_json: nobody listens at %s:%d yet", self.config.host, self.config.port)
        except OSError as error:
            raise Hiccup(error.strerror or str(error)) from None

    def figures(self) -> dict[str, Any]:
        """Return how many datagrams found nobody."""
        return {"unheard": self._unheard}

    def close(self) -> None:
        """Close the socket; safe to call again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


@hookimpl
def imitor_components() -> list[type[UdpJson]]:
    """Register the sink."""
    return [UdpJson]
