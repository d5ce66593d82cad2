"""Motions of the hands: one hand up and down at a given speed, and a drawer opened and closed with both."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.human.choreography import SIGN, Choreography, Reach
from imitor.human.scenarios.scenario import Options, Scenario
from imitor.human.trajectories import plateau
from imitor.types import ROLE_INDEX, SIDES

rad: Final = np.radians


def arm_length(score: Choreography) -> float:
    """Return the length from shoulder to knuckles [m]."""
    return sum(score.body.length(part) for part in ("upper_arm", "forearm", "hand"))


def shoulder_height(score: Choreography) -> float:
    """Return the height of the shoulders of the standing body [m]."""
    return float(score.body.rest[ROLE_INDEX["left_shoulder"], 2])


def hand_updown(score: Choreography, options: Options) -> None:
    """Move one hand up and down before the body; ``hand_speed_m_s`` is reached in every stroke."""
    t, T, H = score.time, score.length_s, score.height
    reach = plateau(t, 0.4, 2.0, T - 2.0, T - 0.4)
    swing = plateau(t, 2.0, 3.2, T - 3.2, T - 2.0)
    amplitude = 0.10 * H
    arm = arm_length(score)
    pulse = options.hand_speed_m_s / options.speed / amplitude
    hand = np.tile([0.64 * arm, 0.11 * H, shoulder_height(score) - 0.16 * H], (len(t), 1))
    hand[:, 2] += amplitude * swing * np.sin(pulse * (t - 0.5 * T))
    score.reaches["left"] = Reach(reach, hand, np.full(len(t), rad(-82)), np.array([-0.3, 0.5, -0.8]))
    score.head[:, 1] += rad(6) * reach
    score.spine[:, 0] -= rad(3) * reach


def open_close_drawer(score: Choreography, options: Options) -> None:
    """Grasp a drawer's handle with both hands, pull it out, push it back and let go."""
    t, H = score.time, score.height
    n = len(t)
    arm = arm_length(score)
    travel = 0.37 * arm if options.pull_m is None else options.pull_m
    apart = 0.085 * H if options.grip_m is None else options.grip_m
    height, closed = shoulder_height(score) - 0.57 * arm, 0.78 * arm
    pulled = plateau(t, 3.0, 5.0, 5.8, 7.8)
    near = plateau(t, 0.5, 2.6, 8.2, 10.2)
    score.grasped = (t >= 2.6) & (t <= 8.2)
    score.handle = np.tile(np.eye(4), (n, 1, 1))
    score.handle[:, :3, 3] = np.column_stack([closed - travel * pulled, np.zeros(n), np.full(n, height)])
    for side in SIDES:
        hand = score.handle[:, :3, 3] + np.array([0.0, SIGN[side] * apart, 0.0])
        yaw = np.full(n, -SIGN[side] * rad(88))
        score.reaches[side] = Reach(near, hand, yaw, np.array([-0.5, SIGN[side] * 0.45, -0.75]))
    bent = near * (1.0 - 0.8 * pulled)
    score.pelvis[:, 1] += rad(12) * bent
    score.spine[:, 1] += rad(8) * bent
    score.drop += 0.015 * H * near
    score.com[:, 0] += 0.008 * H * near * (1.0 - 1.6 * pulled)
    score.head[:, 1] += rad(14) * near


SCENARIOS: Final = (
    Scenario(
        "hand_updown",
        "one hand up and down before the body at a given speed",
        12.0,
        hand_updown,
        "right",
        least_s=8.0,
    ),
    Scenario(
        "open_close_drawer", "both hands grasp a drawer's handle, pull and push it", 11.0, open_close_drawer
    ),
)
