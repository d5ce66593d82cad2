"""A simulated robot in real time: the rehearsal for a real one."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from pydantic import Field

from imitor import RunInfo, SinkReport, hookimpl
from imitor.commands.command import Command
from imitor.commands.robot_sink import RobotSink, StartConfig
from imitor.simulation.options import PhysicsConfig, build_body

if TYPE_CHECKING:
    from imitor.simulation.live import LiveRun
    from imitor.simulation.window import Window

log = logging.getLogger("imitor")


class MujocoLiveConfig(StartConfig, PhysicsConfig):
    """How the robot starts, its servos, the floor, and what counts as a fall."""

    settle_s: float = Field(
        0.5, ge=0, le=10, description="How long it stands before the first command, simulated at once [s]."
    )


class MujocoLive(RobotSink[MujocoLiveConfig]):
    """Executes commands in physics (MuJoCo) as they come, in real time; --view opens its window."""

    name = "mujoco_live"

    _live: LiveRun | None = None
    _window: Window | None = None

    def open(self, run: RunInfo) -> None:
        """Build the simulated robot before the first frame.

        Raises:
            RobotError: The robot cannot be simulated so.
            SinkError: No window is possible here, or an object's mesh cannot be read.
        """
        from imitor.simulation.live import LiveRun
        from imitor.simulation.verdict import FallRule
        from imitor.simulation.window import Window, check_display

        if run.view:
            check_display()
            self._window = Window(paced=False)
        c = self.config
        self._live = LiveRun(
            build_body(c, run), 1.0 / run.rate_hz, FallRule(c.fall_tilt_rad, c.fall_drop_share),
            velocity_reference=c.velocity_reference, observer=self._window,
        )  # fmt: skip
        self._placed = False
        super().open(run)

    def present(self) -> Mapping[str, float]:
        """Return where the simulated joints are; at first they stand [rad]."""
        robot = self.run.robot
        joints = self._live.joints() if self._live is not None and self._placed else robot.standing[7:]
        return dict(zip(robot.joint_names, joints.tolist(), strict=True))

    def send(self, command: Command) -> None:
        """Let one period pass in the simulation; before the first, the robot is put where the command has it."""
        live = self._live
        if live is None:
            return
        if not self._placed:
            self._placed = True
            q = self.run.robot.standing.copy()
            x, y, z, w = command.q[3:7].tolist()
            yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
            q[:2], q[3:7] = command.q[:2], (0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0))
            live.place(q, self.config.settle_s)
        fallen = live.fall is not None
        live.step(command.q, measured=self._approach.done)
        if live.fall is not None and not fallen:
            log.info("mujoco_live: the robot fell after %.2f s: %s", live.fall.time_s, live.fall.reason)

    def rest(self, command: Command) -> None:
        """Leave the simulation where it is."""

    def finish(self) -> SinkReport:
        """Report whether the robot fell, and how far it was from the commands."""
        report = super().finish()
        if self._live is not None and self._placed:
            report.figures["simulation"] = self._live.figures()
        return report

    def close(self) -> None:
        """Close the window; safe to call again."""
        if self._window is not None:
            self._window.close()
        if self._live is not None:
            self._live.close()
        self._live = self._window = None


@hookimpl
def imitor_components() -> list[type[MujocoLive]]:
    """Register the sink."""
    return [MujocoLive]
