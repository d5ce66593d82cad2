"""Options that all sources of recorded motions have."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from imitor.kinds import Config


class TakeConfig(Config):
    """Which part of a file is read, and who is in it."""

    path: str = Field(description="The file.")
    start_s: float = Field(
        default=0.0, ge=0.0, description="Where to begin, from the first frame of the motion [s]."
    )
    stop_s: float | None = Field(
        default=None, ge=0.0, description="Where to end, from the first frame of the motion [s]."
    )
    mass_kg: float = Field(default=70.0, gt=0.0, description="Mass of the person [kg].")
    sex: Literal["male", "female"] = Field(
        default="male", description="Sex of the person, for the mass model."
    )


class RecordingConfig(TakeConfig):
    """Of files in which the floor may be known."""

    floor: Literal["auto", "file"] | float = Field(
        default="auto",
        description="Floor: auto (from the standing feet), file (its zero) or its height in the file [m].",
    )


__all__ = ["RecordingConfig", "TakeConfig"]
