"""What HRP-2 looks like and what it collides with: boxes, balls, cylinders, capsules in its links' frames [m].

The shapes are ours, drawn about the published joints so that the outline meets the published size: 1.54 m high (with
the head's cover 1.56), 0.62 m wide over the hanging arms, 0.355 m deep with the case on the back. Its legs hang beside
their joints: the hip carries them from the inside. Left side; the right is mirrored.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from urdf_shapes import Box, Capsule, Cylinder, Shape, Sphere, pair

COLOURS: Final = {
    "silver": (0.80, 0.82, 0.84, 1.0),
    "white": (0.93, 0.94, 0.94, 1.0),
    "slate": (0.24, 0.29, 0.42, 1.0),
    "dark": (0.13, 0.14, 0.17, 1.0),
    "visor": (0.08, 0.10, 0.14, 1.0),
    "amber": (0.95, 0.62, 0.12, 1.0),
}

VISUALS: Final[dict[str, Sequence[Shape]]] = {
    "BODY": (
        # the girdle between the hips, its covers, the belly of two shells
        Box((-0.012, 0.0, 0.118), (0.185, 0.240, 0.066), "slate"),
        *pair(Capsule((-0.012, 0.084, 0.120), (-0.012, 0.122, 0.112), 0.052, "slate")),
        Capsule((-0.008, -0.050, 0.185), (-0.008, 0.050, 0.185), 0.086, "silver"),
        Capsule((-0.006, -0.038, 0.250), (-0.006, 0.038, 0.250), 0.080, "silver"),
        Cylinder((0.022, 0.0, 0.255), (0.028, 0.0, 0.330), 0.082, "dark"),
        *pair(Box((0.066, 0.042, 0.205), (0.030, 0.062, 0.084), "white", (0.0, -0.10, 0.18))),
        Box((-0.086, 0.0, 0.205), (0.050, 0.150, 0.120), "slate"),
        Capsule((-0.006, 0.0, 0.085), (-0.006, 0.0, 0.035), 0.040, "dark"),
    ),
    "CHEST_LINK0": (Cylinder((0.0, -0.066, 0.0), (0.0, 0.066, 0.0), 0.056, "dark"),),
    "CHEST_LINK1": (
        # ribs, the two plates of the breast, collar, shoulders, the case on the back
        Capsule((-0.012, -0.060, 0.062), (-0.012, 0.060, 0.062), 0.072, "dark"),
        Box((-0.012, 0.0, 0.160), (0.190, 0.300, 0.150), "silver"),
        *pair(Capsule((0.040, 0.104, 0.168), (0.040, 0.060, 0.120), 0.062, "silver")),
        *pair(Box((0.098, 0.080, 0.166), (0.044, 0.130, 0.116), "white", (0.0, 0.10, 0.22))),
        *pair(Box((0.080, 0.058, 0.088), (0.040, 0.086, 0.062), "slate", (0.0, 0.35, 0.20))),
        Box((0.110, 0.0, 0.165), (0.024, 0.030, 0.090), "slate"),
        Cylinder((0.118, 0.0, 0.198), (0.127, 0.0, 0.198), 0.010, "amber"),
        *pair(Capsule((-0.004, 0.118, 0.196), (0.002, 0.168, 0.186), 0.054, "slate")),
        Capsule((-0.012, -0.086, 0.236), (-0.012, 0.086, 0.236), 0.030, "white"),
        Cylinder((-0.007, 0.0, 0.225), (-0.007, 0.0, 0.285), 0.046, "dark"),
        Box((-0.150, 0.0, 0.138), (0.100, 0.280, 0.236), "silver"),
        Box((-0.203, 0.0, 0.138), (0.010, 0.230, 0.186), "slate"),
        *pair(Capsule((-0.150, 0.128, 0.246), (-0.150, 0.128, 0.040), 0.030, "white")),
    ),
    "HEAD_LINK0": (Cylinder((0.0, 0.0, -0.030), (0.0, 0.0, 0.026), 0.036, "dark"),),
    "HEAD_LINK1": (
        # helmet, jaw, the visor with its three cameras, the fins over the ears
        *pair(Capsule((0.004, 0.014, 0.112), (-0.018, 0.014, 0.112), 0.078, "white")),
        Sphere((-0.008, 0.0, 0.128), 0.082, "white"),
        Capsule((0.024, -0.022, 0.046), (0.024, 0.022, 0.046), 0.040, "silver"),
        Capsule((-0.020, -0.018, 0.050), (-0.020, 0.018, 0.050), 0.046, "slate"),
        Capsule((0.050, -0.036, 0.100), (0.050, 0.036, 0.100), 0.034, "visor"),
        Capsule((0.036, -0.052, 0.104), (0.036, 0.052, 0.104), 0.034, "visor"),
        *pair(Cylinder((0.070, 0.030, 0.100), (0.0865, 0.032, 0.100), 0.010, "silver")),
        Cylinder((0.070, 0.0, 0.118), (0.0855, 0.0, 0.120), 0.008, "silver"),
        *pair(Cylinder((-0.010, 0.082, 0.100), (-0.010, 0.100, 0.100), 0.040, "slate")),
        *pair(Cylinder((-0.010, 0.084, 0.100), (-0.010, 0.105, 0.100), 0.022, "white")),
        *pair(Box((-0.034, 0.092, 0.132), (0.060, 0.010, 0.058), "slate", (0.0, -0.55, 0.0))),
        Box((-0.010, 0.0, 0.198), (0.100, 0.018, 0.024), "slate"),
    ),
    "LARM_LINK0": (
        Cylinder((0.0, -0.070, 0.0), (0.0, -0.020, 0.0), 0.046, "dark"),
        Sphere((0.0, 0.0, 0.0), 0.0520, "slate"),
    ),
    "LARM_LINK1": (
        Capsule((0.0, 0.004, 0.018), (0.0, 0.004, -0.010), 0.0560, "white"),
        Cylinder((-0.056, 0.0, 0.0), (0.056, 0.0, 0.0), 0.030, "dark"),
    ),
    "LARM_LINK2": (
        Cylinder((0.0, 0.0, -0.060), (0.0, 0.0, -0.105), 0.044, "dark"),
        Capsule((0.0, 0.003, -0.118), (0.0, 0.0, -0.196), 0.050, "silver"),
        Box((0.030, 0.004, -0.158), (0.046, 0.060, 0.090), "white"),
        *pair(Cylinder((0.0, 0.024, -0.250), (0.0, 0.050, -0.250), 0.042, "slate")),
    ),
    "LARM_LINK3": (
        Cylinder((0.0, -0.024, 0.0), (0.0, 0.024, 0.0), 0.044, "dark"),
        Capsule((0.0, 0.0, -0.050), (0.0, 0.0, -0.120), 0.047, "silver"),
        Cylinder((0.0, 0.0, -0.110), (0.0, 0.0, -0.180), 0.044, "white"),
        Cylinder((0.0, 0.0, -0.180), (0.0, 0.0, -0.205), 0.037, "dark"),
    ),
    "LARM_LINK4": (
        Cylinder((0.0, 0.0, 0.045), (0.0, 0.0, 0.014), 0.036, "slate"),
        Cylinder((0.0, -0.036, 0.0), (0.0, 0.036, 0.0), 0.026, "dark"),
    ),
    "LARM_LINK5": (
        Capsule((0.0, 0.0, -0.036), (0.004, 0.0, -0.060), 0.031, "silver"),
        Box((0.004, 0.0, -0.088), (0.066, 0.054, 0.050), "slate"),
        # the fixed half of the hand
        *pair(Capsule((-0.014, 0.018, -0.110), (-0.012, 0.016, -0.185), 0.012, "silver")),
    ),
    "LARM_LINK6": (
        *pair(Capsule((0.002, 0.014, -0.004), (0.000, 0.013, -0.060), 0.011, "silver")),
        *pair(Capsule((0.000, 0.013, -0.060), (-0.014, 0.013, -0.096), 0.010, "silver")),
    ),
    "LLEG_LINK0": (
        Cylinder((0.0, 0.0, 0.090), (0.0, 0.0, 0.020), 0.046, "dark"),
        Box((-0.040, 0.0, 0.050), (0.050, 0.070, 0.070), "slate"),
    ),
    "LLEG_LINK1": (
        Cylinder((-0.056, 0.0, 0.0), (0.056, 0.0, 0.0), 0.040, "dark"),
        Cylinder((0.0, 0.010, 0.0), (0.0, 0.048, 0.0), 0.046, "slate"),
    ),
    "LLEG_LINK2": (
        Cylinder((0.0, 0.044, 0.0), (0.0, 0.116, 0.0), 0.062, "silver"),
        Cylinder((0.0, 0.116, 0.0), (0.0, 0.124, 0.0), 0.046, "slate"),
        Capsule((0.0, 0.078, -0.056), (0.004, 0.066, -0.215), 0.058, "silver"),
        Capsule((0.026, 0.078, -0.070), (0.026, 0.066, -0.190), 0.044, "white"),
        Box((-0.046, 0.074, -0.130), (0.030, 0.076, 0.150), "slate"),
        *pair(Sphere((0.0, 0.0, -0.300), 0.010, "dark")),
        Cylinder((0.0, -0.004, -0.300), (0.0, 0.104, -0.300), 0.046, "dark"),
    ),
    "LLEG_LINK3": (
        Cylinder((0.0, 0.008, 0.0), (0.0, 0.092, 0.0), 0.053, "slate"),
        Capsule((0.030, 0.050, 0.006), (0.030, 0.050, -0.040), 0.040, "white"),
        Capsule((0.012, 0.054, -0.060), (0.008, 0.046, -0.200), 0.054, "silver"),
        Capsule((-0.020, 0.054, -0.074), (-0.012, 0.048, -0.165), 0.050, "silver"),
        Box((0.052, 0.050, -0.125), (0.028, 0.070, 0.150), "white", (0.0, 0.05, 0.0)),
        Cylinder((0.004, 0.042, -0.200), (0.002, 0.036, -0.268), 0.042, "dark"),
    ),
    "LLEG_LINK4": (
        Cylinder((0.0, -0.052, 0.0), (0.0, 0.052, 0.0), 0.036, "slate"),
        Cylinder((-0.050, 0.0, 0.0), (0.050, 0.0, 0.0), 0.028, "dark"),
    ),
    "LLEG_LINK5": (
        # sole, foot, instep, the bearing of the ankle
        Box((0.015, 0.010, -0.0975), (0.2412, 0.138, 0.015), "dark"),
        Box((0.015, 0.010, -0.0780), (0.233, 0.130, 0.024), "silver"),
        Box((0.030, 0.010, -0.0600), (0.170, 0.110, 0.020), "silver"),
        Box((0.084, 0.010, -0.0640), (0.070, 0.104, 0.022), "white", (0.0, 0.28, 0.0)),
        Box((0.0, 0.005, -0.0420), (0.100, 0.086, 0.030), "slate"),
        *(Cylinder((x, 0.0, -0.010), (x, 0.0, -0.040), 0.018, "slate") for x in (-0.050, 0.050)),
    ),
}
"""What is seen."""

BODIES: Final[dict[str, Sequence[Shape]]] = {
    "BODY": (Box((-0.012, 0.0, 0.190), (0.200, 0.250, 0.200)),),
    "CHEST_LINK1": (
        Box((0.000, 0.0, 0.150), (0.240, 0.310, 0.190)),
        Box((-0.155, 0.0, 0.138), (0.105, 0.310, 0.240)),
    ),
    "HEAD_LINK1": (Capsule((-0.004, 0.0, 0.080), (-0.004, 0.0, 0.124), 0.092),),
    "LARM_LINK2": (Capsule((0.0, 0.0, -0.060), (0.0, 0.0, -0.210), 0.056),),
    "LARM_LINK3": (Capsule((0.0, 0.0, -0.040), (0.0, 0.0, -0.200), 0.049),),
    "LARM_LINK5": (Capsule((0.0, 0.0, -0.055), (0.002, 0.0, -0.160), 0.042),),
    "LLEG_LINK2": (Capsule((0.004, 0.078, -0.030), (0.006, 0.064, -0.240), 0.062),),
    "LLEG_LINK3": (Capsule((0.006, 0.052, -0.050), (0.004, 0.044, -0.215), 0.060),),
    "LLEG_LINK5": (Box((0.015, 0.010, -0.0850), (0.2412, 0.138, 0.040)),),
}
"""What is kept apart: one or two simple bodies a link, a little thicker than what is seen."""
