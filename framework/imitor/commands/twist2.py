"""The keys of TWIST2's store, and the 35 numbers that its tracker imitates [ze2025]."""

from __future__ import annotations

import math
from typing import Final

from imitor.types import Array, IntArray

ROBOT: Final = "unitree_g1_with_hands"
BODY: Final = f"action_body_{ROBOT}"
HANDS: Final = (f"action_hand_left_{ROBOT}", f"action_hand_right_{ROBOT}")
NECK: Final = f"action_neck_{ROBOT}"
TIME: Final = "t_action"
N_HAND: Final = 7
N_NECK: Final = 2


def roll_pitch(quaternion: Array) -> tuple[float, float]:
    """Return roll and pitch of R = Rz(yaw) Ry(pitch) Rx(roll) [rad], of a quaternion x y z w, shape (4,)."""
    x, y, z, w = (float(c) for c in quaternion)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(min(1.0, max(-1.0, 2.0 * (w * y - z * x))))
    return roll, pitch


def mimic(q: Array, v: Array, order: IntArray) -> list[float]:
    """Return what the tracker imitates, 35 numbers.

    Velocity x, y of the base in the base frame [m/s], its height over the floor [m], roll and pitch [rad], yaw rate
    in the base frame [rad/s], then the joints limb after limb [rad].

    Args:
        q: Configuration, shape (nq,).
        v: Velocity, base in the base frame, shape (nv,).
        order: Where the joints are in the configuration, among the joints.
    """
    roll, pitch = roll_pitch(q[3:7])
    base = [float(v[0]), float(v[1]), float(q[2]), roll, pitch, float(v[5])]
    joints: list[float] = q[7:][order].tolist()
    return base + joints


__all__ = ["BODY", "HANDS", "NECK", "N_HAND", "N_NECK", "TIME", "mimic", "roll_pitch"]
