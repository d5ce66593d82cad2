"""Surfaces as triangles: simple shapes, mesh files, and fewer triangles where there are too many to see."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imitor.types import Array

Colour4 = tuple[float, float, float, float]
GREY: Final[Colour4] = (0.72, 0.73, 0.75, 1.0)

CELL_M: Final = 0.0025
"""Vertices of a dense mesh in one cube of this size become one [m]; less than a pixel of a video."""
DENSE_FACES: Final = 4000
"""Meshes with more triangles than this are thinned out."""


@dataclass(frozen=True)
class Surface:
    """Triangles of one colour.

    Attributes:
        vertices: shape (V, 3) [m].
        faces: Vertex indices, counter-clockwise seen from outside, shape (F, 3).
        rgba: Red, green, blue, opacity in 0 to 1; ``None`` where the file says nothing.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    rgba: Colour4 | None = None

    def moved(self, transform: Array) -> Surface:
        """Return the surface after an affine transform, shape (4, 4); mirrored triangles are turned round."""
        vertices = self.vertices @ transform[:3, :3].T + transform[:3, 3]
        faces = self.faces[:, ::-1] if np.linalg.det(transform[:3, :3]) < 0 else self.faces
        return Surface(vertices.astype(np.float32), np.ascontiguousarray(faces), self.rgba)


def sphere(radius: float) -> Surface:
    """Return a sphere about the origin."""
    return _from_trimesh(_creation().icosphere(subdivisions=2, radius=radius))


def cylinder(radius: float, length: float) -> Surface:
    """Return a cylinder along z, centred."""
    return _from_trimesh(_creation().cylinder(radius=radius, height=length, sections=24))


def capsule(radius: float, length: float) -> Surface:
    """Return a capsule along z, centred; ``length`` is that of the cylinder between the caps."""
    made = _creation().capsule(height=length, radius=radius, count=(16, 16))
    made.vertices[:, 2] -= 0.5 * (made.vertices[:, 2].min() + made.vertices[:, 2].max())
    return _from_trimesh(made)


def box(size: Sequence[float]) -> Surface:
    """Return a box with these edge lengths, centred."""
    return _from_trimesh(_creation().box(extents=np.asarray(size, dtype=float)))


def capsule_between(a: Array, b: Array, radius: float) -> Surface:
    """Return a capsule from one point to another."""
    axis = np.asarray(b - a, dtype=float)
    length = float(np.linalg.norm(axis))
    z = axis / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, [0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([x, np.cross(z, x), z]), 0.5 * (a + b)
    return capsule(radius, length).moved(T)


def read_mesh(path: Path) -> list[Surface]:
    """Read a mesh file (.stl, .dae, .obj, ...), one surface a colour, in the file's own axes [m].

    COLLADA files that declare y as up are turned to z up, as the URDF's origins expect.

    Raises:
        ValueError: The file cannot be read as a mesh. OSError: It is not there.
    """
    import trimesh

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # readers of mesh formats warn about details that cannot be seen
        try:
            scene = trimesh.load_scene(path)
        except OSError:
            raise
        except Exception as error:  # each format's reader raises its own kinds
            raise ValueError(f"{type(error).__name__}: {error}") from error
    turn = np.eye(4)
    if path.suffix.lower() == ".dae" and b"Y_UP" in path.read_bytes():
        turn[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    out = []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            out.append(_from_trimesh(mesh, _mesh_colour(mesh)).moved(turn @ transform))
    if not out:
        raise ValueError("no triangles in it")
    return merged(out)


def merged(surfaces: Iterable[Surface]) -> list[Surface]:
    """Join the surfaces of equal colour."""
    groups: dict[Colour4 | None, list[Surface]] = {}
    for surface in surfaces:
        groups.setdefault(surface.rgba, []).append(surface)
    out = []
    for rgba, group in groups.items():
        starts = np.cumsum([0, *(len(s.vertices) for s in group)])
        faces = [s.faces + start for s, start in zip(group, starts[:-1], strict=True)]
        out.append(
            Surface(np.concatenate([s.vertices for s in group]), np.concatenate(faces).astype(np.int32), rgba)
        )
    return out


def thinned(surface: Surface, cell_m: float = CELL_M) -> Surface:
    """Return a dense surface with the vertices of each grid cell joined in their mean; others unchanged."""
    if len(surface.faces) <= DENSE_FACES:
        return surface
    keys = np.floor(surface.vertices / cell_m).astype(np.int64)
    _, cell, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)
    vertices = np.zeros((len(count), 3))
    np.add.at(vertices, cell, surface.vertices)
    faces = cell[surface.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = faces[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]]
    return Surface(
        (vertices / count[:, None]).astype(np.float32),
        np.ascontiguousarray(faces, dtype=np.int32),
        surface.rgba,
    )


def _creation() -> Any:
    import trimesh

    return trimesh.creation


def _from_trimesh(mesh: Any, rgba: Colour4 | None = None) -> Surface:
    return Surface(np.array(mesh.vertices, dtype=np.float32), np.array(mesh.faces, dtype=np.int32), rgba)


def _mesh_colour(mesh: Any) -> Colour4 | None:
    visual = mesh.visual
    if not visual.defined:
        return None
    colour = getattr(getattr(visual, "material", visual), "main_color", None)
    if colour is None or len(colour) != 4 or colour[3] == 0:
        return None
    r, g, b, a = (float(c) / 255.0 for c in colour)
    return (r, g, b, a)
