"""The robot's motion as text: one line a frame, names and units in the first."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydantic import Field

from imitor import Config, RunInfo, SinkReport, hookimpl
from imitor.record import Motion
from imitor.recorded_sink import RecordedSink, writing


class CsvConfig(Config):
    """The file and how it is written."""

    path: str = Field("motion.csv", description="File in the run directory [-].")
    precision: int = Field(6, ge=1, le=17, description="Digits after the decimal point [-].")
    comment: bool = Field(
        False,
        description="Whether a first line, after a #, says which robot and pipeline the motion is of [-].",
    )


class CsvFile(RecordedSink[CsvConfig]):
    """Writes the motion as a table of comma separated values."""

    name = "csv"

    def open(self, run: RunInfo) -> None:
        """Check the folder."""
        super().open(run)
        self._path = self.folder_of(Path(self.config.path))

    def save(self) -> SinkReport:
        """Write the table."""
        motion = self.recorder.motion()
        with writing(self._path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
            if self.config.comment:
                stream.write(
                    f"# robot {motion.robot}, pipeline {self.run.pipeline_name}\n".replace("\r", " ")
                )
            stream.write(self._header(motion))
            stream.writelines(_lines(motion, self.config.precision))
        return SinkReport([self._path])

    def _header(self, motion: Motion) -> str:
        model = self.run.robot.model
        joints = []
        for name in motion.joint_names:
            linear = model.joints[model.getJointId(name)].shortname().startswith("JointModelP")
            joints.append(f"{name}_{'m' if linear else 'rad'}")
        base = ["root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz"]
        out = io.StringIO()
        names = ["time_s", *base, *joints, "contact_left", "contact_right", "status"]
        csv.writer(out, lineterminator="\n").writerow(names)
        return out.getvalue()


def _lines(motion: Motion, precision: int) -> Iterator[str]:
    """Yield the lines of the table."""
    numbers = np.column_stack(
        [motion.time_s, motion.root_position_m, motion.root_quaternion_wxyz, motion.joint_position_rad]
    )
    line = ",".join([f"%.{precision}f"] * numbers.shape[1] + ["%d", "%d", "%s\n"])
    rows = zip(numbers.tolist(), motion.contact.tolist(), motion.status, strict=True)
    for values, (left, right), status in rows:
        yield line % (*values, left, right, status)


@hookimpl
def imitor_components() -> list[type[CsvFile]]:
    """Register the sink."""
    return [CsvFile]
