"""NAO and Pepper: joint angles by the robot's own motion service."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from pydantic import Field

from imitor import hookimpl
from imitor.commands.command import Command
from imitor.commands.joints import renamed
from imitor.commands.robot_sink import Hiccup, RobotConfig, RobotSink
from imitor.errors import SinkError

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

CYCLE_HZ: Final = 50.0
"""Commands a second that the motion service takes up [Hz]."""
_STIFF: Final = 0.3
"""Less stiffness than this does not hold a joint [-]."""
_START_S: Final = 3.0
"""How long the probe may take beside the robot's answer [s]."""
_PROBE: Final = """
import os, sys
import qi
code = 1
try:
    session = qi.Session()
    session.connect(sys.argv[1])
    session.service("ALMotion")
    code = 0
except RuntimeError as error:
    print(str(error).strip().splitlines()[0], flush=True)
os._exit(code)
"""
_UNASKED: Final = (("setIdlePostureEnabled", "Body"), ("setBreathEnabled", "Body"))
"""Movements of its own, and of which chain each is switched off."""


class NaoqiConfig(RobotConfig):
    """Where the robot is, and how it takes the commands."""

    host: str = Field("127.0.0.1", description="Name or address of the robot, e.g. nao.local [-].")
    port: int = Field(9559, ge=1, le=65535, description="Port of its broker [-].")
    speed_fraction: float = Field(
        1.0,
        gt=0,
        le=1,
        description="Share of a motor's largest speed at which it goes to an angle; less is smoother, and late in "
        "fast movements [-].",
    )
    wake_up: bool = Field(
        False,
        description="Whether the robot is told to stand up and stiffen first, which moves it at once [-].",
    )
    still: bool = Field(
        True,
        description="Whether breathing and idle movements, which add to the commands, are switched off [-].",
    )
    joints: Mapping[str, str] = Field(
        {}, description="Joint or template -> its name at the robot, where it has another [-]."
    )
    timeout_s: float = Field(
        5.0, gt=0, le=60, description="How long the robot may take to answer a question [s]."
    )


class Naoqi(RobotSink[NaoqiConfig]):
    """Moves a NAO or Pepper (NAOqi, ALMotion); hands are left alone."""

    name = "naoqi"
    extra = "nao"
    module = "qi"

    _session: Any = None
    _motion: Any = None
    _under_way: Any = None

    def prepare(self, robot: RobotModel) -> None:
        """Name the joints, and choose which commands are sent: no more than the robot takes up.

        Raises:
            SinkError: Two joints have one name.
        """
        self._names = renamed(robot, self.config.joints)
        self._every = max(1, math.ceil(self.run.rate_hz / CYCLE_HZ - 1e-6))
        self._skipped = 0

    def connect(self) -> None:
        """Reach the robot, see that its motors hold, and stop its own movements.

        Raises:
            SinkError: It does not answer, has other joints, or its motors are off.
        """
        qi, c = self.package(), self.config
        qi.logging.setLevel(qi.logging.FATAL)  # it writes into the output; its errors come back to us
        url = f"tcp://{c.host}:{c.port}"
        self._knock(url)
        self._session = qi.Session()
        self._answer(self._session.connect(url, _async=True), f"connecting to {url}")
        self._motion = self._answer(self._session.service("ALMotion", _async=True), "its service ALMotion")
        known = self._ask("getBodyNames", "Body")
        strange = [name for name in self._names if name not in known]
        if strange:
            raise SinkError(
                f"the robot at {url} has no joint {', '.join(strange)} (it has {', '.join(known)}); choose its card "
                "with --robot, or set the option `joints`"
            )
        if c.wake_up:
            self._motion.wakeUp()
        soft = [
            n
            for n, s in zip(self._names, self._ask("getStiffnesses", self._names), strict=True)
            if s < _STIFF
        ]
        if soft:
            raise SinkError(
                f"the motors of {', '.join(soft)} are off; wake the robot up (press its chest button twice), or set "
                "the option `wake_up`"
            )
        if c.still:
            for call, chain in _UNASKED:
                if hasattr(self._motion, call):
                    self._ask(call, chain, False)

    def _knock(self, url: str) -> None:
        """Connect in a process of its own first: qi can hang or crash when there is no robot.

        Raises:
            SinkError: There is none.
        """
        try:
            done = subprocess.run(
                [sys.executable, "-c", _PROBE, url], capture_output=True, text=True, check=False,
                timeout=self.config.timeout_s + _START_S, env={**os.environ, "QI_LOG_LEVEL": "0"},
            )  # fmt: skip
            said = done.stdout.strip().splitlines()
            why = "" if done.returncode == 0 else said[-1] if said else "what listens there is no robot"
        except subprocess.TimeoutExpired:
            why = f"no answer in {self.config.timeout_s:g} s"
        if why:
            raise SinkError(
                f"{url}: {why}; is the robot switched on and in this network, and are `host` and `port` its own?"
            )

    def _ask(self, call: str, *arguments: Any) -> Any:
        return self._answer(getattr(self._motion, call)(*arguments, _async=True), f"ALMotion.{call}")

    def _answer(self, future: Any, what: str) -> Any:
        """Return what the robot answers.

        Raises:
            SinkError: It does not, or with an error.
        """
        future.wait(int(self.config.timeout_s * 1000))
        if future.isRunning():
            raise SinkError(
                f"{what}: no answer in {self.config.timeout_s:g} s; is the robot switched on and in this network?"
            )
        if future.hasError():
            why = str(future.error()).strip().splitlines()
            raise SinkError(
                f"{what}: {why[0] if why else 'refused'}; is the robot switched on, and are `host` and `port` its own?"
            )
        return future.value()

    def present(self) -> Mapping[str, float]:
        """Return the measured joint angles [rad].

        Raises:
            SinkError: The robot does not answer.
        """
        angles: Sequence[float] = self._ask("getAngles", self._names, True)
        return dict(zip(self.run.robot.joint_names, map(float, angles), strict=True))

    def send(self, command: Command) -> None:
        """Tell the robot where to go, without waiting for it; surplus commands are left out."""
        if command.index % self._every:
            self._skipped += 1
            return
        self.rest(command)

    def rest(self, command: Command) -> None:
        """Tell the robot where to go, without waiting for it."""
        if self._under_way is not None:
            before, self._under_way = self._under_way, None
            if before.isRunning():
                self._under_way = before
                raise Hiccup("the robot has not yet answered the command before")
            if before.hasError():
                raise Hiccup(str(before.error()).strip().split("\n", 1)[0])
        try:
            self._under_way = self._motion.setAngles(
                self._names, command.joints.tolist(), self.config.speed_fraction, _async=True
            )
        except RuntimeError as error:
            raise Hiccup(str(error)) from None

    def figures(self) -> dict[str, Any]:
        """Return how many commands were left out, since the robot takes up no more."""
        return {"left_out": self._skipped}

    def close(self) -> None:
        """Leave the robot, stiff as it is; safe to call again."""
        if self._under_way is not None:
            self._under_way.wait(500)
        if self._session is not None:
            self._session.close()
        self._session = self._motion = self._under_way = None


@hookimpl
def imitor_components() -> list[type[Naoqi]]:
    """Register the sink."""
    return [Naoqi]
