"""Markers and joints on a robot of the person's size, by analytic steps, hands first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from imitor import Component, hookimpl
from imitor.mapping.marker_mapper import MarkerMapper, MarkerMapperConfig

if TYPE_CHECKING:
    from imitor.mapping.marker_imitation import MarkerImitation


class VirtualMarkerFitConfig(MarkerMapperConfig):
    """Options of the fit of virtual markers."""

    alpha: float = Field(1.0, ge=0, description="Weight of the positions of the markers [-].")
    beta: float = Field(2.0, ge=0, description="Weight of the positions of shoulders and elbows [-].")
    gamma: float = Field(10.0, ge=0, description="Weight of the orientations of the hands' markers [-].")
    delta: float = Field(20.0, ge=0, description="Weight of the positions of the hand joints [-].")
    steps: int = Field(1, ge=1, le=50, description="Steps from the last frame's solution [-].")
    trunk: Literal["prismatic", "free"] = Field(
        "prismatic",
        description="What stands for the legs: prismatic, three shifts of the trunk; free, it turns as well.",
    )


class VirtualMarkerFit(MarkerMapper[VirtualMarkerFitConfig]):
    """A robot of the person's size follows markers and joints, the hands most exactly [tomic2018] section 3, T1 to T4.

    In the calibration pose the robot is scaled to the person and virtual markers are attached where the real ones are.
    Then one step a frame of eq. 11 minimises the criterion of eqs. 7 to 9. Put behind it `contact_transition`:
    they are the person's, out of reach of a robot of another size.
    """

    name = "virtual_marker_fit"

    def make(self) -> MarkerImitation:
        """Return the imitation by the analytic step."""
        from imitor.mapping.marker_imitation import MarkerImitation, analytic_step
        from imitor.mapping.virtual_markers import Weights

        c = self.config
        weights = Weights(c.alpha, c.beta, c.gamma, c.delta)
        names = self.skeleton.target_names
        return MarkerImitation(self.robot, names, c.trunk, c.pose, weights, analytic_step, c.steps)


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the mapper."""
    return [VirtualMarkerFit]
