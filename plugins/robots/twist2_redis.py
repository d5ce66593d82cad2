"""A Unitree G1 whose legs are kept by the public tracker TWIST2: poses in a Redis store."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from pydantic import Field

from imitor import hookimpl
from imitor.commands.command import Command
from imitor.commands.g1 import DEPTH_FIRST
from imitor.commands.joints import places
from imitor.commands.robot_sink import BlindConfig, BlindRobotSink, Hiccup
from imitor.commands.twist2 import BODY, HANDS, N_HAND, N_NECK, NECK, TIME, mimic
from imitor.errors import SinkError

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


class Twist2RedisConfig(BlindConfig):
    """Where the store is, and what is written beside the body."""

    host: str = Field("127.0.0.1", description="Name or address of the store's machine [-].")
    port: int = Field(6379, ge=1, le=65535, description="Port of the store [-].")
    db: int = Field(0, ge=0, le=15, description="Number of the store's database [-].")
    timeout_s: float = Field(0.05, gt=0, le=5, description="How long one command may wait for the store [s].")
    hands_and_neck: bool = Field(
        True,
        description="Whether zeros (open, straight) are written for hands and neck, which the tracker reads; off where "
        "another program moves them [-].",
    )


class Twist2Redis(BlindRobotSink[Twist2RedisConfig]):
    """Writes poses for the tracker TWIST2 of the Unitree G1 (Redis)."""

    name = "redis"
    extra = "trackers"
    module = "redis"

    _store: Any = None

    def prepare(self, robot: RobotModel) -> None:
        """Look the joints up.

        Raises:
            SinkError: The robot is no G1 with 29 joints.
        """
        self._order = places(robot, DEPTH_FIRST, "TWIST2")
        zeros = {**dict.fromkeys(HANDS, [0.0] * N_HAND), NECK: [0.0] * N_NECK}
        self._beside = {k: json.dumps(v) for k, v in zeros.items()} if self.config.hands_and_neck else {}

    def connect(self) -> None:
        """Reach the store.

        Raises:
            SinkError: It does not answer.
        """
        redis, c = self.package(), self.config
        once = redis.retry.Retry(redis.backoff.NoBackoff(), 0)
        self._store = redis.Redis(
            host=c.host, port=c.port, db=c.db, retry=once,
            socket_timeout=c.timeout_s, socket_connect_timeout=max(c.timeout_s, 0.5),
        )  # fmt: skip
        try:
            self._store.ping()
        except redis.RedisError as error:
            why = str(error).rstrip(".")
            raise SinkError(
                f"no Redis store answers at {c.host}:{c.port}: {why}; start one, or set `host` and `port`"
            ) from None

    def send(self, command: Command) -> None:
        """Write one pose, its time and what is beside it, all at once."""
        redis = self.package()
        values = {
            BODY: json.dumps(mimic(command.q, command.v, self._order)),
            TIME: int(time.time() * 1000),
        }
        try:
            self._store.mset(values | self._beside)
        except redis.RedisError as error:
            raise Hiccup(str(error)) from None

    def close(self) -> None:
        """Leave the store; safe to call again."""
        if self._store is not None:
            self._store.close()
            self._store = None


@hookimpl
def imitor_components() -> list[type[Twist2Redis]]:
    """Register the sink."""
    return [Twist2Redis]
