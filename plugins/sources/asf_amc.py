"""The source of Acclaim motions: an AMC file and its ASF skeleton."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from imitor import hookimpl
from imitor.motion.amc_file import find_asf, read_amc
from imitor.motion.clip import Clip
from imitor.motion.kinematics import forward_kinematics
from imitor.motion.recognition import choose_skeleton
from imitor.motion.recorded_source import RecordedSource
from imitor.motion.recording import ReadOptions, make_recording
from imitor.motion.recording_options import RecordingConfig
from imitor.registry import Registry


class AsfAmcConfig(RecordingConfig):
    """Options of the Acclaim source."""

    path: str = Field(description="The AMC file.")
    asf: str | None = Field(
        default=None, description="The ASF file; none: the one beside it whose name the motion's begins with."
    )
    rate_hz: float = Field(
        default=120.0, gt=0.0, le=10000.0, description="Frame rate, which the file does not tell [Hz]."
    )
    skeleton: str = Field(
        default="auto", description="Skeleton card: auto, a card's name or the path of a card's .yaml file."
    )
    up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = Field(
        default="auto", description="Axis of the file that points up: auto or its name."
    )


class AsfAmc(RecordedSource[AsfAmcConfig]):
    """Reads Acclaim motions (AMC) on their skeletons (ASF)."""

    name = "asf_amc"
    extensions = (".amc",)
    gives = frozenset({"orientation"})

    def read(self) -> Clip:
        """Read the whole file and bring it into our world.

        Raises:
            SourceError: A file cannot be used; says where and why.
            SpecError: The skeleton card is wrong.
        """
        c = self.config
        motion = read_amc(c.path, find_asf(c.path, c.asf), c.rate_hz)
        first = forward_kinematics(motion.nodes, motion.motion[:1]).position[0]
        fit = choose_skeleton(c.path, motion.nodes, first, c.skeleton, Registry().cards("skeletons"))
        options = ReadOptions(
            unit="m",
            up=c.up,
            floor=c.floor,
            drop_tpose=False,
            start_s=c.start_s,
            stop_s=c.stop_s,
            mass_kg=c.mass_kg,
            sex=c.sex,
        )
        return make_recording(c.path, motion, fit, options)


@hookimpl
def imitor_components() -> list[type[AsfAmc]]:
    """Return the components of this module."""
    return [AsfAmc]
