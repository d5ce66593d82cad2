"""The base of sources of optical markers: they differ in how a file is read."""

from __future__ import annotations

from typing import Literal, TypeVar

from pydantic import Field

from imitor.motion.clip import Clip
from imitor.motion.marker_file import MarkerFile
from imitor.motion.marker_recording import MarkerOptions, make_marker_recording
from imitor.motion.marker_sets import choose_marker_set
from imitor.motion.recorded_source import RecordedSource
from imitor.motion.recording_options import RecordingConfig
from imitor.registry import Registry


class MarkerConfig(RecordingConfig):
    """Options of a source of optical markers."""

    marker_set: str = Field(
        default="auto", description="Marker set: auto, a card's name or the path of a card's .yaml file."
    )
    subject: str = Field(default="", description="The subject to take of a file with several, by its prefix.")
    unit: Literal["auto", "m", "dm", "cm", "mm", "inch"] = Field(
        default="auto",
        description="Length unit of the file: auto (as written, else by the size) or its name.",
    )
    up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = Field(
        default="auto",
        description="Axis of the file that points up: auto (as written, else by the body) or its name.",
    )
    height_m: float | None = Field(
        default=None, gt=0.0, description="Stature of the person; none: from the segments [m]."
    )


C = TypeVar("C", bound=MarkerConfig)


class MarkerSource(RecordedSource[C]):
    """Reads optical markers and finds the joint centres under them."""

    def read_file(self, path: str) -> MarkerFile:
        """Read the file.

        Raises:
            SourceError: The file cannot be used; says where and why.
        """
        raise NotImplementedError

    def read(self) -> Clip:
        """Read the whole file and bring it into our world."""
        c = self.config
        file = self.read_file(c.path)
        fit = choose_marker_set(c.path, file.labels, c.marker_set, c.subject, Registry().cards("markersets"))
        options = MarkerOptions(
            unit=c.unit,
            up=c.up,
            floor=c.floor,
            height_m=c.height_m,
            start_s=c.start_s,
            stop_s=c.stop_s,
            mass_kg=c.mass_kg,
            sex=c.sex,
        )
        return make_marker_recording(c.path, file, fit, options)
