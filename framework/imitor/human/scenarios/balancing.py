"""Long single support: a foot lifted, and balancing with the leg stretched back and the arms raised."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.human.choreography import Choreography
from imitor.human.scenarios.scenario import Options, Scenario
from imitor.human.trajectories import plateau
from imitor.types import ROLE_INDEX, SIDES

rad: Final = np.radians


def weight_shift_foot_lift(score: Choreography, options: Options) -> None:
    """Shift the weight onto one leg, lift the other foot, hold it for seconds and come back."""
    t, T, H = score.time, score.length_s, score.height
    off, on = 2.2, T - 2.0
    up = plateau(t, off, off + 1.3, on - 1.3, on)
    over = score.over("right", 0.0)
    score.lead_com([(0.4, score.between(0.0)), (off - 0.1, over), (on, over), (T - 0.3, score.between(0.0))])
    foot = score.feet["left"]
    foot.lift += 0.11 * H * up
    foot.place += up[:, None] * np.array([-0.03 * H, -0.005 * H])
    foot.heel_up += rad(22) * up
    score.airborne("left", off, on)
    for side in SIDES:
        score.arms[side].abduction += rad(14 if side == "left" else 20) * up
        score.arms[side].elbow += rad(8) * up
    score.spine[:, 2] -= rad(3) * up
    score.lean_with_weight()


def single_leg_balance(score: Choreography, options: Options) -> None:
    """Stand on one leg for seconds, the other stretched back, the trunk leaning forward, the arms raised."""
    t, T, H = score.time, score.length_s, score.height
    off, on = 2.2, T - 2.0
    back = plateau(t, off, off + 2.2, on - 2.2, on)
    over = score.over("right", 0.0)
    score.lead_com([(0.4, score.between(0.0)), (off - 0.1, over), (on, over), (T - 0.3, score.between(0.0))])
    foot = score.feet["left"]
    leave = plateau(t, off, off + 1.4, on - 1.4, on)
    # the ankle goes back on an arc about the hip, the leg a little short of straight
    swing = rad(60) * back
    leg = 0.978 * (score.body.length("thigh") + score.body.length("shank"))
    foot.heel_up += rad(10) * leave + rad(62) * back
    aside = foot.place[:, 1] - 0.012 * H * leave
    score.lead_ankle(
        "left",
        np.column_stack([-0.035 * H * back - leg * np.sin(swing), aside]),
        score.body.rest[ROLE_INDEX["left_ankle"], 2]
        + 0.30 * score.body.length("foot") * leave
        + leg * (1.0 - np.cos(swing)),
    )
    foot.yaw *= 1.0 - 0.8 * back
    score.airborne("left", off, on)
    score.drop += 0.004 * H * leave
    score.pelvis[:, 1] += rad(40) * back
    score.spine[:, 1] -= rad(6) * back
    for side in SIDES:
        arm = score.arms[side]
        arm.abduction += rad(80) * back
        arm.flexion += rad(24) * back
        arm.elbow -= rad(6) * back
        arm.pronation += rad(20) * back
    score.lean_with_weight()


SCENARIOS: Final = (
    Scenario("weight_shift_foot_lift", "weight onto one leg, the other foot lifted and held, and back", 10.0,
             weight_shift_foot_lift, least_s=7.0),
    Scenario("single_leg_balance", "on one leg for seconds, the other stretched back, arms raised", 13.0,
             single_leg_balance, "right", least_s=9.0),
)  # fmt: skip
