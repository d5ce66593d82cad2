"""Write the URDF of NAO v4 (H25) from tables of published figures: ``python tools/make_nao_v4.py``.

The tables hold the torso, the head and the left side; the right side is their mirror image, so the model is symmetric
wherever the published figures are. ``--check`` writes nothing and says whether the file is in step with the tables.
All joint frames are parallel to the torso's in the zero pose: x forward, y left, z up; m, rad, kg.
"""

from __future__ import annotations

import argparse
import math
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from nao_v4_shapes import BODIES, COLOURS, VISUALS, Box, Capsule, Cylinder, Shape, Sphere

MODEL: Final = Path(__file__).resolve().parents[1] / "plugins" / "robots" / "models" / "nao_v4.urdf"
Point = tuple[float, float, float]


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


# Lengths: Aldebaran documentation, "H25 - Links", in m. The height of the foot is the 45.11 mm that the documentation
# gives for V3.2 and nao_description uses (45.19 mm for V3.3; there is no figure for V4).
NECK_Z: Final = 0.1265
SHOULDER_Y, SHOULDER_Z = 0.098, 0.100
UPPER_ARM, ELBOW_Y = 0.105, 0.015
LOWER_ARM: Final = 0.05595
HAND_X, HAND_Z = 0.05775, 0.01231
HIP_Y, HIP_Z = 0.050, 0.085
THIGH, TIBIA, FOOT = 0.100, 0.1029, 0.04511

X: Final = (1.0, 0.0, 0.0)
Y: Final = (0.0, 1.0, 0.0)
Z: Final = (0.0, 0.0, 1.0)
HALF: Final = math.sqrt(0.5)
HERE: Final = (0.0, 0.0, 0.0)

# Limits, speeds and torques: ros-naoqi nao_description, naoV40 (BSD); limits as in the documentation's "H25 - Joints".
# Speeds are the motors' without load through the gears, torques what the motors hold continuously.
JOINTS: Final = (
    Joint("HeadYaw", "torso", "Neck", (0.0, 0.0, NECK_Z), Z, (-2.08567, 2.08567), 8.26797, 1.547),
    Joint("HeadPitch", "Neck", "Head", HERE, Y, (-0.671952, 0.514872), 7.19407, 1.532),
)
LEFT_JOINTS: Final = (
    Joint(
        "LHipYawPitch", "torso", "LPelvis", (0.0, HIP_Y, -HIP_Z), (0.0, HALF, -HALF),
        (-1.14529, 0.740718), 4.16174, 3.348,
    ),
    Joint("LHipRoll", "LPelvis", "LHip", HERE, X, (-0.379435, 0.79046), 4.16174, 3.348),
    Joint("LHipPitch", "LHip", "LThigh", HERE, Y, (-1.53589, 0.48398), 6.40239, 3.023),
    Joint("LKneePitch", "LThigh", "LTibia", (0.0, 0.0, -THIGH), Y, (-0.0923279, 2.11255), 6.40239, 3.023),
    Joint("LAnklePitch", "LTibia", "LAnklePitchLink", (0.0, 0.0, -TIBIA), Y, (-1.18944, 0.922581), 6.40239, 3.023),
    Joint("LAnkleRoll", "LAnklePitchLink", "l_ankle", HERE, X, (-0.397761, 0.768992), 4.16174, 3.348),
    Joint("l_sole_joint", "l_ankle", "l_sole", (0.0, 0.0, -FOOT)),
    Joint(
        "LShoulderPitch", "torso", "LShoulder", (0.0, SHOULDER_Y, SHOULDER_Z), Y,
        (-2.08567, 2.08567), 8.26797, 1.329,
    ),
    Joint("LShoulderRoll", "LShoulder", "LBicep", HERE, Z, (-0.314159, 1.32645), 7.19407, 1.7835),
    Joint("LElbowYaw", "LBicep", "LElbow", (UPPER_ARM, ELBOW_Y, 0.0), X, (-2.08567, 2.08567), 8.26797, 1.547),
    Joint("LElbowRoll", "LElbow", "LForeArm", HERE, Z, (-1.54462, -0.0349066), 7.19407, 1.532),
    Joint("LWristYaw", "LForeArm", "l_wrist", (LOWER_ARM, 0.0, 0.0), X, (-1.82387, 1.82387), 24.6229, 0.4075),
    Joint("l_gripper_joint", "l_wrist", "l_gripper", (HAND_X, 0.0, -HAND_Z)),
)  # fmt: skip

# Same source: the one range that is not its left twin's mirror image.
RIGHT_LIMITS: Final = {"RAnklePitch": (-1.1863, 0.932006)}

# One motor turns both hips: RHipYawPitch = LHipYawPitch ("H25 - Joints"); the axes are mirrored, the values equal.
MIMICS: Final = {"RHipYawPitch": "LHipYawPitch"}

# Masses and their centres: Aldebaran documentation, "Masses - V4". Inertia: nao_description, naoV40, which moves the
# documentation's tensors from the joint to the centre of mass. There the sides differ; here the left one is mirrored.
MASSES: Final = {
    "torso": Mass(
        1.04956, (-0.00413, 0.0, 0.04342),
        (0.00308361, 1.43116e-05, -3.30211e-05, 0.0028835, -2.70793e-05, 0.0015924),
    ),
    "Neck": Mass(
        0.06442, (-1e-05, 0.0, -0.02742), (2.65584e-05, 1.57e-09, 0.0, 2.75654e-05, -5.295e-08, 5.53372e-06)
    ),
    "Head": Mass(
        0.60533, (-0.00112, 0.0, 0.05258),
        (0.000957766, 8.78814e-06, 5.33702e-06, 0.000816836, -2.99579e-05, 0.000984976),
    ),
}  # fmt: skip
LEFT_MASSES: Final = {
    "LShoulder": Mass(
        0.07504, (-0.00165, -0.02663, 0.00014),
        (3.10677e-05, 1.2692e-06, 6.04576e-09, 1.39498e-05, -2.99484e-07, 3.30001e-05),
    ),
    "LBicep": Mass(
        0.15777, (0.02455, 0.00563, 0.0033),
        (8.7181e-05, -2.53381e-05, -1.4213e-05, 0.000274712, 4.71439e-07, 0.000241812),
    ),
    "LElbow": Mass(
        0.06483, (-0.02744, 0.0, -0.00014),
        (5.59588e-06, 4.21e-09, 2.92241e-07, 2.66179e-05, -1.84e-09, 2.76294e-05),
    ),
    "LForeArm": Mass(
        0.07761, (0.02556, 0.00281, 0.00076),
        (2.46746e-05, 3.23152e-06, 1.58221e-06, 3.83837e-05, 1.39194e-07, 3.59708e-05),
    ),
    "l_wrist": Mass(
        0.18533, (0.03434, -0.00088, 0.00308),
        (6.86477e-05, 1.15465e-07, -2.87254e-06, 0.000135756, 2.67539e-06, 0.000133228),
    ),
    "LPelvis": Mass(
        0.06981, (-0.00781, -0.01114, 0.02661),
        (2.3407e-05, 1.07922e-06, -1.76003e-06, 4.76355e-05, 2.76058e-06, 4.97021e-05),
    ),
    "LHip": Mass(
        0.13053, (-0.01549, 0.00029, -0.00515),
        (2.41106e-05, -6.08684e-07, 6.33119e-06, 6.34892e-05, -1.99137e-07, 5.67694e-05),
    ),
    "LThigh": Mass(
        0.38968, (0.00138, 0.00221, -0.05373),
        (0.000509844, 2.11296e-06, 5.64129e-05, 0.000465358, -7.91029e-06, 0.000301098),
    ),
    "LTibia": Mass(
        0.29142, (0.00453, 0.00225, -0.04936),
        (0.000470586, 3.60392e-06, -2.86648e-05, 0.000412654, 7.13013e-06, 0.000185772),
    ),
    "LAnklePitchLink": Mass(
        0.13416, (0.00045, 0.00029, 0.00685),
        (3.22034e-05, -8.83212e-09, 4.27549e-06, 6.7943e-05, 2.84849e-07, 5.48269e-05),
    ),
    "l_ankle": Mass(
        0.16184, (0.02542, 0.0033, -0.03239),
        (9.78911e-05, 7.88039e-06, 6.1279e-06, 0.000369977, 1.44233e-06, 0.000419417),
    ),
}  # fmt: skip


def right_name(name: str) -> str:
    """Return the right side's name of a left link or joint; others unchanged."""
    if name.startswith("L"):
        return f"R{name[1:]}"
    return f"r{name[1:]}" if name.startswith("l_") else name


def mirrored_point(p: Point) -> Point:
    """Return a point on the other side of the sagittal plane."""
    return (p[0], -p[1], p[2])


def mirrored_mass(mass: Mass) -> Mass:
    """Return the mass on the other side: products of inertia with y change sign."""
    xx, xy, xz, yy, yz, zz = mass.inertia
    return Mass(mass.kg, mirrored_point(mass.centre), (xx, -xy, xz, yy, -yz, zz))


def mirrored_joint(joint: Joint) -> Joint:
    """Return the joint on the other side: a pitch turns the same way there, a roll or yaw the other way."""
    name, axis, (lower, upper) = right_name(joint.name), joint.axis, joint.limits
    if axis is not None and axis[1] != 0.0:
        axis = (-axis[0], axis[1], -axis[2])
    else:
        lower, upper = -upper, -lower
    return replace(
        joint, name=name, parent=right_name(joint.parent), child=right_name(joint.child),
        origin=mirrored_point(joint.origin), axis=axis, limits=RIGHT_LIMITS.get(name, (lower, upper)),
    )  # fmt: skip


def both_sides(shapes: dict[str, Sequence[Shape]]) -> dict[str, Sequence[Shape]]:
    """Return the shapes of all links, the right ones mirrored."""
    right = {right_name(n): [s.mirrored() for s in shapes[n]] for n in shapes if right_name(n) != n}
    return {**shapes, **right}


def robot() -> ET.Element:
    """Return the whole model."""
    joints = [*JOINTS, *LEFT_JOINTS, *(mirrored_joint(j) for j in LEFT_JOINTS)]
    right = {right_name(n): mirrored_mass(m) for n, m in LEFT_MASSES.items()}
    masses, visuals, bodies = {**MASSES, **LEFT_MASSES, **right}, both_sides(VISUALS), both_sides(BODIES)
    root = ET.Element("robot", name="nao_v4")
    for name, rgba in COLOURS.items():
        ET.SubElement(ET.SubElement(root, "material", name=name), "color", rgba=numbers(rgba))
    for link in ("torso", *(j.child for j in joints)):
        root.append(link_element(link, masses.get(link), visuals.get(link, ()), bodies.get(link, ())))
    root.extend(joint_element(j) for j in joints)
    return root


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


def joint_element(joint: Joint) -> ET.Element:
    """Return a joint."""
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
    if joint.name in MIMICS:
        ET.SubElement(element, "mimic", joint=MIMICS[joint.name], multiplier="1", offset="0")
    return element


def number(value: float) -> str:
    """Return a number with ten significant digits and no minus before zero."""
    return f"{value + 0.0:.10g}" if abs(value) > 1e-12 else "0"


def numbers(values: Sequence[float]) -> str:
    """Return numbers with spaces between."""
    return " ".join(number(v) for v in values)


def text() -> str:
    """Return the file's text."""
    root = robot()
    ET.indent(root)
    lines: Iterator[str] = iter(
        (
            '<?xml version="1.0" encoding="utf-8"?>',
            "<!-- NAO v4 (H25), written by tools/make_nao_v4.py; change the tables there, not this file. -->",
            ET.tostring(root, encoding="unicode"),
        )
    )
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file, or compare it."""
    parser = argparse.ArgumentParser(description="Write the URDF of NAO v4 from the tables of figures.")
    parser.add_argument("--check", action="store_true", help="write nothing; say whether the file is in step")
    options = parser.parse_args(arguments)
    if not options.check:
        MODEL.write_text(text(), encoding="utf-8")
        return 0
    if MODEL.is_file() and MODEL.read_text(encoding="utf-8") == text():
        return 0
    print(
        f"{MODEL} is not in step with its tables; write it anew: python {Path(__file__).name}",
        file=sys.stderr,
    )
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
