"""Marker positions alone on a robot of the person's size, by numerical optimisation: for comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from imitor import Component, hookimpl
from imitor.mapping.marker_mapper import MarkerMapper, MarkerMapperConfig

if TYPE_CHECKING:
    from imitor.mapping.marker_imitation import MarkerImitation


class MarkerFitConfig(MarkerMapperConfig):
    """Options of the fit of markers alone."""

    prior: float = Field(
        0.01,
        ge=0,
        description="Pull towards the calibration pose, for joints that the markers hardly show [m/rad].",
    )


class MarkerFit(MarkerMapper[MarkerFitConfig]):
    """A robot of the person's size follows the positions of the markers alone, numerically [ude2004], T5.

    The algorithm that [tomic2018] is compared with: markers are met better than by `virtual_marker_fit`, hands worse.
    Same     calibration, same markers; derivatives by finite differences, iterated in each frame.
    """

    name = "marker_fit"

    def make(self) -> MarkerImitation:
        """Return the imitation by the numerical fit."""
        from imitor.mapping.marker_imitation import MarkerImitation
        from imitor.mapping.numerical_fit import NumericalFit
        from imitor.mapping.virtual_markers import Weights

        names, pose = self.skeleton.target_names, self.config.pose
        step = NumericalFit(self.config.prior)
        return MarkerImitation(self.robot, names, "prismatic", pose, Weights(), step, 1)


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the mapper."""
    return [MarkerFit]
