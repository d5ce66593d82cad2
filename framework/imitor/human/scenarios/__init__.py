"""The authored motions by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from imitor.human.body import Body
from imitor.human.choreography import Choreography
from imitor.human.masses import full_weights
from imitor.human.performance import Truth, joint_angles, mirrored, perform
from imitor.human.scenarios import balancing, hands, standing, stepping, tasks
from imitor.human.scenarios.scenario import Options, Scenario
from imitor.human.trajectories import rise
from imitor.types import N_ROLES, Array

SCENARIOS: Final[Mapping[str, Scenario]] = MappingProxyType(
    {s.name: s for module in (standing, stepping, balancing, hands, tasks) for s in module.SCENARIOS}
)
"""Every motion the performer knows."""
ARMS_DOWN_S: Final = 2.0
"""How long the arms take from the calibration pose to where the motion begins [s]."""


def play(name: str, body: Body, options: Options, rate_hz: float) -> Truth:
    """Perform a scenario.

    Args:
        name: A key of `SCENARIOS`.
        body: Who performs it.
        options: How.
        rate_hz: Frames per second [Hz].
    """
    scenario = SCENARIOS[name]
    length = scenario.length_s(options)
    lead = options.arms_forward_s + ARMS_DOWN_S if options.arms_forward_s > 0.0 else 0.0
    n = max(int(np.floor((length / options.speed + lead) * rate_hz + 1e-9)) + 1, 2)
    time_s = np.arange(n) / rate_hz
    if scenario.author is None:
        return _rest(body, time_s)
    score = Choreography((time_s - lead) * options.speed, body)
    scenario.author(score, options)
    if lead:
        hold_arms_forward(score, -ARMS_DOWN_S * options.speed)
    score.breathe()
    score.keep_gaze()
    truth = perform(score, time_s)
    return truth if (options.side or scenario.side) == "left" else mirrored(truth)


def hold_arms_forward(score: Choreography, until: float) -> None:
    """Hold the arms stretched forward, palms down, until an authored time before 0 [s], and lower them until 0."""
    share = 1.0 - rise(score.time, until, 0.0)
    for arm in score.arms.values():
        goal = {
            "flexion": 90.0,
            "abduction": 0.0,
            "twist": 0.0,
            "elbow": 2.0,
            "pronation": 90.0,
            "wrist": 0.0,
        }
        for name, degrees in goal.items():
            course = getattr(arm, name)
            course += share * (np.radians(degrees) - course)
        arm.abduction += (
            np.radians(30.0) * 4.0 * share * (1.0 - share)
        )  # down at the sides, past what is in front


def _rest(body: Body, time_s: Array) -> Truth:
    """Hold the rest pose exactly: the T-pose that captures begin with."""
    n = len(time_s)
    position = np.tile(body.rest, (n, 1, 1))
    orientation = np.tile(np.eye(3), (n, N_ROLES, 1, 1))
    com = np.asarray(np.tensordot(position, full_weights(body.sex), axes=(1, 0)))
    return Truth(time_s, position, orientation, np.ones((n, 2), dtype=bool), com, joint_angles(orientation))
