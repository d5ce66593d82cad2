"""A simulated robot: the finished motion is executed in physics, and the verdict says whether it stays up.

Hands that the motion declares to hold an object are welded to it while they do.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, field_validator

from imitor import RunInfo, SinkReport, hookimpl
from imitor.recorded_sink import RecordedSink, writing
from imitor.simulation.options import PhysicsConfig, build_body

if TYPE_CHECKING:
    from imitor.simulation.playback import Trace

log = logging.getLogger("imitor")


_STANDING = frozenset({"", "left_foot", "right_foot"})
"""Anchors of a robot that is not held: none, or a foot that stands."""


class MujocoConfig(PhysicsConfig):
    """The servos, the floor, what counts as a fall, and which files are written."""

    base: Literal["auto", "free", "held"] = Field(
        "auto",
        description="Whether the base is free or held where the motion has it, as on a stand; auto: held where the "
        "tasks' anchor is no foot [-].",
    )
    grasp: bool = Field(
        True,
        description="Whether hands are welded to objects while the motion declares that they hold them [-].",
    )
    grasp_reach_m: float = Field(
        0.03, gt=0, le=0.5, description="How near an object's surface a hand must be to take hold of it [m]."
    )
    settle_s: float = Field(
        1.0, ge=0, le=60, description="How long the first command is held before the motion plays [s]."
    )
    file: bool = Field(True, description="Whether simulation.npz is written [-].")
    video: bool = Field(
        False, description="Whether simulation.gif and simulation.png are rendered, without a display [-]."
    )
    size_px: tuple[int, int] = Field((480, 360), description="Width and height of the video [px].")
    fps: float = Field(25.0, gt=0, le=50, description="Pictures per second of the video [Hz].")

    @field_validator("size_px")
    @classmethod
    def _sensible(cls, size: tuple[int, int]) -> tuple[int, int]:
        if any(n % 2 or not 64 <= n <= 4096 for n in size):
            raise ValueError("width and height must be even numbers from 64 to 4096")
        return size


class Mujoco(RecordedSink[MujocoConfig]):
    """Executes the motion in physics (MuJoCo) and reports falls, ZMP, torques and tracking errors."""

    name = "mujoco"

    trace: Trace
    """What happened in physics frame by frame; set by `finish`."""

    def open(self, run: RunInfo) -> None:
        """Build the simulated robot before the first frame.

        Raises:
            RobotError: The robot cannot be simulated so.
            SinkError: No window or picture is possible here, or an object's mesh cannot be read.
        """
        super().open(run)
        if run.view:
            from imitor.simulation.window import check_display

            check_display()
        if self.config.video:
            from imitor.visual.offscreen import check_rendering

            check_rendering()
        self._body = build_body(self.config, run, held=self.config.base == "held")

    def save(self) -> SinkReport:
        """Simulate, measure, and write what is asked for."""
        from imitor.simulation.verdict import figures

        if self.config.base == "auto" and self.run.stack.anchor not in _STANDING:
            self._body = build_body(self.config, self.run, held=True)
        trace = self.trace = self._play()
        verdict = figures(trace, self._body)
        if trace.fall is None:
            log.info("mujoco: the robot stayed up for %.2f s", verdict["survived_s"])
        else:
            log.info("mujoco: the robot fell after %.2f s: %s", trace.fall.time_s, trace.fall.reason)
        return SinkReport(self._files(trace), {"simulation": verdict})

    def _play(self) -> Trace:
        from imitor.simulation.playback import play
        from imitor.simulation.verdict import FallRule
        from imitor.simulation.window import Window

        c, window = self.config, Window() if self.run.view else None
        try:
            return play(
                self._body, self.recorder.motion(), settle_s=c.settle_s,
                rule=FallRule(c.fall_tilt_rad, c.fall_drop_share),
                velocity_reference=c.velocity_reference, observer=window,
                reference=self.recorder.reference(), reach_m=c.grasp_reach_m if c.grasp else 0.0,
            )  # fmt: skip
        finally:
            if window is not None:
                window.close()

    def _files(self, trace: Trace) -> list[Path]:
        from imitor.simulation.film import save_arrays

        files, folder = [], self.run.out_dir
        if self.config.file:
            files.append(folder / "simulation.npz")
            with writing(files[-1]) as temporary:
                save_arrays(temporary, trace, self.run.robot)
        return files + (self._film(trace) if self.config.video else [])

    def _film(self, trace: Trace) -> list[Path]:
        from imitor.simulation.film import Film, executed_motion
        from imitor.simulation.verdict import standing_feet

        robot, folder = self.run.robot, self.run.out_dir
        motion = executed_motion(trace, robot, standing_feet(trace, self._body.weight_n))
        reference = replace(self.recorder.reference(), object_shift_m=trace.object_shift)
        film = Film(
            robot, motion, reference, self.config.size_px, self.config.fps, self.run.environment
        )  # fmt: skip
        gif, sheet = folder / "simulation.gif", folder / "simulation.png"
        try:
            with writing(gif) as temporary:
                film.save_gif(temporary)
            with writing(sheet) as temporary:
                film.save_sheet(temporary, self._title())
        finally:
            film.close()
        return [gif, sheet]

    def _title(self) -> str:
        parts: list[Any] = [self.run.pipeline_name, self.run.robot.card.title, "in simulation"]
        return "  ·  ".join(p for p in parts if p)


@hookimpl
def imitor_components() -> list[type[Mujoco]]:
    """Register the sink."""
    return [Mujoco]
