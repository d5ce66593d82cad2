"""The source of rigid 6-dof targets in text tables."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from imitor import hookimpl
from imitor.motion.art_file import BODY_17, is_target_table, read_targets
from imitor.motion.clip import Clip
from imitor.motion.recorded_source import RecordedSource
from imitor.motion.recording_options import RecordingConfig
from imitor.motion.target_recording import TargetOptions, check_names, make_target_recording


class ArtTargetsConfig(RecordingConfig):
    """Options of the source of rigid targets."""

    path: str = Field(
        description="The .txt file: x y z and a quaternion x y z w of every target, one frame a line."
    )
    targets: list[str] = Field(
        default=list(BODY_17), description="Names of the 17 targets in the order of the file."
    )
    rate_hz: float = Field(
        default=60.0, gt=0.0, le=10000.0, description="Frame rate, which the file does not tell [Hz]."
    )
    unit: Literal["m", "dm", "cm", "mm", "inch"] = Field(default="mm", description="Length unit of the file.")
    up: Literal["x", "y", "z", "-x", "-y", "-z"] = Field(
        default="z", description="Axis of the file that points up."
    )
    height_m: float | None = Field(
        default=None, gt=0.0, description="Stature of the person; none: from the segments [m]."
    )


class ArtTargets(RecordedSource[ArtTargetsConfig]):
    """Reads tables of 17 rigid 6-dof targets worn on the body."""

    name = "art_targets"
    extensions = (".txt",)
    gives = frozenset({"targets"})

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell from the first line whether the file is a table of targets."""
        return path.suffix.lower() in cls.extensions and path.is_file() and is_target_table(path)

    def read(self) -> Clip:
        """Read the whole file and bring it into our world.

        Raises:
            SourceError: The file cannot be used; says where and why.
        """
        c = self.config
        check_names(c.path, c.targets)
        options = TargetOptions(
            rate_hz=c.rate_hz,
            unit=c.unit,
            up=c.up,
            floor=c.floor,
            height_m=c.height_m,
            start_s=c.start_s,
            stop_s=c.stop_s,
            mass_kg=c.mass_kg,
            sex=c.sex,
        )
        return make_target_recording(c.path, read_targets(c.path, len(c.targets)), c.targets, options)


@hookimpl
def imitor_components() -> list[type[ArtTargets]]:
    """Return the components of this module."""
    return [ArtTargets]
