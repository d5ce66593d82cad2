"""What a user may say about the person whom a live source hears of."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field

from imitor.live.source import LiveConfig
from imitor.types import Skeleton


class BodyConfig(LiveConfig):
    """Where to listen, and what is known of the person."""

    floor: Literal["auto", "sender"] | float = Field(
        "auto",
        description="Floor: auto (from the standing feet at the start), sender (its zero) or its height there [m].",
    )
    height_m: float | None = Field(
        None, gt=0.0, le=3.0, description="Stature of the person; none: from what is received [m]."
    )
    mass_kg: float = Field(70.0, gt=0.0, description="Mass of the person [kg].")
    sex: Literal["male", "female"] = Field("male", description="Sex of the person, for the mass model.")

    @property
    def recorded_floor(self) -> str | float:
        """The floor in the words of recordings: auto, file or its height [m]."""
        return "file" if self.floor == "sender" else self.floor


def as_received(skeleton: Skeleton) -> Skeleton:
    """Return a skeleton that was learned as that of a recording, with notes that speak of the sender."""
    words = (
        ("of the file", "of the sender"),
        ("the file's", "the sender's"),
        ("in the recording", "in its world"),
    )
    notes = list(skeleton.notes)
    for old, new in words:
        notes = [note.replace(old, new) for note in notes]
    return replace(skeleton, notes=tuple(notes))


class AxesConfig(BodyConfig):
    """The same for protocols that do not say which of their axes points up."""

    up: Literal["x", "y", "z", "-x", "-y", "-z"] = Field(
        "z", description="Axis of the sender's world that points up."
    )


__all__ = ["AxesConfig", "BodyConfig", "as_received"]
