"""The record of a run as numpy archives: ``motion.npz`` and ``reference.npz``."""

from __future__ import annotations

from pydantic import Field

from imitor import Config, SinkReport, hookimpl
from imitor.record import MOTION_FILE, REFERENCE_FILE
from imitor.recorded_sink import RecordedSink, refusals


class MotionFileConfig(Config):
    """Which of the two files are written."""

    reference: bool = Field(
        True,
        description="Whether reference.npz (the human and the targets) is written beside motion.npz [-].",
    )


class MotionFile(RecordedSink[MotionFileConfig]):
    """Writes motion.npz (what the robot was told) and reference.npz (what it was meant to do)."""

    name = "motion_file"

    def save(self) -> SinkReport:
        """Write the archives."""
        report = SinkReport()
        motion = self.run.out_dir / MOTION_FILE
        with refusals(motion):
            self.recorder.motion().save(motion)
        report.files.append(motion)
        if self.config.reference:
            reference = self.run.out_dir / REFERENCE_FILE
            with refusals(reference):
                self.recorder.reference().save(reference)
            report.files.append(reference)
        return report


@hookimpl
def imitor_components() -> list[type[MotionFile]]:
    """Register the sink."""
    return [MotionFile]
