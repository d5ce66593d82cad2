"""What NAO v4 looks like and what it collides with: boxes, balls, cylinders, capsules in its links' frames [m].

The shapes are ours, drawn about the published joints so that the outline meets the published size: 573 mm high, 275 mm
wide over the hanging arms, thighs, shanks and arms about as thick as the robot's. Left side; the right is mirrored.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from urdf_shapes import Box, Capsule, Cylinder, Shape, Sphere, pair

COLOURS: Final = {
    "white": (0.95, 0.95, 0.94, 1.0),
    "grey": (0.50, 0.52, 0.55, 1.0),
    "dark": (0.16, 0.17, 0.19, 1.0),
    "orange": (0.96, 0.45, 0.08, 1.0),
    "blue": (0.55, 0.80, 0.98, 1.0),
}

VISUALS: Final[dict[str, Sequence[Shape]]] = {
    "torso": (
        *pair(Capsule((0.0, 0.030, 0.072), (-0.004, 0.014, -0.028), 0.043, "white")),
        Capsule((0.004, 0.0, 0.074), (-0.004, 0.0, -0.030), 0.046, "white"),
        # shoulders, coloured flanks, the battery's lid on the back
        Capsule((-0.004, -0.046, 0.092), (-0.004, 0.046, 0.092), 0.0290, "white"),
        *pair(Capsule((-0.002, 0.0395, 0.062), (-0.006, 0.0240, -0.008), 0.0350, "orange")),
        Capsule((-0.020, 0.0, 0.070), (-0.018, 0.0, 0.020), 0.0330, "grey"),
        # the button, with its ring
        Cylinder((0.038, 0.0, 0.042), (0.0505, 0.0, 0.042), 0.0135, "grey"),
        Cylinder((0.044, 0.0, 0.042), (0.0520, 0.0, 0.042), 0.0095, "blue"),
        # the belt and the pelvis
        Capsule((-0.004, -0.024, -0.066), (-0.004, 0.024, -0.066), 0.031, "grey"),
        Capsule((0.004, -0.008, -0.076), (0.004, 0.008, -0.076), 0.032, "white"),
    ),
    "Neck": (Cylinder((0.0, 0.0, -0.024), (0.0, 0.0, 0.022), 0.021, "dark"),),
    "Head": (
        *pair(Sphere((0.0, 0.013, 0.060), 0.0500, "white")),
        Sphere((-0.004, 0.0, 0.0635), 0.0500, "white"),
        Capsule((0.016, -0.016, 0.034), (0.016, 0.016, 0.034), 0.0310, "white"),
        # eyes: ring, light, pupil
        *pair(Cylinder((0.030, 0.0220, 0.0600), (0.0490, 0.0275, 0.0625), 0.0165, "grey")),
        *pair(Cylinder((0.030, 0.0220, 0.0600), (0.0500, 0.0278, 0.0626), 0.0135, "blue")),
        *pair(Cylinder((0.030, 0.0220, 0.0600), (0.0510, 0.0281, 0.0628), 0.0075, "dark")),
        # cameras in forehead and mouth
        Cylinder((0.030, 0.0, 0.086), (0.0425, 0.0, 0.0905), 0.0055, "dark"),
        Capsule((0.0425, -0.005, 0.026), (0.0425, 0.005, 0.026), 0.0055, "dark"),
        # ears, and the touch sensors on top between coloured shells
        *pair(Cylinder((-0.004, 0.050, 0.060), (-0.004, 0.0640, 0.060), 0.0270, "orange")),
        *pair(Cylinder((-0.004, 0.052, 0.060), (-0.004, 0.0685, 0.060), 0.0200, "white")),
        *pair(Cylinder((-0.004, 0.054, 0.060), (-0.004, 0.0695, 0.060), 0.0090, "dark")),
        Capsule((0.016, 0.0, 0.1010), (-0.026, 0.0, 0.1000), 0.0110, "dark"),
        *pair(Capsule((0.012, 0.022, 0.0955), (-0.030, 0.022, 0.0925), 0.0130, "orange")),
    ),
    "LShoulder": (
        Sphere((0.0, 0.004, 0.0), 0.0310, "orange"),
        Cylinder((0.0, -0.034, 0.0), (0.0, -0.004, 0.0), 0.0265, "grey"),
    ),
    "LBicep": (
        Cylinder((0.0, 0.004, -0.027), (0.0, 0.004, 0.027), 0.0200, "grey"),
        Capsule((0.022, 0.006, 0.0), (0.078, 0.013, 0.0), 0.0265, "white"),
    ),
    "LElbow": (Sphere((0.0, 0.0, 0.0), 0.0235, "grey"),),
    "LForeArm": (
        Cylinder((0.0, 0.0, -0.024), (0.0, 0.0, 0.024), 0.0170, "dark"),
        Capsule((0.020, 0.0, 0.0), (0.038, 0.0, 0.0), 0.0250, "white"),
        Cylinder((0.038, 0.0, 0.0), (0.056, 0.0, 0.0), 0.0262, "orange"),
    ),
    "l_wrist": (
        Capsule((0.004, 0.0, 0.0), (0.026, 0.0, 0.0), 0.0235, "white"),
        Sphere((0.0480, 0.0, -0.0020), 0.0205, "grey"),
    ),
    "l_gripper": (
        *pair(Capsule((0.004, 0.0100, 0.0160), (0.024, 0.0105, 0.0120), 0.0075, "white")),
        *pair(Capsule((0.024, 0.0105, 0.0120), (0.037, 0.0105, -0.0010), 0.0070, "white")),
        Capsule((0.002, 0.0, -0.0060), (0.020, 0.0, -0.0140), 0.0070, "white"),
    ),
    "LPelvis": (Sphere((-0.006, -0.006, 0.012), 0.0300, "grey"),),
    "LHip": (Sphere((-0.002, 0.0, 0.0), 0.0290, "dark"),),
    "LThigh": (
        Capsule((0.000, 0.003, -0.012), (0.002, 0.002, -0.078), 0.0360, "white"),
        Capsule((0.014, 0.003, -0.022), (0.012, 0.002, -0.070), 0.0270, "orange"),
        *pair(Cylinder((0.0, 0.016, -0.100), (0.0, 0.033, -0.100), 0.0240, "grey")),
    ),
    "LTibia": (
        Cylinder((0.0, -0.020, 0.0), (0.0, 0.020, 0.0), 0.0260, "dark"),
        Capsule((0.004, 0.002, -0.026), (0.004, 0.002, -0.066), 0.0330, "white"),
        Capsule((-0.010, 0.002, -0.034), (-0.006, 0.002, -0.064), 0.0320, "white"),
        Capsule((0.020, 0.002, -0.028), (0.014, 0.002, -0.072), 0.0210, "orange"),
        Cylinder((0.002, 0.002, -0.060), (0.001, 0.002, -0.092), 0.0305, "white"),
    ),
    "LAnklePitchLink": (Cylinder((0.0, -0.024, 0.0), (0.0, 0.024, 0.0), 0.0220, "dark"),),
    "l_ankle": (
        # sole, coloured rim, instep
        Cylinder((0.036, 0.006, -0.04511), (0.036, 0.006, -0.0390), 0.0430, "dark"),
        Cylinder((-0.006, 0.006, -0.04511), (-0.006, 0.006, -0.0390), 0.0400, "dark"),
        Box((0.015, 0.006, -0.042055), (0.042, 0.0830, 0.00611), "dark"),
        Cylinder((0.036, 0.006, -0.0390), (0.036, 0.006, -0.0270), 0.0440, "orange"),
        Cylinder((-0.006, 0.006, -0.0390), (-0.006, 0.006, -0.0270), 0.0410, "white"),
        Box((0.012, 0.006, -0.0330), (0.036, 0.0835, 0.0120), "white"),
        Cylinder((0.034, 0.006, -0.0270), (0.034, 0.006, -0.0180), 0.0385, "white"),
        Cylinder((-0.004, 0.006, -0.0270), (-0.004, 0.006, -0.0180), 0.0370, "white"),
        Box((0.015, 0.006, -0.0225), (0.038, 0.0750, 0.0090), "white"),
        Capsule((0.034, -0.008, -0.0200), (0.034, 0.020, -0.0200), 0.0200, "white"),
        *pair(Capsule((-0.014, 0.020, -0.0140), (0.020, 0.020, -0.0140), 0.0140, "white")),
        Cylinder((-0.004, 0.004, -0.0220), (-0.004, 0.004, -0.0060), 0.0300, "white"),
    ),
}
"""What is seen."""

BODIES: Final[dict[str, Sequence[Shape]]] = {
    "torso": pair(Capsule((0.0, 0.018, 0.066), (0.0, 0.016, 0.004), 0.044)),
    "Head": (Capsule((0.0, -0.014, 0.060), (0.0, 0.014, 0.060), 0.0535),),
    "LBicep": (Capsule((0.026, 0.006, 0.0), (0.080, 0.013, 0.0), 0.0265),),
    "LForeArm": (Capsule((0.020, 0.0, 0.0), (0.050, 0.0, 0.0), 0.0255),),
    "l_wrist": (Capsule((0.008, 0.0, 0.0), (0.076, 0.0, -0.002), 0.0225),),
    "LThigh": (Capsule((0.002, 0.002, -0.022), (0.003, 0.002, -0.090), 0.0370),),
    "LTibia": (Capsule((0.001, 0.002, -0.016), (0.001, 0.002, -0.078), 0.0370),),
    # Two boxes, so that the corners of what touches the floor are those of the support polygon in the card.
    "l_ankle": (
        Box((0.0165, 0.006, -0.03311), (0.0970, 0.0880, 0.0240)),
        Box((0.0165, 0.006, -0.03311), (0.1270, 0.0580, 0.0240)),
    ),
}
"""What is kept apart: one simple body a link, a little thicker than what is seen."""
