"""The visual elements of a URDF: where each shape sits on its link and what it looks like."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imitor.errors import RobotError
from imitor.robot.files import ModelFiles
from imitor.types import Array
from imitor.visual import shapes
from imitor.visual.shapes import Colour4, Surface


@dataclass(frozen=True)
class Visual:
    """One ``<visual>``.

    Attributes:
        link: Its link.
        origin: Link from shape, shape (4, 4).
        form: ``box``, ``sphere``, ``cylinder``, ``capsule`` or ``mesh``.
        size: Its dimensions as the URDF gives them [m]; of a mesh the scale [-].
        mesh: The mesh file; ``None`` for other forms, or where the file cannot be found.
        mesh_name: The mesh as the URDF names it.
        rgba: The colour, where the URDF gives one.
    """

    link: str
    origin: Array
    form: str
    size: tuple[float, ...]
    mesh: Path | None = None
    mesh_name: str = ""
    rgba: Colour4 | None = None

    @property
    def missing(self) -> bool:
        """Whether it is a mesh without file."""
        return self.form == "mesh" and self.mesh is None

    def surfaces(self) -> list[Surface]:
        """Return its surfaces in the link's frame.

        Raises:
            ValueError: The mesh cannot be read. OSError: It is not there.
        """
        transform = self.origin
        if self.form == "mesh":
            if self.mesh is None:
                raise FileNotFoundError(self.mesh_name)
            made = shapes.read_mesh(self.mesh)
            transform = self.origin @ np.diag([*self.size, 1.0])
        elif self.form == "box":
            made = [shapes.box(self.size)]
        elif self.form == "sphere":
            made = [shapes.sphere(self.size[0])]
        else:
            made = [getattr(shapes, self.form)(*self.size)]
        return [Surface(m.vertices, m.faces, self.rgba or m.rgba).moved(transform) for m in made]


def read_visuals(files: ModelFiles) -> list[Visual]:
    """Return the visual elements of a URDF file.

    Raises:
        RobotError: The file is not XML.
    """
    try:
        root = ET.parse(files.model).getroot()
    except ET.ParseError as error:
        raise RobotError(f"{files.model}: not well-formed XML: {error}") from None
    named = {m.get("name", ""): colour for m in root.iter("material") if (colour := _rgba(m)) is not None}
    return [
        visual
        for link in root.findall("link")
        for element in link.findall("visual")
        for visual in _visual(link.get("name", ""), element, named, files)
    ]


def _visual(link: str, element: ET.Element, named: dict[str, Colour4], files: ModelFiles) -> Iterator[Visual]:
    geometry = element.find("geometry")
    material = element.find("material")
    rgba = None
    if material is not None:
        rgba = _rgba(material) or named.get(material.get("name", ""))
    origin = _origin(element.find("origin"))
    for shape in geometry if geometry is not None else ():
        if shape.tag == "mesh":
            name = shape.get("filename", "")
            scale = _numbers(shape.get("scale"), (1.0, 1.0, 1.0))
            yield Visual(link, origin, "mesh", scale, find_mesh(name, files), name, rgba)
        elif shape.tag == "box":
            yield Visual(link, origin, "box", _numbers(shape.get("size"), (0.1, 0.1, 0.1)), rgba=rgba)
        elif shape.tag == "sphere":
            yield Visual(link, origin, "sphere", _numbers(shape.get("radius"), (0.05,)), rgba=rgba)
        elif shape.tag in ("cylinder", "capsule"):
            size = (*_numbers(shape.get("radius"), (0.05,)), *_numbers(shape.get("length"), (0.1,)))
            yield Visual(link, origin, shape.tag, size, rgba=rgba)


def find_mesh(name: str, files: ModelFiles) -> Path | None:
    """Return the file of a mesh in a URDF: ``package://``, ``file://``, absolute, or beside the model.

    Packages are looked for where the model comes from, above the model, and in ``ROS_PACKAGE_PATH``.
    """
    if name.startswith("package:"):
        inside = name.removeprefix("package:").lstrip("/")
        tail = inside.partition("/")[2]
        ros = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        folders = [*files.package_dirs, *files.model.parents, *ros]
        candidates = [folder / inside for folder in folders] + [folder / tail for folder in folders]
    else:
        candidates = [files.model.parent / name.removeprefix("file://")]
    return next((c for c in candidates if c.is_file()), None)


def _numbers(text: str | None, default: tuple[float, ...]) -> tuple[float, ...]:
    try:
        values = tuple(float(w) for w in (text or "").split())
    except ValueError:
        return default
    return values if len(values) == len(default) else default


def _rgba(material: ET.Element) -> Colour4 | None:
    colour = material.find("color")
    if colour is None:
        return None
    r, g, b, a = _numbers(colour.get("rgba"), shapes.GREY)
    return (r, g, b, a)


def _origin(element: ET.Element | None) -> Array:
    T = np.eye(4)
    if element is None:
        return T
    T[:3, 3] = _numbers(element.get("xyz"), (0.0, 0.0, 0.0))
    roll, pitch, yaw = _numbers(element.get("rpy"), (0.0, 0.0, 0.0))
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    T[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return T
