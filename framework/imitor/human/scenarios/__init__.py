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
from imitor.human.scenarios import balancing, hands, standing, stepping
from imitor.human.scenarios.scenario import Options, Scenario
from imitor.types import N_ROLES, Array

SCENARIOS: Final[Mapping[str, Scenario]] = MappingProxyType(
    {s.name: s for module in (standing, stepping, balancing, hands) for s in module.SCENARIOS}
)
"""Every motion the performer knows."""


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
    n = max(int(np.floor(length / options.speed * rate_hz + 1e-9)) + 1, 2)
    time_s = np.arange(n) / rate_hz
    if scenario.author is None:
        return _rest(body, time_s)
    score = Choreography(time_s * options.speed, body)
    scenario.author(score, options)
    score.breathe()
    score.keep_gaze()
    truth = perform(score, time_s)
    return truth if (options.side or scenario.side) == "left" else mirrored(truth)


def _rest(body: Body, time_s: Array) -> Truth:
    """Hold the rest pose exactly: the T-pose that captures begin with."""
    n = len(time_s)
    position = np.tile(body.rest, (n, 1, 1))
    orientation = np.tile(np.eye(3), (n, N_ROLES, 1, 1))
    com = np.asarray(np.tensordot(position, full_weights(body.sex), axes=(1, 0)))
    return Truth(time_s, position, orientation, np.ones((n, 2), dtype=bool), com, joint_angles(orientation))
