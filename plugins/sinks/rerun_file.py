"""A recording for the Rerun viewer: human, robot, targets and balance in space, and plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from imitor import Config, RunInfo, SinkReport, hookimpl
from imitor.errors import SinkError
from imitor.recorded_sink import RecordedSink, writing


class RerunConfig(Config):
    """The file and what it shows."""

    path: str = Field(
        "run.rrd", description="File in the run directory; with --view a window opens instead [-]."
    )
    max_hz: float = Field(
        60.0,
        gt=0,
        le=1000,
        description="Most poses of human and robot kept a second; joint plots keep every frame [Hz].",
    )
    layout: Literal["beside", "overlay"] = Field(
        "beside", description="Human beside the robot at the same scale, or where the robot is [-]."
    )


class Rerun(RecordedSink[RerunConfig]):
    """Writes a .rrd recording for the Rerun viewer; with --view it opens the viewer."""

    name = "rerun"

    def start(self) -> None:
        """Import Rerun."""
        import rerun  # noqa: F401

    def open(self, run: RunInfo) -> None:
        """Check the folder, or the display.

        Raises:
            SinkError: There is no such folder, or no display for the viewer.
        """
        from imitor.visual.offscreen import headless

        super().open(run)
        if run.view and headless():
            raise SinkError(
                "there is no display here for the viewer; run without --view and open the .rrd file elsewhere"
            )
        self._path = self.folder_of(Path(self.config.path))

    def save(self) -> SinkReport:
        """Write the recording, or send it to a viewer."""
        import rerun as rr

        name = f"imitor {self.run.pipeline_name}".strip()
        stream = rr.RecordingStream(name)
        if self.run.view:
            try:
                stream.spawn()
            except (OSError, RuntimeError) as error:
                raise SinkError(
                    f"sink 'rerun': the viewer cannot be opened: {error}; "
                    "run without --view and open the .rrd file"
                ) from error
            self._send(stream)
            stream.flush()
            return SinkReport()
        # through memory: the stream's own file writer would keep a full disk to itself
        memory = stream.binary_stream()
        self._send(stream)
        content = memory.read()
        if not content:
            raise SinkError(
                "sink 'rerun': the recording stream gave no data; is RERUN=off set in the environment?"
            )
        with writing(self._path) as temporary:
            temporary.write_bytes(content)
        return SinkReport([self._path])

    def _send(self, stream: Any) -> None:
        from imitor.visual.clip import rows_at
        from imitor.visual.rerun_log import RerunLog
        from imitor.visual.rerun_plots import RerunPlots
        from imitor.visual.rerun_scene import RerunScene

        run, motion, reference = self.run, self.recorder.motion(), self.recorder.reference()
        rows = rows_at(motion.time_s, self.config.max_hz)
        log, scene = RerunLog(stream), RerunScene(run.robot, run.stack, run.environment)
        plots = RerunPlots(run.robot)
        clip = scene.clip(motion, reference, rows)
        scene.arrange(clip, beside=self.config.layout == "beside")
        log.blueprint(plots.blueprint(live=False))
        scene.begin(log)
        plots.begin(log)
        plots.add_margin(log, clip.time_s, scene.add(log, clip, reference, rows))
        plots.add(log, motion, reference)


@hookimpl
def imitor_components() -> list[type[Rerun]]:
    """Register the sink."""
    return [Rerun]
