"""Write the URDF of NAO v4 (H25) from tables of published figures: ``python tools/make_nao_v4.py``.

The tables hold the torso, the head and the left side; the right side is their mirror image, so the model is symmetric
wherever the published figures are. ``--check`` writes nothing and says whether the file is in step with the tables.
All joint frames are parallel to the torso's in the zero pose: x forward, y left, z up; m, rad, kg.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from nao_v4_shapes import BODIES, COLOURS, VISUALS
from urdf_writer import HERE, Joint, Mass, Robot, X, Y, Z, write_or_check

MODEL: Final = Path(__file__).resolve().parents[1] / "plugins" / "robots" / "models" / "nao_v4.urdf"

# Lengths: Aldebaran documentation, "H25 - Links", in m. The height of the foot is the 45.11 mm that the documentation
# gives for V3.2 and nao_description uses (45.19 mm for V3.3; there is no figure for V4).
NECK_Z: Final = 0.1265
SHOULDER_Y, SHOULDER_Z = 0.098, 0.100
UPPER_ARM, ELBOW_Y = 0.105, 0.015
LOWER_ARM: Final = 0.05595
HAND_X, HAND_Z = 0.05775, 0.01231
HIP_Y, HIP_Z = 0.050, 0.085
THIGH, TIBIA, FOOT = 0.100, 0.1029, 0.04511

HALF: Final = math.sqrt(0.5)

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


ROBOT: Final = Robot(
    name="nao_v4",
    title="NAO v4 (H25)",
    script="make_nao_v4.py",
    base="torso",
    right_name=right_name,
    joints=JOINTS,
    left_joints=LEFT_JOINTS,
    masses=MASSES,
    left_masses=LEFT_MASSES,
    visuals=VISUALS,
    bodies=BODIES,
    colours=COLOURS,
    right_limits=RIGHT_LIMITS,
    leaders=MIMICS,
)


if __name__ == "__main__":
    raise SystemExit(write_or_check(ROBOT, MODEL))
