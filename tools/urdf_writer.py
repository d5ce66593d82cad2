"""Write the URDF of a robot from tables of figures.

The tables hold the middle and the left side; the right side is their mirror image. All joint frames are parallel to the
base's in the zero pose: x forward, y left, z up; m, rad, kg.
"""

from __future__ import annotations

import argparse
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from urdf_shapes import Box, Capsule, Cylinder, Point, Shape, Sphere

X: Final = (1.0, 0.0, 0.0)
Y: Final = (0.0, 1.0, 0.0)
Z: Final = (0.0, 0.0, 1.0)
HERE: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Mass:
    """Mass [kg], its centre in the link frame [m], inertia xx xy xz yy yz zz about the centre [kg m^2]."""

    kg: float
    centre: Point
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Joint:
    """A joint: links, origin in the parent [m], axis, limits [rad], speed [rad/s], torque [N m]; fixed without axis."""

    name: str
    parent: str
    child: str
    origin: Point
    axis: Point | None = None
    limits: tuple[float, float] = (0.0, 0.0)
    speed: float = 0.0
    torque: float = 0.0


@dataclass(frozen=True)
class Robot:
    """The tables of a robot.

    Attributes:
        name: Its name.
        title: Its name for people.
        script: The script that holds the tables.
        base: The link that no joint carries.
        right_name: Gives the right side's name of a left link or joint, and others unchanged.
        joints: Joints of the middle, and ``left_joints`` of the left side, parents first.
        masses: Masses of the middle's links by name, and ``left_masses`` of the left side's.
        visuals: What is seen, by link of the middle and of the left side, and ``bodies``, what collides.
        colours: Red, green, blue, opacity by name [-].
        right_limits: Ranges of right joints that are not their left twin's mirror image [rad].
        leaders: Joints moved by the motor of another one, by name.
    """

    name: str
    title: str
    script: str
    base: str
    right_name: Callable[[str], str]
    joints: Sequence[Joint]
    left_joints: Sequence[Joint]
    masses: Mapping[str, Mass]
    left_masses: Mapping[str, Mass]
    visuals: Mapping[str, Sequence[Shape]]
    bodies: Mapping[str, Sequence[Shape]]
    colours: Mapping[str, tuple[float, float, float, float]]
    right_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    leaders: Mapping[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """Return the URDF."""
        root = self._element()
        ET.indent(root)
        lines = (
            '<?xml version="1.0" encoding="utf-8"?>',
            f"<!-- {self.title}, written by tools/{self.script}; change the tables there, not this file. -->",
            ET.tostring(root, encoding="unicode"),
        )
        return "\n".join(lines) + "\n"

    def _element(self) -> ET.Element:
        joints = [*self.joints, *self.left_joints, *(self._mirrored_joint(j) for j in self.left_joints)]
        right = {self.right_name(n): mirrored_mass(m) for n, m in self.left_masses.items()}
        masses = {**self.masses, **self.left_masses, **right}
        visuals, bodies = self._both_sides(self.visuals), self._both_sides(self.bodies)
        root = ET.Element("robot", name=self.name)
        for name, rgba in self.colours.items():
            ET.SubElement(ET.SubElement(root, "material", name=name), "color", rgba=numbers(rgba))
        for link in (self.base, *(j.child for j in joints)):
            root.append(link_element(link, masses.get(link), visuals.get(link, ()), bodies.get(link, ())))
        root.extend(joint_element(j, self.leaders.get(j.name)) for j in joints)
        return root

    def _mirrored_joint(self, joint: Joint) -> Joint:
        """Return the joint on the other side: a pitch turns the same way there, a roll or yaw the other way."""
        name, axis, (lower, upper) = self.right_name(joint.name), joint.axis, joint.limits
        if axis is not None and axis[1] != 0.0:
            axis = (-axis[0], axis[1], -axis[2])
        else:
            lower, upper = -upper, -lower
        return replace(
            joint,
            name=name,
            parent=self.right_name(joint.parent),
            child=self.right_name(joint.child),
            origin=mirrored_point(joint.origin),
            axis=axis,
            limits=self.right_limits.get(name, (lower, upper)),
        )

    def _both_sides(self, shapes: Mapping[str, Sequence[Shape]]) -> dict[str, Sequence[Shape]]:
        left = [name for name in shapes if self.right_name(name) != name]
        return {**shapes, **{self.right_name(n): [s.mirrored() for s in shapes[n]] for n in left}}


def mirrored_point(p: Point) -> Point:
    """Return a point on the other side of the sagittal plane."""
    return (p[0], -p[1], p[2])


def mirrored_mass(mass: Mass) -> Mass:
    """Return the mass on the other side: products of inertia with y change sign."""
    xx, xy, xz, yy, yz, zz = mass.inertia
    return Mass(mass.kg, mirrored_point(mass.centre), (xx, -xy, xz, yy, -yz, zz))


def link_element(
    name: str, mass: Mass | None, visuals: Sequence[Shape], bodies: Sequence[Shape]
) -> ET.Element:
    """Return a link.

    URDF knows no capsule. A body that is one is written as its cylinder and named under ``collision_checking``:
    Pinocchio then makes the capsule, other readers take the cylinder.
    """
    link = ET.Element("link", name=name)
    if mass is not None:
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=numbers(mass.centre), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=number(mass.kg))
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        ET.SubElement(inertial, "inertia", {k: number(v) for k, v in zip(keys, mass.inertia, strict=True)})
    for shape in (part for v in visuals for part in v.parts()):
        element = shape_element(link, "visual", shape)
        ET.SubElement(element, "material", name=shape.colour)
    capsules = []
    for i, body in enumerate(bodies):
        title = f"{name}_body_{i}"
        solid = body.parts()[0]
        shape_element(link, "collision", solid).set("name", title)
        if isinstance(body, Capsule):
            capsules.append(title)
    if capsules:
        checking = ET.SubElement(link, "collision_checking")
        for title in capsules:
            ET.SubElement(checking, "capsule", name=title)
    return link


def shape_element(link: ET.Element, tag: str, shape: Box | Cylinder | Sphere) -> ET.Element:
    """Add a visual or collision element to a link and return it."""
    element = ET.SubElement(link, tag)
    ET.SubElement(element, "origin", xyz=numbers(shape.centre), rpy=numbers(shape.rpy))
    geometry = ET.SubElement(element, "geometry")
    if isinstance(shape, Box):
        ET.SubElement(geometry, "box", size=numbers(shape.size))
    elif isinstance(shape, Cylinder):
        ET.SubElement(geometry, "cylinder", radius=number(shape.radius), length=number(shape.length))
    else:
        ET.SubElement(geometry, "sphere", radius=number(shape.radius))
    return element


def joint_element(joint: Joint, leader: str | None = None) -> ET.Element:
    """Return a joint; one with a leader takes the leader's value."""
    element = ET.Element("joint", name=joint.name, type="fixed" if joint.axis is None else "revolute")
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    ET.SubElement(element, "origin", xyz=numbers(joint.origin), rpy="0 0 0")
    if joint.axis is None:
        return element
    ET.SubElement(element, "axis", xyz=numbers(joint.axis))
    lower, upper = joint.limits
    ET.SubElement(
        element, "limit", lower=number(lower), upper=number(upper),
        velocity=number(joint.speed), effort=number(joint.torque),
    )  # fmt: skip
    if leader is not None:
        ET.SubElement(element, "mimic", joint=leader, multiplier="1", offset="0")
    return element


def number(value: float) -> str:
    """Return a number with ten significant digits and no minus before zero."""
    return f"{value + 0.0:.10g}" if abs(value) > 1e-12 else "0"


def numbers(values: Sequence[float]) -> str:
    """Return numbers with spaces between."""
    return " ".join(number(v) for v in values)


def write_or_check(robot: Robot, path: Path, arguments: Sequence[str] | None = None) -> int:
    """Write the file, or with ``--check`` compare it; return the exit status."""
    parser = argparse.ArgumentParser(
        description=f"Write the URDF of {robot.title} from the tables of figures."
    )
    parser.add_argument("--check", action="store_true", help="write nothing; say whether the file is in step")
    options = parser.parse_args(arguments)
    text = robot.text()
    if not options.check:
        path.write_text(text, encoding="utf-8")
        return 0
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        return 0
    print(f"{path} is not in step with its tables; write it anew: python {robot.script}", file=sys.stderr)
    return 1
