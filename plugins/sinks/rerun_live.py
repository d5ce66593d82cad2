"""A live view in the Rerun viewer, here or elsewhere: it begins with the run and keeps what memory allows."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal
from uuid import uuid4

import numpy as np
from pydantic import Field

from imitor import Config, Record, RunInfo, Sink, SinkReport, hookimpl
from imitor.errors import SinkError

if TYPE_CHECKING:
    from imitor.visual.rerun_process import RerunProcess

log = logging.getLogger("imitor")

MOST_FRAMES: Final = 256
"""Frames that wait for the viewer; of a live run the older ones are left out beyond that."""
CURVES_S: Final = 0.25
"""Curves grow so often: together they cost as much as a picture [s]."""
PATIENCE_S: Final = 10.0
"""How long a viewer may keep a run that is not live waiting [s]."""
END_S: Final = 2.0
"""How long the viewer may take for the last frames [s]."""


class RerunLiveConfig(Config):
    """Where it is shown, and how much is kept."""

    serve: bool = Field(
        False, description="Serve viewers elsewhere even with --view; without --view that is so anyway [-]."
    )
    host: str = Field("127.0.0.1", description="Address to serve at; 0.0.0.0 for other machines [-].")
    port: int = Field(9876, ge=0, le=65535, description="Port to serve at; 0 for a free one [-].")
    memory_mb: int = Field(
        1024, ge=16, le=65536, description="What viewer or server keep; then the oldest frames go [MB]."
    )
    max_hz: float = Field(
        30.0, gt=0, le=1000, description="Most pictures sent a second; curves have all [Hz]."
    )
    layout: Literal["beside", "overlay"] = Field(
        "beside", description="Human beside the robot at the same scale, or where the robot is [-]."
    )


class RerunLive(Sink[RerunLiveConfig]):
    """Shows a run while it goes on: serves Rerun viewers, with --view opens one."""

    name = "rerun_live"
    newest = True

    _process: RerunProcess | None = None
    _shown = _left_out = 0

    def start(self) -> None:
        """Import Rerun."""
        import rerun  # noqa: F401

    def open(self, run: RunInfo) -> None:
        """Open the window, or begin to serve; send what does not change.

        Raises:
            SinkError: There is no display, the port is taken, or the viewer does not start.
        """
        import rerun as rr

        from imitor.record import Recorder
        from imitor.visual.rerun_log import RerunLog
        from imitor.visual.rerun_plots import RerunPlots
        from imitor.visual.rerun_scene import RerunScene

        arguments, address = self._where(run)
        stream = rr.RecordingStream(f"imitor {run.pipeline_name}".strip(), recording_id=uuid4())
        self._memory = stream.binary_stream()
        self._log = RerunLog(stream)
        self._scene = RerunScene(run.robot, run.stack, run.environment)
        self._plots = RerunPlots(run.robot)
        self._run, self._recorder = run, Recorder(replace(run, live=False, n_frames=MOST_FRAMES))
        self._latency_s, self._margin_m = np.empty(MOST_FRAMES), np.empty(MOST_FRAMES)
        self._sent = 0
        self._picture_s = self._curves_s = 0.0
        self._log.blueprint(self._plots.blueprint(live=True))
        self._scene.begin(self._log)
        self._plots.begin(self._log)
        self._begin(arguments, address, stays=run.view and not self.config.serve)

    def _where(self, run: RunInfo) -> tuple[list[str], tuple[str, int]]:
        from imitor.visual.offscreen import headless
        from imitor.visual.rerun_process import server, window

        c = self.config
        if not run.view or c.serve:
            return server(c.host, c.port, c.memory_mb)
        if headless():
            raise SinkError(
                f"there is no display here for the viewer; look from elsewhere: --set {self.name}.serve=true"
            )
        return window(c.memory_mb)

    def _begin(self, arguments: list[str], address: tuple[str, int], *, stays: bool) -> None:
        from imitor.visual.rerun_process import RerunProcess

        content = self._memory.read()
        if not content:
            raise SinkError("the recording stream gave no data; is RERUN=off set in the environment?")
        self._process = RerunProcess(arguments, address, content, stays=stays)
        if not stays:
            host, port = address
            near = f"[{host}]" if ":" in host else host
            log.info("%s: to look: rerun rerun+http://%s:%d/proxy", self.name, near, port)

    def write(self, record: Record) -> None:
        """Keep one frame, and send those kept when a picture is due and the viewer took the last one."""
        if self._process is None:
            return
        if len(self._recorder) == MOST_FRAMES:
            self._make_room()
        self._latency_s[len(self._recorder)] = record.latency_s
        self._recorder.add(record)
        now = time.perf_counter()
        if now >= self._picture_s and self._ready():
            self._picture_s = now + 1.0 / self.config.max_hz
            self._send(curves=now >= self._curves_s)

    def _make_room(self) -> None:
        """Send all frames that wait; those of a live run are left out when the viewer is not ready."""
        if self._ready(0.0 if self._run.live else PATIENCE_S):
            self._send(curves=True)
        else:
            self._left_out += len(self._recorder) - self._sent
            self._clear()

    def _ready(self, patience_s: float = 0.0) -> bool:
        """Tell whether the viewer took everything; one that is gone is told of once, and the run goes on."""
        if self._process is None:
            return False
        ready = self._process.taken(patience_s)
        if not self._process.alive or (patience_s and not ready):
            why = self._process.complaint()
            log.warning(
                "%s: the viewer %s%s; the run goes on without it", self.name,
                "does not answer" if self._process.alive else "was closed", f" ({why})" if why else "",
            )  # fmt: skip
            self.close()
            return False
        return ready

    def _send(self, *, curves: bool) -> None:
        """Send the frames that were not yet.

        Args:
            curves: Whether the curves of all frames kept are sent as well, which are then forgotten.
        """
        assert self._process is not None
        motion, reference = self._recorder.motion(), self._recorder.reference()
        rows = np.arange(self._sent, len(motion))
        if len(rows):
            clip = self._scene.clip(motion, reference, rows)
            if not self._scene.arranged and clip.human_valid.any():
                beside = self.config.layout == "beside"
                self._scene.arrange_ahead(clip, reference.human_height_m, beside=beside)
            self._margin_m[rows] = self._scene.add(self._log, clip, reference, rows)
            self._shown += len(rows)
            self._sent = len(motion)
        if curves and len(motion):
            self._plots.add(self._log, motion, reference, self._latency_s[: len(motion)])
            self._plots.add_margin(self._log, motion.time_s, self._margin_m[: len(motion)])
            self._curves_s = time.perf_counter() + CURVES_S
        self._process.send(self._memory.read() or b"")
        if curves:  # not before everything is written: the columns may be views of the rows
            self._clear()

    def _clear(self) -> None:
        self._recorder.clear()
        self._sent = 0

    def finish(self) -> SinkReport:
        """Send what is left."""
        if self._process is not None and self._ready(END_S):
            self._send(curves=True)
            if self._process is not None:
                self._process.taken(END_S)
        return SinkReport(figures={self.name: {"shown": self._shown, "left_out": self._left_out}})

    def close(self) -> None:
        """End the server; a window stays. Safe to call again."""
        if self._process is not None:
            self._process.close()
            self._process = None
            self._recorder.close()


@hookimpl
def imitor_components() -> list[type[RerunLive]]:
    """Register the sink."""
    return [RerunLive]
