"""The source of depth-camera skeletons in text tables."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from imitor import hookimpl
from imitor.motion.clip import Clip
from imitor.motion.kinect_file import read_capture, recognise
from imitor.motion.kinect_recording import KinectOptions, make_kinect_recording
from imitor.motion.kinect_timing import Timing
from imitor.motion.recorded_source import RecordedSource
from imitor.motion.recording_options import TakeConfig


class KinectConfig(TakeConfig):
    """Options of the Kinect source."""

    path: str = Field(description="The .csv or .txt file of skeleton points.")
    angles_path: str | None = Field(
        default=None,
        description="Table of joint angles of a file of 22 offsets; none: the one named alike beside it.",
    )
    points: Literal["all", 15] = Field(
        default="all", description="Which points to give: all, or 15, the OpenNI set derived from 20 or 25."
    )
    min_confidence: float = Field(
        default=0.5,
        ge=0.0,
        le=1.0,
        description="Points below this are lost: tracked is 1, inferred 0.5; 1 refuses inferred points [-].",
    )
    unit: Literal["auto", "m", "cm", "mm"] = Field(
        default="auto", description="Length unit of the file: auto (from the body's size) or its name."
    )
    height_m: float | None = Field(
        default=None, gt=0.0, description="Stature of the person; none: from the segments [m]."
    )
    rate_hz: float | None = Field(
        default=None,
        gt=0.0,
        description="Frame rate; none: from the time stamps, or 30 where the file has none [Hz].",
    )
    resample: bool = Field(
        default=True,
        description="Whether frames with uneven time stamps are interpolated to an even rate, or taken as even.",
    )
    longest_gap_s: float = Field(
        default=0.2, gt=0.0, description="Between stamps further apart than this the points are lost [s]."
    )
    tilt_rad: Literal["auto"] | float = Field(
        default="auto",
        description="How far the sensor looks down: auto (from the balance of who stands) or the angle [rad].",
    )
    floor: Literal["auto"] | float = Field(
        default="auto",
        description="Floor: auto (from the standing feet) or its height in the sensor's levelled axes, e.g. -0.9 [m].",
    )
    sides: Literal["check", "keep", "swap", "mirror"] = Field(
        default="check",
        description="Left and right: check (refuse a mirrored body), keep, swap (exchange the names) or mirror "
        "(turn a mirrored picture round).",
    )


class Kinect(RecordedSource[KinectConfig]):
    """Reads tables of Kinect or OpenNI skeletons: 15, 20 or 25 points, and 22 joints of offsets and angles."""

    name = "kinect"
    extensions = (".csv", ".txt")

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell from the first lines whether the file is a table of skeleton points."""
        return path.suffix.lower() in cls.extensions and path.is_file() and recognise(path)

    def read(self) -> Clip:
        """Read the whole file and bring it into our world.

        Raises:
            SourceError: The file cannot be used; says where and why.
        """
        config = self.config
        options = KinectOptions(
            fifteen=config.points == 15,
            min_confidence=config.min_confidence,
            unit=config.unit,
            height_m=config.height_m,
            timing=Timing(config.rate_hz, config.resample, config.longest_gap_s),
            tilt_rad=None if config.tilt_rad == "auto" else config.tilt_rad,
            floor_m=None if config.floor == "auto" else config.floor,
            sides=config.sides,
            start_s=config.start_s,
            stop_s=config.stop_s,
            mass_kg=config.mass_kg,
            sex=config.sex,
        )
        capture = read_capture(config.path, config.angles_path)
        return make_kinect_recording(config.path, capture, options)


@hookimpl
def imitor_components() -> list[type[Kinect]]:
    """Return the components of this module."""
    return [Kinect]
