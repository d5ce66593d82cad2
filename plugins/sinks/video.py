"""A video of human and robot, and a contact sheet, rendered without a display."""

from __future__ import annotations

import importlib.util
import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from imitor import Config, RunInfo, SinkReport, hookimpl
from imitor.errors import SinkError
from imitor.recorded_sink import RecordedSink, writing

log = logging.getLogger("imitor")

GIF_LIMIT: Final = 1500
"""Longest .gif: its frames are all held in memory while it is written [frames]."""
_REPORT_EVERY_S: Final = 5.0
_LARGEST_PX: Final = 4096
_SUPERSAMPLING: Final = 2
"""Pictures of the contact sheet are rendered so much larger, for smooth edges."""

Picture = NDArray[np.uint8]


class VideoConfig(Config):
    """What is shown, how large, and in which files."""

    path: str = Field(
        "video", description="Files without ending, in the run directory: PATH.gif or .mp4, PATH.png [-]."
    )
    format: Literal["gif", "mp4", "none"] = Field(
        "gif",
        description="Format of the video; mp4 needs imageio[ffmpeg]; none for the contact sheet alone [-].",
    )
    layout: Literal["beside", "overlay"] = Field(
        "beside", description="Human beside the robot at the same scale, or over it, half transparent [-]."
    )
    size_px: tuple[int, int] = Field(
        (480, 360), description="Width and height of the video, even numbers [px]."
    )
    fps: float = Field(
        25.0, gt=0, le=50, description="Pictures per second, or the rate of the run where that is less [Hz]."
    )
    begin_s: float = Field(0.0, ge=0, description="From where in the run the video starts [s].")
    end_s: float | None = Field(None, gt=0, description="Until where; null for the end of the run [s].")
    balance: bool = Field(True, description="Whether CoM and support polygon are marked on the floor [-].")
    shadows: bool = Field(True, description="Whether figures cast shadows; more than half of the time [-].")
    sheet: bool = Field(True, description="Whether the contact sheet is written [-].")
    columns: int = Field(4, ge=1, le=20, description="Pictures in a row of the contact sheet [-].")
    rows: int = Field(2, ge=1, le=20, description="Rows of the contact sheet [-].")
    sheet_width_px: int = Field(1600, ge=200, le=8000, description="Width of the contact sheet [px].")
    title: str | None = Field(
        None, description="Title of the contact sheet; null for pipeline and robot [-]."
    )

    @field_validator("size_px")
    @classmethod
    def _sensible(cls, size: tuple[int, int]) -> tuple[int, int]:
        if any(n % 2 or not 64 <= n <= _LARGEST_PX for n in size):
            raise ValueError("width and height must be even numbers from 64 to 4096")
        return size


class Video(RecordedSink[VideoConfig]):
    """Renders human and robot into a .gif or .mp4 and a contact sheet (.png), without a display."""

    name = "video"

    def open(self, run: RunInfo) -> None:
        """Check that pictures can be rendered and written before the robot moves.

        Raises:
            SinkError: No off-screen rendering, no mp4 encoder, or no such folder.
        """
        from imitor.visual.offscreen import check_rendering

        super().open(run)
        self._stem = self.folder_of(Path(self.config.path))
        if self.config.format == "mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
            raise SinkError(
                "sink 'video': an mp4 needs the package imageio[ffmpeg]; "
                "pip install 'imageio[ffmpeg]', or choose format: gif"
            )
        check_rendering()

    def save(self) -> SinkReport:
        """Render the video and the contact sheet."""
        from imitor.visual.clip import rows_at
        from imitor.visual.studio import Studio

        c, motion = self.config, self.recorder.motion()
        rows = rows_at(motion.time_s, c.fps, c.begin_s, c.end_s)
        if c.format == "gif" and len(rows) > GIF_LIMIT:
            log.warning(
                "video: a .gif of %d pictures is too large, it ends after %.0f s; "
                "choose begin_s and end_s, a lower fps, or format: mp4", len(rows), GIF_LIMIT / c.fps,
            )  # fmt: skip
            rows = rows[:GIF_LIMIT]
        studio = Studio(
            self.run.robot, motion, self.recorder.reference(), rows,
            size=c.size_px, beside=c.layout == "beside", balance=c.balance, shadows=c.shadows,
            environment=self.run.environment,
        )  # fmt: skip
        try:
            report = SinkReport()
            if c.format != "none":
                report.files.append(self._video(studio))
            if c.sheet:
                report.files.append(self._sheet(studio))
        finally:
            studio.close()
        return report

    def _video(self, studio: Any) -> Path:
        path = self._stem.with_name(f"{self._stem.name}.{self.config.format}")
        write = _write_gif if self.config.format == "gif" else _write_mp4
        with writing(path) as temporary:
            write(temporary, studio)
        return path

    def _sheet(self, studio: Any) -> Path:
        from imitor.visual.sheet import contact_sheet, tile_size

        c = self.config
        count = min(c.columns * c.rows, len(studio))
        columns = min(c.columns, count)
        width, height = tile_size(c.size_px, columns, c.sheet_width_px)
        scale = min(_SUPERSAMPLING, _LARGEST_PX / max(width, height))
        studio.resize((int(scale * width), int(scale * height)))
        chosen = np.linspace(0, len(studio) - 1, count).round().astype(int).tolist()
        title = c.title
        if title is None:
            title = "  ·  ".join(t for t in (self.run.pipeline_name, self.run.robot.card.title) if t)
        pictures, times = [studio.picture(i) for i in chosen], [float(studio.time_s[i]) for i in chosen]
        sheet = contact_sheet(pictures, times, title, columns, c.sheet_width_px)
        path = self._stem.with_name(f"{self._stem.name}.png")
        with writing(path) as temporary:
            sheet.save(temporary)
        return path


def _reported(studio: Any) -> Iterator[Picture]:
    """Yield all pictures and say now and then how many are done."""
    last = time.monotonic()
    for i in range(len(studio)):
        yield studio.picture(i)
        if time.monotonic() - last > _REPORT_EVERY_S:
            last = time.monotonic()
            log.info("video: %d of %d pictures", i + 1, len(studio))


def _write_gif(path: Path, studio: Any) -> None:
    """Write a .gif with one palette for all pictures, so that still parts stay still and cost nothing."""
    from PIL import Image

    from imitor.visual.palette import palette_of

    samples = [studio.picture(i) for i in sorted({0, len(studio) // 2, len(studio) - 1})]
    palette = palette_of(Image.fromarray(np.concatenate(samples)))

    def reduced(picture: Picture) -> Any:
        return Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)

    stream = _reported(studio)
    # a .gif counts in hundredths of a second: rounded ends of pictures, not rounded lengths, keep the pace
    ends = np.append(studio.time_s[1:], studio.time_s[-1] + _step_s(studio)) - studio.time_s[0]
    durations_ms = 10 * np.diff(np.round(100.0 * ends), prepend=0.0).astype(int)
    reduced(next(stream)).save(
        path,
        save_all=True,
        append_images=(reduced(p) for p in stream),
        duration=durations_ms.tolist(),
        loop=0,
        optimize=False,
    )


def _step_s(studio: Any) -> float:
    """Return the mean time from picture to picture [s]."""
    times = studio.time_s
    return float(times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 1.0


def _write_mp4(path: Path, studio: Any) -> None:
    """Write an .mp4 (H.264)."""
    import imageio

    with imageio.get_writer(
        path, format="FFMPEG", mode="I", fps=1.0 / _step_s(studio), quality=8, macro_block_size=2
    ) as writer:
        for picture in _reported(studio):
            writer.append_data(picture)


@hookimpl
def imitor_components() -> list[type[Video]]:
    """Register the sink."""
    return [Video]
