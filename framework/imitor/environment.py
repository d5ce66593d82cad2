"""Objects around the robot: boxes, cylinders and meshes, and what of them slides as a drawer does.

```yaml
environment:
  - {name: table, shape: box, size_m: [0.6, 1.2, 0.04], position_m: [0.5, 0.0, 0.74]}
  - {name: pole, shape: cylinder, radius_m: 0.04, length_m: 2.0, position_m: [0.2, 0.5, 1.0]}
  - {name: chair, shape: mesh, path: chair.stl, scale: 0.001, rpy_rad: [0.0, 0.0, 1.57]}
  - name: drawer
    shape: box
    size_m: [0.3, 0.5, 0.1]
    position_m: [0.7, 0.0, 0.7]
    slide: {axis: [-1.0, 0.0, 0.0], range_m: 0.25, mass_kg: 2.0, friction_n: 3.0}
  - {name: handle, part_of: drawer, graspable: true, shape: box, size_m: [0.02, 0.3, 0.02], position_m: [0.5, 0.0, 0.7]}
```
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from imitor.types import Array

OBJECT_COLOUR: Final = (0.80, 0.66, 0.47, 1.0)
"""Red, green, blue and opacity with which objects are drawn."""

Length = Annotated[float, Field(gt=0, le=100)]
Coordinate = Annotated[float, Field(ge=-1000, le=1000)]
Point3 = tuple[Coordinate, Coordinate, Coordinate]
Point4 = tuple[float, float, float, float]


class Slide(BaseModel):
    """How an object can be pulled out along a line, and what resists."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    axis: Point3 = Field(
        description="Direction in which it opens, in world; its length is of no account [-]."
    )
    range_m: Length = Field(description="How far it opens; closed it is where it is written [m].")
    mass_kg: float = Field(2.0, gt=0, le=1000, description="Mass of all that moves [kg].")
    friction_n: float = Field(2.0, ge=0, le=1000, description="Force that it takes to move it at all [N].")
    damping_n_s_m: float = Field(5.0, ge=0, le=10000, description="Resistance by speed [N s/m].")

    @model_validator(mode="after")
    def _has_a_direction(self) -> Slide:
        if not any(self.axis):
            raise ValueError("its axis has no direction; [-1, 0, 0] opens towards a robot that faces x")
        return self

    def direction(self) -> Array:
        """Return the unit vector in which it opens, in world, shape (3,)."""
        axis = np.array(self.axis)
        return np.asarray(axis / np.linalg.norm(axis))


class _Object(BaseModel):
    """What every object has."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str = Field(
        min_length=1, pattern=r"^[^.]*$", description="Name of the object, unique, without dots."
    )
    position_m: Point3 = Field((0.0, 0.0, 0.0), description="Where its origin is in world [m].")
    rpy_rad: Point3 | None = Field(
        None, description="Rotations about the world's x, then y, then z [rad]; default none."
    )
    quaternion_wxyz: Point4 | None = Field(
        None, description="Its rotation, world from object, in place of rpy_rad [-]."
    )
    slide: Slide | None = Field(None, description="How it can be pulled out; none: it stands still.")
    part_of: str | None = Field(None, description="Name of the sliding object that it moves with.")
    only_with: str | None = Field(
        None,
        description="Name of the source in whose place it stands: with another source it is left out, and so is what "
        "is part of it; none: it is there whatever the source.",
    )
    graspable: bool = Field(
        False,
        description="Whether hands may touch it; the rest of the robot keeps off as from any other [-].",
    )

    @model_validator(mode="after")
    def _one_rotation(self) -> _Object:
        if self.rpy_rad is not None and self.quaternion_wxyz is not None:
            raise ValueError("its rotation is given twice; leave out rpy_rad or quaternion_wxyz")
        if self.quaternion_wxyz is not None and not 0.99 < np.linalg.norm(self.quaternion_wxyz) < 1.01:
            raise ValueError("the length of quaternion_wxyz should be 1; no rotation is [1, 0, 0, 0]")
        return self

    def placement(self) -> Array:
        """Return its frame in world, (4, 4)."""
        T = np.eye(4)
        T[:3, 3] = self.position_m
        if self.rpy_rad is not None:
            T[:3, :3] = rotation(self.rpy_rad)
        if self.quaternion_wxyz is not None:
            w, x, y, z = np.array(self.quaternion_wxyz) / np.linalg.norm(self.quaternion_wxyz)
            T[:3, :3] = [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        return T


def rotation(rpy_rad: Sequence[float]) -> Array:
    """Return the rotation about the world's x, then y, then z [rad], shape (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy_rad), np.sin(rpy_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


class Box(_Object):
    """A box; its origin is in its middle."""

    shape: Literal["box"]
    size_m: tuple[Length, Length, Length] = Field(description="Its sides along its x, y and z [m].")


class Cylinder(_Object):
    """A cylinder along its z axis; its origin is in its middle."""

    shape: Literal["cylinder"]
    radius_m: Length = Field(description="Its radius [m].")
    length_m: Length = Field(description="Its length [m].")


class Mesh(_Object):
    """A mesh file; its convex hull is what can be touched."""

    shape: Literal["mesh"]
    path: Path = Field(description="File: .stl, .obj, .ply or .dae; relative to the pipeline's file.")
    scale: Length = Field(1.0, description="Length of the file's unit [m].")


Obstacle = Annotated[Box | Cylinder | Mesh, Field(discriminator="shape")]
_ALL: Final = TypeAdapter(list[Obstacle])


def read_environment(environment: Sequence[Mapping[str, Any]]) -> list[Box | Cylinder | Mesh]:
    """Return the objects of a pipeline's ``environment``.

    Raises:
        pydantic.ValidationError: An entry is wrong; a loaded pipeline has none of these.
    """
    return _ALL.validate_python([dict(entry) for entry in environment])


def standing_with(source: str, items: Sequence[Box | Cylinder | Mesh]) -> list[bool]:
    """Return for each object whether it is there with a source of this name."""
    elsewhere = {item.name for item in items if item.only_with not in (None, source)}
    return [item.name not in elsewhere and item.part_of not in elsewhere for item in items]


def carriers(items: Sequence[Box | Cylinder | Mesh]) -> list[int]:
    """Return for each object the number of the sliding one it moves with, perhaps itself; -1 if it stands still."""
    sliding = {item.name: k for k, item in enumerate(items) if item.slide is not None}
    return [sliding.get(item.name if item.part_of is None else item.part_of, -1) for item in items]


def triangles(item: Box | Cylinder | Mesh) -> tuple[Array, Any]:
    """Return the surface of an object where it is written, in world: vertices (V, 3) [m] and faces (F, 3).

    Raises:
        ValueError: A mesh file cannot be read; the message says why.
    """
    from imitor.visual import shapes

    if isinstance(item, Box):
        surface = shapes.box(item.size_m)
    elif isinstance(item, Cylinder):
        surface = shapes.cylinder(item.radius_m, item.length_m)
    else:
        try:
            parts = shapes.read_mesh(item.path)
        except (OSError, ValueError) as error:
            raise ValueError(f"the mesh {item.path} of '{item.name}' cannot be read: {error}") from None
        starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
        surface = shapes.Surface(
            np.float32(item.scale) * np.concatenate([p.vertices for p in parts]),
            np.concatenate([p.faces + s for p, s in zip(parts, starts[:-1], strict=True)]),
        )
    T = item.placement()
    return surface.vertices @ T[:3, :3].T + T[:3, 3], surface.faces
