"""Write the URDF of HRP-2 from tables of published figures: ``python tools/make_hrp2.py``.

The tables hold the trunk, the head and the left side; the right side is their mirror image, so the model is symmetric
wherever the published figures are. ``--check`` writes nothing and says whether the file is in step with the tables.
All joint frames are parallel to the base's (BODY, between the hips) in the zero pose, where legs are straight and arms
hang: x forward, y left, z up; m, rad, kg.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from hrp2_shapes import BODIES, COLOURS, VISUALS
from urdf_writer import HERE, Joint, Mass, Point, Robot, X, Y, Z, write_or_check

MODEL: Final = Path(__file__).resolve().parents[1] / "plugins" / "robots" / "models" / "hrp2.urdf"

# Lengths: two descriptions of sister robots that agree, hrp2.rob of Klampt-examples (BSD-3) and HRP2JSKNTS of
# rtmros_tutorials, but for two. The waist joints lie 350.7 mm over the hips (the latter; the former has 3 mm less
# there and lifts the base by as much). The shoulders lie 250 mm beside the middle (the former; the latter's are wider).
HIP_Y: Final = 0.060
THIGH, SHANK, ANKLE_Y, FOOT = 0.300, 0.300, 0.035, 0.105
WAIST: Final = (0.032, 0.0, 0.3507)
NECK: Final = (-0.007, 0.0, 0.2973)
SHOULDER: Final = (0.008, 0.250, 0.181)
UPPER_ARM, FOREARM = 0.250, 0.250
FINGERS: Final = (0.0219, 0.0, -0.095)
HAND: Final = 0.160  # wrist to the middle of the palm


def turning(
    name: str, parent: str, child: str, origin: Point, axis: Point, degrees: tuple[float, float],
    speed: float, torque: float,
) -> Joint:  # fmt: skip
    """Return a joint, its range [deg], speed [rad/s] and torque [N m]."""
    lower, upper = (math.radians(d) for d in degrees)
    return Joint(name, parent, child, origin, axis, (lower, upper), speed, torque)


# Ranges: hrp2.rob. Speeds and torques: HRP2JSKNTS, whose wrists and hands differ: 6.6 rad/s and 18 N m are its wrists'
# values, the fingers' are a guess about the same gears with less force.
JOINTS: Final = (
    turning("CHEST_JOINT0", "BODY", "CHEST_LINK0", WAIST, Z, (-45, 45), 4.4, 151.8),
    turning("CHEST_JOINT1", "CHEST_LINK0", "CHEST_LINK1", HERE, Y, (-5, 60), 2.4, 278.9),
    turning("HEAD_JOINT0", "CHEST_LINK1", "HEAD_LINK0", NECK, Z, (-45, 45), 6.88, 9.6),
    turning("HEAD_JOINT1", "HEAD_LINK0", "HEAD_LINK1", HERE, Y, (-30, 45), 6.88, 9.6),
)
LEFT_JOINTS: Final = (
    turning("LLEG_JOINT0", "BODY", "LLEG_LINK0", (0.0, HIP_Y, 0.0), Z, (-30, 45), 3.54, 86.2),
    turning("LLEG_JOINT1", "LLEG_LINK0", "LLEG_LINK1", HERE, X, (-20, 35), 3.81, 175.4),
    turning("LLEG_JOINT2", "LLEG_LINK1", "LLEG_LINK2", HERE, Y, (-125, 42), 4.42, 151.4),
    turning("LLEG_JOINT3", "LLEG_LINK2", "LLEG_LINK3", (0.0, 0.0, -THIGH), Y, (-2, 150), 3.98, 168.3),
    turning("LLEG_JOINT4", "LLEG_LINK3", "LLEG_LINK4", (0.0, ANKLE_Y, -SHANK), Y, (-75, 42), 5.08, 131.6),
    turning("LLEG_JOINT5", "LLEG_LINK4", "LLEG_LINK5", HERE, X, (-35, 20), 9.14, 73.1),
    Joint("l_sole_joint", "LLEG_LINK5", "l_sole", (0.0, 0.0, -FOOT)),
    turning("LARM_JOINT0", "CHEST_LINK1", "LARM_LINK0", SHOULDER, Y, (-180, 60), 4.17, 160.3),
    turning("LARM_JOINT1", "LARM_LINK0", "LARM_LINK1", HERE, X, (-10, 95), 2.42, 100.4),
    turning("LARM_JOINT2", "LARM_LINK1", "LARM_LINK2", HERE, Z, (-92, 92), 4.16, 48.7),
    turning("LARM_JOINT3", "LARM_LINK2", "LARM_LINK3", (0.0, 0.0, -UPPER_ARM), Y, (-137, 2), 2.24, 108.5),
    turning("LARM_JOINT4", "LARM_LINK3", "LARM_LINK4", (0.0, 0.0, -FOREARM), Z, (-92, 92), 4.73, 13.9),
    turning("LARM_JOINT5", "LARM_LINK4", "LARM_LINK5", HERE, Y, (-92, 92), 6.6, 18.0),
    turning("LARM_JOINT6", "LARM_LINK5", "LARM_LINK6", FINGERS, Y, (-60, 16), 6.6, 5.0),
    Joint("l_hand_joint", "LARM_LINK5", "l_hand", (0.0, 0.0, -HAND)),
)

# Masses, their centres and inertia about them: hrp2.rob, which adds up to 56.04 kg of the robot's 58.
MASSES: Final = {
    "BODY": Mass(
        15.02949, (-0.01435, 0.0, 0.22008),
        (0.161026, -2.65e-07, 0.000707, 0.09528, -1.95e-07, 0.191914),
    ),
    "CHEST_LINK0": Mass(
        0.78637, (-0.01580, 0.00530, -0.02520),
        (0.00181617, -7.32e-05, -0.000277, 0.00185079, -0.000107, 0.00233207),
    ),
    "CHEST_LINK1": Mass(
        11.52457, (-0.02905, 0.00716, 0.12102),
        (0.160476, -0.00136, -0.00414, 0.136846, 0.00388, 0.181669),
    ),
    "HEAD_LINK0": Mass(
        0.37477, (-0.00088, 0.00426, -0.00803),
        (0.00039945, -9.9e-07, 2.26e-06, 0.00022558, -1.18e-05, 0.00036246),
    ),
    "HEAD_LINK1": Mass(
        0.99335, (0.01299, 0.00009, 0.07876),
        (0.00539717, -2.17e-05, 0.000693, 0.00457493, -6.37e-05, 0.00590682),
    ),
}  # fmt: skip
LEFT_MASSES: Final = {
    "LLEG_LINK0": Mass(
        1.16852, (-0.01038, -0.00484, 0.06490),
        (0.00285998, 1.43e-05, -0.000556, 0.00352974, -8.85e-06, 0.00145427),
    ),
    "LLEG_LINK1": Mass(
        0.80553, (-0.00040, 0.02613, -0.00292),
        (0.00126683, -1.21e-05, 1.64e-06, 0.00050656, -6.94e-05, 0.00132021),
    ),
    "LLEG_LINK2": Mass(
        2.07632, (0.00346, 0.07794, -0.15168),
        (0.0261976, 3.95e-05, 0.000574, 0.0249235, -0.00067, 0.00376439),
    ),
    "LLEG_LINK3": Mass(
        1.74762, (0.01799, 0.05792, -0.13839),
        (0.0223268, 9.39e-05, -0.00225, 0.022506, 0.000745, 0.00455443),
    ),
    "LLEG_LINK4": Mass(
        0.65375, (0.00827, 0.00133, -0.00242),
        (0.00027773, 5.26e-06, 1.35e-05, 0.00078966, 3.59e-06, 0.00086039),
    ),
    "LLEG_LINK5": Mass(
        1.63877, (-0.00066, 0.00469, -0.06538),
        (0.00400076, -9.98e-05, 0.000793, 0.00687611, 0.000185, 0.00711516),
    ),
    "LARM_LINK0": Mass(
        0.81008, (-0.00989, -0.04645, -0.00015),
        (0.00221115, 0.000304, 1.47e-06, 0.00184189, -4.67e-05, 0.00344772),
    ),
    "LARM_LINK1": Mass(
        1.03448, (-0.01056, 0.01204, -0.00948),
        (0.00122098, -0.000281, 9.41e-05, 0.00172216, -0.00012, 0.00161319),
    ),
    "LARM_LINK2": Mass(
        1.59929, (-0.00543, 0.00480, -0.16687),
        (0.00973049, 5.13e-05, -0.000199, 0.00970372, -0.000137, 0.00135331),
    ),
    "LARM_LINK3": Mass(
        0.77725, (-0.00001, 0.01617, -0.06270),
        (0.00232668, -7e-08, -3.1e-07, 0.00212476, -0.000151, 0.00056363),
    ),
    "LARM_LINK4": Mass(
        0.55467, (0.00248, 0.00362, 0.04150),
        (0.00132103, 9.3e-06, -3.62e-05, 0.00119868, 0.00012, 0.00031664),
    ),
    "LARM_LINK5": Mass(
        0.71190, (-0.00072, -0.00179, -0.07319),
        (0.00182453, -4.57e-06, -0.000136, 0.00175065, 9.45e-05, 0.00044863),
    ),
    "LARM_LINK6": Mass(
        0.08613, (-0.00187, 0.00409, -0.03012),
        (9.887e-05, 7.5e-07, -8.1e-06, 9.524e-05, 1.28e-05, 1.502e-05),
    ),
}  # fmt: skip


def right_name(name: str) -> str:
    """Return the right side's name of a left link or joint; others unchanged."""
    if name.startswith(("LLEG_", "LARM_")):
        return f"R{name[1:]}"
    return f"r{name[1:]}" if name.startswith("l_") else name


ROBOT: Final = Robot(
    name="hrp2",
    title="HRP-2",
    script="make_hrp2.py",
    base="BODY",
    right_name=right_name,
    joints=JOINTS,
    left_joints=LEFT_JOINTS,
    masses=MASSES,
    left_masses=LEFT_MASSES,
    visuals=VISUALS,
    bodies=BODIES,
    colours=COLOURS,
)


if __name__ == "__main__":
    raise SystemExit(write_or_check(ROBOT, MODEL))
