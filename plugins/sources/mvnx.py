"""The source of Xsens MVNX files."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from imitor import hookimpl
from imitor.motion.clip import Clip
from imitor.motion.mvnx_file import read_mvnx
from imitor.motion.mvnx_recording import MvnxOptions, make_mvnx_recording
from imitor.motion.recorded_source import RecordedSource
from imitor.motion.recording_options import RecordingConfig


class MvnxConfig(RecordingConfig):
    """Options of the MVNX source."""

    path: str = Field(description="The MVNX file.")
    legs: Literal["auto", "recorded", "unknown"] = Field(
        default="auto",
        description="Legs: recorded, unknown (knees and feet are lost), or auto: unknown where the file is an "
        "upper-body recording, whose legs are frozen to the pelvis.",
    )
    height_m: float | None = Field(
        default=None, gt=0.0, description="Stature of the person; none: that of the T-pose [m]."
    )


class Mvnx(RecordedSource[MvnxConfig]):
    """Reads Xsens MVNX files of versions 3 and 4, with contacts and CoM where the file has them."""

    name = "mvnx"
    extensions = (".mvnx",)
    gives = frozenset({"orientation", "com", "support"})

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell by the name, or for an .xml file by its first bytes."""
        if path.suffix.lower() in cls.extensions:
            return True
        if path.suffix.lower() != ".xml" or not path.is_file():
            return False
        with path.open("rb") as file:
            return b"<mvnx" in file.read(4096)

    def read(self) -> Clip:
        """Read the whole file and bring it into our world.

        Raises:
            SourceError: The file cannot be used; says where and why.
        """
        config = self.config
        options = MvnxOptions(
            floor=config.floor,
            legs=config.legs,
            height_m=config.height_m,
            start_s=config.start_s,
            stop_s=config.stop_s,
            mass_kg=config.mass_kg,
            sex=config.sex,
        )
        return make_mvnx_recording(config.path, read_mvnx(config.path), options)


@hookimpl
def imitor_components() -> list[type[Mvnx]]:
    """Return the components of this module."""
    return [Mvnx]
