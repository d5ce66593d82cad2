"""The base of sinks that move a robot: unarmed or armed, a slow start, hiccups of the network, a calm end."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import logging
import time
from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

import numpy as np
from pydantic import Field

from imitor.commands.approach import Approach
from imitor.commands.command import N_BASE, Command
from imitor.commands.pace import Pace
from imitor.errors import SinkError
from imitor.kinds import Config, Record, RunInfo, Sink, SinkReport
from imitor.types import STATUS, Array

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

log = logging.getLogger("imitor")
HELD, STOPPED = STATUS.index("held"), STATUS.index("stopped")
_BEYOND_RAD: Final = 0.2
"""A robot that tells a posture farther beyond its limits is not the robot of the card [rad]."""


class Hiccup(Exception):
    """A command did not get through; the next one may."""


class StartConfig(Config):
    """How a robot, also a simulated one, gets to the first command."""

    blend_speed_rad_s: float = Field(
        0.5, gt=0, le=3,
        description="Largest joint speed on the way from the robot's posture to the first command [rad/s].",
    )  # fmt: skip


class RobotConfig(StartConfig):
    """What every sink that moves a real robot can be told."""

    armed: bool = Field(False, description="Whether commands are sent; --arm sets it for one run [-].")
    give_up_s: float = Field(
        1.0, gt=0, le=60, description="How long no command may get through before the run fails [s]."
    )


class BlindConfig(RobotConfig):
    """Of protocols that do not tell the robot's posture."""

    start_posture: Mapping[str, float | tuple[float, float]] = Field(
        {},
        description="Where the robot is at first: joint or template -> position, a pair is left, right; other joints "
        "as in the card's standing posture [rad].",
    )


C = TypeVar("C", bound=StartConfig)
B = TypeVar("B", bound=BlindConfig)


class RobotSink(Sink[C]):
    """Moves a robot with commands at the output rate. A subclass speaks the protocol.

    Unarmed, everything is computed and nothing is sent; the protocol is not even connected. Armed, the robot is
    asked where it is and blended from there to the first command. Commands keep the card's limits of position and
    speed. Live, the runner keeps time and the blend goes along with the person; of a recording the first command waits
    until the robot is there, and one command a period is sent. At the end the last posture is sent once more, at rest.

    Attributes:
        module: The package that must be there, as it is imported; `Component.extra` names the group that brings it.
        run: What the run told when it started.
        command: The newest command.
    """

    realtime = True
    module: ClassVar[str] = ""
    run: RunInfo
    command: Command

    # ------------------------------------------------------------------ what a subclass writes

    def prepare(self, robot: RobotModel) -> None:
        """Check that the robot fits the protocol and look its joints up; also unarmed.

        Raises:
            SinkError: It does not fit.
        """

    def connect(self) -> None:
        """Reach the robot; armed only.

        Raises:
            SinkError: It cannot be reached; says what to do.
        """

    def present(self) -> Mapping[str, float] | None:
        """Return where the robot is, joint -> position [rad], or ``None`` when it does not tell."""
        return None

    def send(self, command: Command) -> None:
        """Send one command.

        Raises:
            Hiccup: It did not get through.
        """
        raise NotImplementedError

    def rest(self, command: Command) -> None:
        """Send the last command once more, with all velocities zero."""
        self.send(command)

    def figures(self) -> dict[str, Any]:
        """Return figures of the protocol for the report."""
        return {}

    # ------------------------------------------------------------------ the run

    @property
    def armed(self) -> bool:
        """Whether commands are sent; to a simulation always."""
        return self.config.armed if isinstance(self.config, RobotConfig) else True

    def start(self) -> None:
        """Check that the package that speaks the protocol is there."""
        if self.module and importlib.util.find_spec(self.module) is None:
            raise SinkError(
                f"it needs the package {self.module}, which is not installed: pip install 'imitor[{self.extra}]'"
            )

    def package(self) -> Any:
        """Return the package that speaks the protocol."""
        return importlib.import_module(self.module)

    def open(self, run: RunInfo) -> None:
        """Get ready: fit the robot to the protocol and, armed, reach it and learn where it is.

        Raises:
            SinkError: The robot does not fit, cannot be reached or does not tell where it is.
        """
        self.run, robot = run, run.robot
        self._dt_s = 1.0 / run.rate_hz
        self._lower, self._upper, self._speed = robot.lower.copy(), robot.upper.copy(), robot.speed.copy()
        self._sent = self._failed = self._not_finite = 0
        self._failing_since_s: float | None = None
        self._give_up_s = self.config.give_up_s if isinstance(self.config, RobotConfig) else 0.0
        self._finished = False
        self.command = Command.of(robot)
        self._pace = None if run.live or not self.armed else Pace(self._dt_s)
        self.prepare(robot)
        if not self.armed:
            log.info("%s: dry run, nothing is sent and nothing moves; --arm lets it move", self.name)
            start = robot.standing[N_BASE:]
        else:
            try:
                self.connect()
                start = self._posture(robot)
            except BaseException:
                self.close()
                raise
        self._begin_at(start)

    def _begin_at(self, joints: Array) -> None:
        self.command.q[N_BASE:] = joints
        acceleration, slowly = self.run.robot.acceleration, self.config.blend_speed_rad_s
        self._approach = Approach(joints, self._speed, acceleration, self._dt_s, slowly)

    def _posture(self, robot: RobotModel) -> Array:
        found = self.present()
        if found is None:
            raise SinkError(
                "the robot does not tell where its joints are, so it is not moved; is it switched on?"
            )
        missing = [name for name in robot.joint_names if name not in found]
        if missing:
            raise SinkError(
                f"the robot does not tell where {', '.join(missing)} is, so it is not moved; is it a {robot.name}?"
            )
        joints = np.array([found[name] for name in robot.joint_names])
        beyond = np.maximum(self._lower - joints, joints - self._upper)
        worst = int(np.nan_to_num(beyond, nan=np.inf).argmax())
        if not beyond[worst] <= _BEYOND_RAD:
            raise SinkError(
                f"the robot tells that {robot.joint_names[worst]} is at {joints[worst]:.2f} rad, outside "
                f"{self._lower[worst]:.2f} to {self._upper[worst]:.2f}, so it is not moved; is it a {robot.name}?"
            )
        if robot.coupling is not None:  # measured twice, moved by one motor: the first one counts
            joints = robot.coupling @ joints[robot.coupling.argmax(axis=0)]
        return joints

    def write(self, record: Record) -> None:
        """Send the command of a frame; the first one of a recording waits until the robot is there.

        Raises:
            SinkError: The robot does not tell where it is, or for ``give_up_s`` no command has got through.
        """
        q, status = record.state.q, record.state.status
        if not isfinite(q.dot(q)):
            self._not_finite += 1
            q, status = self.command.q, HELD
        if self.command.index < 0:
            self.command.q[:N_BASE] = q[:N_BASE]
            if self.armed:  # since `open` it may have moved
                self._begin_at(self._posture(self.run.robot))
            self._approach.plan(np.clip(q[N_BASE:], self._lower, self._upper))
            if self.armed and self._approach.duration_s > 0:
                log.info("%s: %.1f s to the first command", self.name, self._approach.duration_s)
        while self._pace is not None and not self._approach.done:
            self._tell(q, record, HELD)
        self._tell(q, record, status)

    def _tell(self, q: Array, record: Record, status: int) -> None:
        if self._pace is not None:
            self._pace.wait()
        c = self.command
        told = q.copy()
        if (
            status == STOPPED and not self._approach.done
        ):  # a stop counts on the way to the first command, too
            told[N_BASE:] = self._approach.stay()
        else:
            told[N_BASE:] = self._approach.step(np.clip(q[N_BASE:], self._lower, self._upper))
        c.v[:] = self.run.robot.difference(c.q, told)
        c.v /= self._dt_s
        c.q, c.status, c.time_s = told, status, record.time_s
        c.contact[:] = record.state.contact
        c.index += 1
        if self.armed:
            self._send(c)

    def _send(self, command: Command) -> None:
        try:
            self.send(command)
        except Hiccup as error:
            now = time.perf_counter()
            self._failed += 1
            if self._failing_since_s is None:
                self._failing_since_s = now
                log.warning("%s: a command did not get through: %s", self.name, error)
            elif now - self._failing_since_s > self._give_up_s:
                raise SinkError(
                    f"for {self._give_up_s:g} s no command has got through: {error}; the robot keeps what it was "
                    "told last"
                ) from error
            return
        self._sent += 1
        self._failing_since_s = None

    def finish(self) -> SinkReport:
        """Leave the robot at rest where it was told to be last; the joints stay stiff."""
        c = self.command
        if self.armed and c.index >= 0 and not self._finished:
            self._finished = True
            c.v[:] = 0.0
            c.index += 1
            with contextlib.suppress(Hiccup):
                self.rest(c)
        figures: dict[str, Any] = {"armed": self.armed} if isinstance(self.config, RobotConfig) else {}
        figures |= {
            "commands": max(c.index + 1 - self._finished, 0),
            "sent": self._sent,
            "not_sent": self._failed,
            "not_finite": self._not_finite,
            "approach_s": self._approach.duration_s,
        }
        return SinkReport(figures={self.name: figures | self.figures()})


class BlindRobotSink(RobotSink[B]):
    """A robot sink whose protocol tells nothing back: where the robot is at first is taken from card and options."""

    def present(self) -> Mapping[str, float]:
        """Return the posture of card and option ``start_posture`` [rad].

        Raises:
            UnknownJoint: The robot has no such joint.
        """
        robot = self.run.robot
        joints = robot.joint_values({**robot.card.standing, **self.config.start_posture}, "start_posture")
        return dict(zip(robot.joint_names, joints.tolist(), strict=True))


__all__ = ["BlindConfig", "BlindRobotSink", "Hiccup", "RobotConfig", "RobotSink", "StartConfig"]
