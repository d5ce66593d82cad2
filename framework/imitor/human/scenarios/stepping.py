"""Motions that move the feet: a step, two steps and a reach, walking and walking in place."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.human.choreography import SIGN, STANCE, Choreography, Reach
from imitor.human.scenarios.scenario import Options, Scenario
from imitor.human.trajectories import plateau, through
from imitor.types import Array

rad: Final = np.radians
_OTHER: Final = {"left": "right", "right": "left"}


def _goal(score: Choreography, side: str, x: float) -> Array:
    return np.array([x, SIGN[side] * STANCE * score.height])


def _step_length(score: Choreography, options: Options, own: float) -> float:
    return options.step_length_m if options.step_length_m is not None else own * score.height


def step_forward(score: Choreography, options: Options) -> None:
    """Shift the weight, lift the leading foot high, set it ahead, and stand between the feet."""
    length = _step_length(score, options, 0.18)
    score.step(
        "left",
        2.0,
        4.4,
        _goal(score, "left", length),
        height=0.105 * score.height,
        roll_off=rad(18),
        strike=rad(8),
    )
    over = score.over("right", 0.0)
    score.lead_com([(0.4, score.between(0.0)), (1.9, over), (4.4, over), (6.0, score.between(6.0))])
    score.swing_arms(0.9)
    score.lean_with_weight()
    score.spine[:, 1] += rad(3) * plateau(score.time, 0.6, 2.0, 4.4, 5.8)


def two_steps_and_reach(score: Choreography, options: Options) -> None:
    """Step forward with one foot, bring up the other, and reach far ahead with that side's hand."""
    t, H = score.time, score.height
    length = _step_length(score, options, 0.20)
    style = {"height": 0.085 * H, "roll_off": rad(20), "strike": rad(8)}
    score.step("left", 1.7, 3.2, _goal(score, "left", length), **style)
    score.step("right", 4.9, 6.4, _goal(score, "right", length), **style)
    first, second = score.over("right", 0.0), score.over("left", 4.0)
    end = score.between(7.0)
    ahead = end + np.array([0.020 * H, -0.008 * H])
    score.lead_com(
        [
            (0.3, score.between(0.0)),
            (1.6, first),
            (3.2, first),
            (4.8, second),
            (6.4, second),
            (7.6, end),
            (9.2, ahead),
            (10.0, ahead),
            (11.6, end),
        ]
    )
    score.swing_arms(0.8)
    score.lean_with_weight()
    lean = plateau(t, 7.5, 9.2, 10.0, 11.6)
    score.pelvis[:, 1] += rad(20) * lean
    score.spine[:, 1] += rad(12) * lean
    score.spine[:, 0] += rad(14) * lean
    score.drop += 0.012 * H * lean
    score.arms["left"].flexion -= rad(14) * lean
    score.arms["left"].abduction += rad(10) * lean
    hand = np.array([length + 0.55 * H, -0.06 * H, 0.70 * H])
    score.reaches["right"] = Reach(
        lean, np.tile(hand, (len(t), 1)), np.full(len(t), rad(75)), np.array([-0.2, -0.6, -0.8])
    )


def walk_in_place(score: Choreography, options: Options) -> None:
    """Lift one foot after the other slowly, the knee rising forward, the weight over the standing foot."""
    T, H = score.length_s, score.height
    period, first = 2.1, 1.3
    n = max(int((T - first - 0.9) / period + 1e-6), 1)
    points: list[tuple[float, Array]] = [(0.2, score.between(0.0))]
    side = "left"
    for i in range(n):
        off = first + i * period
        on = off + 1.1
        foot = score.feet[side]
        up = np.clip((score.time - off) / (on - off), 0.0, 1.0)
        score.step(side, off, on, foot.place[-1], height=0.105 * H, roll_off=rad(24), strike=0.0)
        stance = score.over(_OTHER[side], 0.0)
        points += [(off, stance), (on, stance)]
        raised = 64.0 * (up * (1.0 - up)) ** 3
        for arm_side, share in ((side, -0.5), (_OTHER[side], 1.0)):
            score.arms[arm_side].flexion += rad(22) * share * raised
            score.arms[arm_side].elbow += rad(16) * max(share, 0.0) * raised
        score.spine[:, 0] -= SIGN[_OTHER[side]] * rad(5) * raised
        side = _OTHER[side]
    points.append((points[-1][0] + 1.0, score.between(0.0)))
    score.lead_com(points)
    score.lean_with_weight()


def walk(score: Choreography, options: Options) -> None:
    """Walk straight ahead at a steady, careful pace and stop with the feet side by side."""
    t, H, T = score.time, score.height, score.length_s
    length = _step_length(score, options, 0.235)
    period, swing, first = 0.85, 0.62, 1.2
    n = max(int((T - first - 1.3) / period + 1e-6), 2)
    side, x = "left", 0.0
    middle = score.between(0.0)
    points: list[tuple[float, Array]] = [(0.2, middle)]
    for i in range(n):
        off, on = first + i * period, first + i * period + swing
        stance = score.over(_OTHER[side], off)
        share = 0.45 if i else 0.75
        at = np.array([stance[0], middle[1] + share * (stance[1] - middle[1])])
        points.append((0.5 * (off + on), at))
        x += length if i < n - 1 else 0.0
        score.step(side, off, on, _goal(score, side, x), height=0.042 * H, roll_off=rad(28), strike=rad(12))
        side = _OTHER[side]
    points.append((points[-1][0] + 1.3, score.between(T)))
    score.com = through(t, points)
    score.swing_arms(1.15)
    score.lean_with_weight(0.9)
    score.pelvis[:, 1] += rad(2) * plateau(t, 0.6, 1.6, T - 1.6, T - 0.6)
    score.drop += 0.008 * H * plateau(t, 0.4, 1.2, T - 1.4, T - 0.5)


SCENARIOS: Final = (
    Scenario(
        "step_forward", "one step forward: double, single, double support", 6.5, step_forward, steps=True
    ),
    Scenario(
        "two_steps_and_reach", "two steps, then a reach far ahead", 12.0, two_steps_and_reach, steps=True
    ),
    Scenario(
        "walk_in_place", "one foot after the other, slowly, knees rising", 11.0, walk_in_place, least_s=4.4
    ),
    Scenario(
        "walk",
        "a steady, careful walk straight ahead",
        8.4,
        walk,
        least_s=4.3,
        steps=True,
        quasi_static=False,
    ),
)
