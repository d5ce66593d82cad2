"""Options of stabilizers that lift feet and put them down elsewhere."""

from __future__ import annotations

from pydantic import Field

from imitor.kinds import Config


class StepConfig(Config):
    """How a foot that is off the ground moves."""

    lift_m: float = Field(
        0.03,
        gt=0,
        description="Height to which a foot goes straight up before it follows the human's; rho of "
        "[pennapoubel2014] [m].",
    )
    clearance_m: float = Field(
        0.02, ge=0, description="Least height of a free sole's lowest corner over the floor [m]."
    )
    foot_speed_m_s: float = Field(0.3, gt=0, description="Largest speed of a free foot's target [m/s].")
    foot_acceleration_m_s2: float = Field(
        1.0, gt=0, description="Largest acceleration of a free foot's target [m/s^2]."
    )
    foot_turn_rad_s: float = Field(
        2.0, gt=0, description="How fast a free foot is turned flat before it is lowered [rad/s]."
    )
    patience_s: float = Field(
        1.0,
        ge=0,
        description="How long a foot tries to get over its landing place before it goes straight down [s].",
    )


__all__ = ["StepConfig"]
