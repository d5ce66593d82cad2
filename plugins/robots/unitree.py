"""Unitree G1: joint positions to its motors, over the maker's topics."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field, field_validator

from imitor import hookimpl
from imitor.commands.command import Command
from imitor.commands.g1 import DEPTH_FIRST, WAIST_AND_ARMS
from imitor.commands.joints import places
from imitor.commands.robot_sink import Hiccup, RobotConfig, RobotSink
from imitor.errors import SinkError
from imitor.robot.card import expand_limits
from imitor.types import Array

if TYPE_CHECKING:
    from imitor.commands.unitree_link import Link
    from imitor.robot.model import RobotModel

_SILENT_S: Final = 0.5
"""A robot that tells nothing for so long is gone [s]."""
_LEG: Final = ((60.0, 1.0), (60.0, 1.0), (60.0, 1.0), (100.0, 2.0), (40.0, 1.0), (40.0, 1.0))
_WAIST: Final = ((60.0, 1.0), (40.0, 1.0), (40.0, 1.0))
GAINS: Final = np.array([*_LEG, *_LEG, *_WAIST, *14 * ((40.0, 1.0),)])
"""Stiffness [N m/rad] and damping [N m s/rad] of the 29 motors, those of the maker's low-level example."""
_Gain = Annotated[float, Field(ge=0, le=500)]


class UnitreeConfig(RobotConfig):
    """Which interface of the robot is used, and how stiff it is held."""

    interface: str = Field(
        "lo", description="Network interface towards the robot, e.g. eth0; lo stays on this machine [-]."
    )
    domain: int = Field(0, ge=0, le=232, description="DDS domain; the robot's is 0 [-].")
    mode: Literal["arm_sdk", "lowcmd"] = Field(
        "arm_sdk",
        description="arm_sdk: waist and arms, while the maker's controller keeps the legs; lowcmd: every motor, once "
        "that controller is released [-].",
    )
    kp_nm_per_rad: Mapping[str, _Gain] = Field(
        {}, description="Stiffness: joint, template or * [N m/rad]; others as in the maker's example."
    )
    kd_nm_s_per_rad: Mapping[str, _Gain] = Field(
        {}, description="Damping: joint, template or * [N m s/rad]; others as in the maker's example."
    )
    publish_hz: float = Field(
        250.0,
        ge=20,
        le=500,
        description="Messages a second; positions go evenly from command to command [Hz].",
    )
    take_over_s: float = Field(
        2.0, ge=0.1, le=30, description="arm_sdk: how long the commands take to get the arms wholly [s]."
    )
    hand_back_s: float = Field(
        0.0,
        ge=0,
        le=30,
        description="arm_sdk: how long the arms are given back at the end; 0 keeps them [s].",
    )
    timeout_s: float = Field(
        3.0, gt=0, le=60, description="How long the robot may take to tell its state [s]."
    )

    @field_validator("interface")
    @classmethod
    def _plain(cls, name: str) -> str:
        if not name or not all(c.isalnum() or c in "._-" for c in name):
            raise ValueError(f"'{name}' is no name of a network interface, such as eth0")
        return name


class Unitree(RobotSink[UnitreeConfig]):
    """Moves a Unitree G1 with 29 joints (DDS): arms and waist, or every motor."""

    name = "unitree"
    extra = "unitree"
    module = "cyclonedds"

    _link: Link | None = None

    def prepare(self, robot: RobotModel) -> None:
        """Look the joints and gains up.

        Raises:
            SinkError: The robot is no G1 with 29 joints.
            UnknownJoint: A gain is for a joint that it has not.
        """
        c = self.config
        order = places(robot, DEPTH_FIRST, "the Unitree G1")
        self._motors = list(WAIST_AND_ARMS if c.mode == "arm_sdk" else range(len(DEPTH_FIRST)))
        self._order = order[self._motors]
        gains = GAINS.copy()
        for column, (name, values) in enumerate(
            {"kp_nm_per_rad": c.kp_nm_per_rad, "kd_nm_s_per_rad": c.kd_nm_s_per_rad}.items()
        ):
            given = expand_limits(values)
            gains[:, column] = given.pop("*", gains[:, column])
            for joint, value in given.items():
                robot.joint_index(joint, name)
                gains[DEPTH_FIRST.index(joint), column] = value
        self._gains: Array = gains[self._motors]

    def connect(self) -> None:
        """Join the network.

        Raises:
            SinkError: The network interface cannot be used.
        """
        from imitor.commands import unitree_link

        c = self.config
        topic = unitree_link.ARM_SDK if c.mode == "arm_sdk" else unitree_link.LOWCMD
        self._link = unitree_link.Link(c.interface, c.domain, topic, c.publish_hz, 1.0 / self.run.rate_hz)

    def present(self) -> Mapping[str, float]:
        """Return the measured joint positions [rad].

        Raises:
            SinkError: The robot tells nothing.
        """
        c = self.config
        state = None if self._link is None else self._link.listen(c.timeout_s)
        if state is None:
            raise SinkError(
                f"no G1 told its state on interface '{c.interface}' in {c.timeout_s:g} s; is the robot switched on, "
                "and is this its network? Set the option `interface`"
            )
        self._mode_machine = int(state.mode_machine)
        self._told = {
            name: float(motor.q) for name, motor in zip(DEPTH_FIRST, state.motor_state, strict=False)
        }
        return self._told

    def send(self, command: Command) -> None:
        """Hand the positions to the thread that publishes them; the first command starts it."""
        link = self._link
        if link is None:
            raise Hiccup("the link is closed")
        joints = command.joints[self._order]
        if not link.running and link.error is None:
            present = np.array([self._told[DEPTH_FIRST[m]] for m in self._motors])
            link.start(self._motors, present, self._gains[:, 0], self._gains[:, 1], self._mode_machine)
            if self.config.mode == "arm_sdk":
                link.ramp(1.0, self.config.take_over_s)
        link.tell(joints)
        if link.error is not None:
            raise Hiccup(str(link.error))
        if time.perf_counter() - link.heard_s > _SILENT_S:
            raise Hiccup(f"the robot has told nothing for {_SILENT_S:g} s")

    def rest(self, command: Command) -> None:
        """Stay there; with ``hand_back_s`` the arms are given back to the maker's controller."""
        self.send(command)
        link, c = self._link, self.config
        if link is None:
            return
        time.sleep(1.0 / self.run.rate_hz + 2.0 / c.publish_hz)  # the last position has been published
        if c.mode == "arm_sdk" and c.hand_back_s > 0:
            link.ramp(0.0, c.hand_back_s)
            end = time.perf_counter() + 2.0 * c.hand_back_s + 0.5
            while link.weight > 0.0 and link.error is None and time.perf_counter() < end:
                time.sleep(0.01)

    def figures(self) -> dict[str, Any]:
        """Return how many messages were published."""
        return {"published": self._link.published if self._link is not None else 0}

    def close(self) -> None:
        """Stop publishing; safe to call again."""
        if self._link is not None:
            self._link.close()
            self._link = None


@hookimpl
def imitor_components() -> list[type[Unitree]]:
    """Register the sink."""
    return [Unitree]
