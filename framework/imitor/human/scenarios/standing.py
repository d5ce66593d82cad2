"""Motions with both feet standing: T-pose, quiet standing, waving, a squat, a slow dance."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.human.choreography import Choreography
from imitor.human.scenarios.scenario import Options, Scenario
from imitor.human.trajectories import plateau
from imitor.types import SIDES, Array

rad: Final = np.radians


def ends(t: Array, length: float, ramp: float = 1.5) -> Array:
    """Return an envelope that is 1 in the middle and 0, at rest, at both ends."""
    ramp = min(ramp, length / 2)
    return plateau(t, 0.0, ramp, length - ramp, length)


def stand(score: Choreography, options: Options) -> None:
    """Sway as a standing person does, a few millimetres."""
    t, H = score.time, score.height
    quiet = ends(t, score.length_s)
    score.com[:, 0] += (
        0.0022 * H * quiet * (np.sin(2 * np.pi * 0.23 * t) + 0.5 * np.sin(2 * np.pi * 0.41 * t + 1.0))
    )
    score.com[:, 1] += (
        0.0016 * H * quiet * (np.sin(2 * np.pi * 0.19 * t + 2.0) + 0.4 * np.sin(2 * np.pi * 0.53 * t))
    )
    score.head[:, 0] += rad(4) * quiet * np.sin(2 * np.pi * 0.11 * t)
    score.lean_with_weight()


def wave(score: Choreography, options: Options) -> None:
    """Raise an arm beside the head and wave with the forearm."""
    t, T = score.time, score.length_s
    up = plateau(t, 0.5, 2.0, T - 2.0, T - 0.5)
    swing = plateau(t, 1.6, 2.4, T - 2.6, T - 1.8) * np.sin(2 * np.pi * 1.1 * (t - 1.6))
    arm = score.arms["left"]
    arm.abduction += rad(62) * up
    arm.flexion += rad(30) * up
    arm.twist -= rad(90) * up
    arm.elbow += rad(84) * up + rad(26) * swing
    arm.pronation += rad(40) * up
    arm.wrist += rad(-8) * up + rad(8) * swing
    score.spine[:, 2] -= rad(4) * up
    score.spine[:, 0] += rad(3) * up
    score.head[:, 0] += rad(6) * up
    score.com[:, 1] -= 0.010 * score.height * up
    score.lean_with_weight()


def squat(score: Choreography, options: Options) -> None:
    """Bend the knees to a right angle, arms forward, and stand up again."""
    t = score.time
    down = plateau(t, 0.8, 2.8, 3.4, 5.2)
    score.drop += 0.160 * score.height * down
    score.pelvis[:, 1] += rad(34) * down
    score.spine[:, 1] += rad(8) * down
    score.com[:, 0] += 0.012 * score.height * down
    for side in SIDES:
        arm = score.arms[side]
        arm.flexion += rad(112) * down
        arm.elbow += rad(4) * down
        arm.abduction -= rad(4) * down
        arm.pronation += rad(45) * down


def slow_dance(score: Choreography, options: Options) -> None:
    """Sway, turn and raise the arms in turn, knees and ankles bending, the feet fixed."""
    t, T, H = score.time, score.length_s, score.height
    on = ends(t, T, 2.0)
    beat = 2 * np.pi * t / 3.2
    score.com[:, 1] += 0.030 * H * on * np.sin(beat)
    score.com[:, 0] += 0.006 * H * on * np.sin(2 * beat)
    score.drop += 0.030 * H * on * (1.0 - np.cos(2 * beat)) / 2 + 0.012 * H * on
    score.pelvis[:, 0] += rad(9) * on * np.sin(beat + 0.5)
    score.pelvis[:, 2] += rad(3) * on * np.sin(beat)
    score.pelvis[:, 1] += rad(5) * on
    score.spine[:, 0] += rad(16) * on * np.sin(beat - 0.3)
    score.spine[:, 1] += rad(3) * on * np.sin(2 * beat + 0.4)
    score.spine[:, 2] -= rad(9) * on * np.sin(beat - 0.2)
    score.head[:, 2] += rad(6) * on * np.sin(beat - 0.6)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = score.arms[side]
        wave_up = 0.5 * (1.0 + sign * np.sin(beat - 0.5))
        arm.abduction += on * (rad(38) + rad(46) * wave_up)
        arm.flexion += on * (rad(22) + rad(16) * np.sin(beat + sign * 0.8))
        arm.twist -= on * rad(30) * wave_up
        arm.elbow += on * (rad(34) - rad(20) * wave_up + rad(8) * np.sin(2 * beat + sign))
        arm.pronation += on * (rad(30) * wave_up)
        arm.wrist += on * rad(12) * np.sin(2 * beat + sign * 0.7)


SCENARIOS: Final = (
    Scenario("t_pose", "the rest pose, held exactly", 4.0, None, least_s=0.1),
    Scenario("stand", "quiet standing with a slight sway", 6.0, stand, least_s=3.0),
    Scenario("wave", "one arm raised beside the head, the forearm waves", 7.0, wave, "right", least_s=5.5),
    Scenario("squat", "knees bent to a right angle, arms forward, and up again", 6.0, squat),
    Scenario(
        "slow_dance", "sway and turn with the arms, feet fixed, knees bending", 14.0, slow_dance, least_s=6.0
    ),
)
