"""Segment scaling: the human's directions with the robot's lengths, standing where the robot's feet stand."""

from __future__ import annotations

from typing import Any

from imitor import Component, hookimpl
from imitor.mapping.scaling_mapper import ScalingMapper


class SegmentScaling(ScalingMapper):
    """Each segment keeps the human's direction and takes the robot's length [pennapoubel2014] eq. 1, P1 to P6.

    Works from the points of each single frame; no calibration of the actor. Declares the directions of the nine main
    segments, positions of hands and head, orientations of waist and chest, the CoM and the standing posture. Of a foot
    that stands, the pose (`left_foot`); of a free one, the ankle's position (`left_ankle`), as in table I of the
    paper, and where it would like to point (`left_sole`).
    """

    name = "segment_scaling"


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the mapper."""
    return [SegmentScaling]
