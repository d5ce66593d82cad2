"""Work with both hands [tomic2018] section 5: valve, canoe paddle, pump, steering wheel, knife, grater.

Lengths are in arms and statures, so that every body can do the work.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.human.choreography import SIGN, Choreography, Reach
from imitor.human.scenarios.hands import arm_length, shoulder_height
from imitor.human.scenarios.scenario import Options, Scenario
from imitor.human.trajectories import plateau
from imitor.types import SIDES, Array

rad: Final = np.radians


def _work(
    score: Choreography, hands: dict[str, Array], yaw: dict[str, Array], elbow_out: float = 0.45
) -> Array:
    """Bring the hands to their work and back; return how far they are there (T,)."""
    t, T = score.time, score.length_s
    there = plateau(t, 0.4, 2.2, T - 2.2, T - 0.4)
    for side in SIDES:
        pole = np.array([-0.5, SIGN[side] * elbow_out, -0.75])
        score.reaches[side] = Reach(there, hands[side], yaw[side], pole)
    score.head[:, 1] += rad(12) * there
    return there


def _stroke(score: Choreography, per_s: float) -> tuple[Array, Array]:
    """Return the phase of a repeated movement [rad] and how strongly it is made, 0 while reaching."""
    t, T = score.time, score.length_s
    strong = plateau(t, 2.2, 3.4, T - 3.4, T - 2.2)
    return 2 * np.pi * per_s * (t - 2.2), strong


def _inwards(score: Choreography, side: str, degrees: float = 84.0) -> Array:
    """Return the yaw of a hand that points forwards (90 degrees would be straight ahead)."""
    return np.full(len(score.time), -SIGN[side] * rad(degrees))


def _place(score: Choreography, x: Array | float, y: Array | float, z: Array | float) -> Array:
    n = len(score.time)
    return np.column_stack([np.broadcast_to(v, (n,)) for v in (x, y, z)])


def _wheel(score: Choreography, radius: float, centre: tuple[float, float], turn: Array, lean: float) -> None:
    """Turn a wheel that faces the person, leaning back by ``lean`` [rad], held at both sides."""
    x, z = centre
    hands, yaw = {}, {}
    for side in SIDES:
        angle = turn + (0.0 if side == "left" else np.pi)
        up = radius * np.sin(angle)
        hands[side] = _place(score, x + up * np.sin(lean), radius * np.cos(angle), z + up * np.cos(lean))
        yaw[side] = _inwards(score, side)
    _work(score, hands, yaw)


def turn_valve(score: Choreography, options: Options) -> None:
    """Turn a valve's wheel before the chest to and fro by a third of a turn."""
    arm, phase = arm_length(score), _stroke(score, 0.22)
    turn = rad(58) * phase[1] * np.sin(phase[0])
    _wheel(score, 0.20 * arm, (0.62 * arm, shoulder_height(score) - 0.42 * arm), turn, rad(5))
    score.spine[:, 0] += 0.08 * turn


def turn_steering_wheel(score: Choreography, options: Options) -> None:
    """Steer with both hands on a wheel that leans towards the person."""
    arm, phase = arm_length(score), _stroke(score, 0.30)
    turn = rad(40) * phase[1] * (np.sin(phase[0]) + 0.3 * np.sin(2.3 * phase[0]))
    _wheel(score, 0.30 * arm, (0.60 * arm, shoulder_height(score) - 0.36 * arm), turn, rad(35))
    score.spine[:, 0] += 0.05 * turn


def paddle_canoe(score: Choreography, options: Options) -> None:
    """Paddle a canoe on both sides in turn, the hands a constant distance apart."""
    arm, (phase, strong) = arm_length(score), _stroke(score, 0.32)
    tilt = rad(34) * strong * np.sin(phase)
    swing = rad(16) * strong * np.cos(phase)
    shaft = 0.33 * arm
    hands, yaw = {}, {}
    middle = _place(
        score, 0.60 * arm + 0.05 * arm * strong * np.cos(2 * phase), 0.0, shoulder_height(score) - 0.42 * arm
    )
    along = np.column_stack([np.cos(tilt) * np.sin(swing), np.cos(tilt) * np.cos(swing), np.sin(tilt)])
    for side in SIDES:
        hands[side] = middle + SIGN[side] * shaft * along
        yaw[side] = _inwards(score, side)
    _work(score, hands, yaw)
    score.spine[:, 0] += 0.5 * swing
    score.spine[:, 2] += 0.06 * tilt


def pump_mattress(score: Choreography, options: Options) -> None:
    """Press the handle of an upright pump down and pull it up with both hands, the trunk going along."""
    arm, (phase, strong) = arm_length(score), _stroke(score, 0.35)
    down = 0.5 * strong * (1.0 - np.cos(phase))
    height = shoulder_height(score) - 0.52 * arm - 0.26 * arm * down
    hands = {side: _place(score, 0.52 * arm, SIGN[side] * 0.15 * arm, height) for side in SIDES}
    _work(score, hands, {side: _inwards(score, side) for side in SIDES})
    score.spine[:, 1] += rad(8) * down
    score.pelvis[:, 1] += rad(8) * down
    score.drop += 0.015 * score.height * down


def cut_with_knife(score: Choreography, options: Options) -> None:
    """Hold with one hand and cut with the other, to and fro and slowly down."""
    arm, (phase, strong) = arm_length(score), _stroke(score, 0.7)
    table = shoulder_height(score) - 0.62 * arm
    along = 0.09 * arm * strong * np.sin(phase)
    rock = 0.03 * arm * strong * np.cos(phase)
    hands = {
        "left": _place(score, 0.55 * arm + along, 0.10 * arm, table + 0.06 * arm + rock),
        "right": _place(score, 0.55 * arm, -0.14 * arm, table),
    }
    yaw = {
        "left": _inwards(score, "left", 80.0),
        "right": _inwards(score, "right", 62.0),
    }
    _work(score, hands, yaw)
    score.spine[:, 1] += rad(3) * strong
    score.spine[:, 0] -= 0.15 * along / arm


def grate_food(score: Choreography, options: Options) -> None:
    """Hold a grater with one hand and rub up and down along it with the other."""
    arm, (phase, strong) = arm_length(score), _stroke(score, 0.8)
    table = shoulder_height(score) - 0.58 * arm
    stroke = strong * np.sin(phase)
    hands = {
        "left": _place(
            score, 0.54 * arm + 0.04 * arm * stroke, 0.04 * arm, table + 0.10 * arm + 0.10 * arm * stroke
        ),
        "right": _place(score, 0.60 * arm, -0.16 * arm, table + 0.16 * arm),
    }
    yaw = {"left": _inwards(score, "left", 78.0), "right": _inwards(score, "right", 66.0)}
    _work(score, hands, yaw)
    score.spine[:, 0] -= rad(2) * stroke


SCENARIOS: Final = (
    Scenario("turn_valve", "both hands turn a valve's wheel to and fro", 12.0, turn_valve, least_s=9.0),
    Scenario("paddle_canoe", "both hands paddle on both sides in turn", 12.0, paddle_canoe, least_s=9.0),
    Scenario("pump_mattress", "both hands press and pull a pump's handle", 12.0, pump_mattress, least_s=9.0),
    Scenario("turn_steering_wheel", "both hands steer with a wheel", 12.0, turn_steering_wheel, least_s=9.0),
    Scenario("cut_with_knife", "one hand holds, the other cuts", 11.0, cut_with_knife, "right", least_s=9.0),
    Scenario(
        "grate_food",
        "one hand holds a grater, the other rubs along it",
        11.0,
        grate_food,
        "right",
        least_s=9.0,
    ),
)
