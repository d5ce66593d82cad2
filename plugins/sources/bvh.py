"""The source of BVH files."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from imitor import hookimpl
from imitor.motion.bvh_file import read_bvh
from imitor.motion.clip import Clip
from imitor.motion.kinematics import forward_kinematics
from imitor.motion.recognition import choose_skeleton
from imitor.motion.recorded_source import RecordedSource
from imitor.motion.recording import ReadOptions, make_recording
from imitor.motion.recording_options import RecordingConfig
from imitor.registry import Registry


class BvhConfig(RecordingConfig):
    """Options of the BVH source."""

    path: str = Field(description="The BVH file.")
    skeleton: str = Field(
        default="auto", description="Skeleton card: auto, a card's name or the path of a card's .yaml file."
    )
    unit: Literal["auto", "m", "dm", "cm", "mm", "inch", "cmu"] | Annotated[float, Field(gt=0.0)] = Field(
        default="auto",
        description="Length unit of the file: auto, a name (cmu is 1/0.45 inch) or its length [m].",
    )
    up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = Field(
        default="auto", description="Axis of the file that points up: auto or its name."
    )
    height_m: float | None = Field(
        default=None,
        gt=0.0,
        description="Stature of the person, to choose the unit or scale a file of unknown unit [m].",
    )
    drop_tpose: Literal["auto"] | bool = Field(
        default="auto",
        description="Whether the first frame is an added T-pose and no motion: auto, true or false.",
    )


class Bvh(RecordedSource[BvhConfig]):
    """Reads BVH files of any skeleton that a card describes."""

    name = "bvh"
    extensions = (".bvh",)
    gives = frozenset({"orientation"})

    def read(self) -> Clip:
        """Read the whole file and bring it into our world.

        Raises:
            SourceError: The file cannot be used; says where and why.
            SpecError: The skeleton card is wrong.
        """
        config = self.config
        bvh = read_bvh(config.path)
        first = forward_kinematics(bvh.nodes, bvh.motion[:1]).position[0]
        cards = Registry().cards("skeletons")
        fit = choose_skeleton(config.path, bvh.nodes, first, config.skeleton, cards)
        options = ReadOptions(
            unit=config.unit,
            up=config.up,
            height_m=config.height_m,
            floor=config.floor,
            drop_tpose=None if config.drop_tpose == "auto" else config.drop_tpose,
            start_s=config.start_s,
            stop_s=config.stop_s,
            mass_kg=config.mass_kg,
            sex=config.sex,
        )
        return make_recording(config.path, bvh, fit, options)


@hookimpl
def imitor_components() -> list[type[Bvh]]:
    """Return the components of this module."""
    return [Bvh]
