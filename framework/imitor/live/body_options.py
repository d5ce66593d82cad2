"""What a user may say about the person whom a live source hears of."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from imitor.live.source import LiveConfig


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


__all__ = ["BodyConfig"]
