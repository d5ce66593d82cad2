"""Objects around the robot as solids in world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from imitor.collision import solids
from imitor.collision.solids import Part
from imitor.environment import Box, Cylinder, read_environment, triangles

_WORLD = 0


def obstacles(environment: Sequence[Mapping[str, Any]]) -> list[Part]:
    """Return the objects of a pipeline's ``environment`` where they are written, meshes as their convex hulls.

    Raises:
        ValueError: A mesh cannot be read or has no volume; the message says which.
    """
    parts = []
    for item in read_environment(environment):
        if isinstance(item, Box):
            part = solids.box(item.name, _WORLD, item.placement(), np.array(item.size_m))
        elif isinstance(item, Cylinder):
            part = solids.cylinder(item.name, _WORLD, item.placement(), item.radius_m, item.length_m)
        else:
            corners = triangles(item)[0].astype(float)
            try:
                part = solids.hull_of(corners).part(item.name, _WORLD, np.eye(4))
            except ValueError as error:
                raise ValueError(f"the mesh {item.path} of '{item.name}' cannot be used: {error}") from None
        parts.append(part)
    return parts


def graspable(environment: Sequence[Mapping[str, Any]]) -> frozenset[str]:
    """Return the names of the objects that hands may touch."""
    return frozenset(item.name for item in read_environment(environment) if item.graspable)
