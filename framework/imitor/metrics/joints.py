"""What the robot's joints are asked to do at the output rate."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.metrics.figure import Outcome, Sample, Unmeasured, figure
from imitor.metrics.imitation import angle
from imitor.metrics.run import Run
from imitor.types import Array

LIMIT_TOLERANCE: Final = 1e-9  # [rad]
SPEED_TOLERANCE: Final = 1e-6  # [-]; differences of positions and of time stamps are rounded
SATURATED: Final = 0.99  # [-]
JUMP_RAD: Final = 0.5
STILL_RAD: Final = 0.25

_TOO_SHORT = "it takes {} frames"


def _speeds(run: Run) -> Array:
    """Return absolute joint speeds, shape (T - 1, n) [rad/s]."""
    return np.asarray(np.abs(np.diff(run.q, axis=0)) / run.period_s)


def _peak(run: Run, per_joint: Array, what: str) -> Outcome:
    """Return mean over frames of the worst joint, max over all, and the joint where that is."""
    joint = run.motion.joint_names[int(per_joint.max(axis=0).argmax())]
    return Sample.over(per_joint.max(axis=1), reason=what, joint=joint)


@figure(
    "joint_limit_violation_frames",
    unit="frames",
    formula=f"frames with a joint more than {LIMIT_TOLERANCE:g} rad outside its limits; joint_frames counts "
    "joints and frames, excess_rad is the worst",
    better="lower",
    about="Must be 0: the robot cannot go there.",
)
def limit_violations(run: Run) -> Outcome:
    """Count the frames outside the joint limits."""
    excess = np.maximum(run.lower - run.q, run.q - run.upper)
    outside = excess > LIMIT_TOLERANCE
    return Sample.count(
        outside.any(axis=1),
        np.ones(len(run)),
        reason="no frame",
        joint_frames=int(outside.sum()),
        excess_rad=max(float(excess.max()), 0.0),
    )


@figure(
    "joint_speed_rad_s",
    unit="rad/s",
    formula="|q_k − q_(k−1)| / T of the fastest joint, T the time between frames",
    better="lower",
    about="Peak speed at the output rate, and whose.",
)
def joint_speed(run: Run) -> Outcome:
    """Take the speed of the fastest joint."""
    return _peak(run, _speeds(run), "no frame") if len(run) > 1 else Unmeasured(_TOO_SHORT.format("two"))


@figure(
    "joint_speed_to_limit_ratio",
    unit="-",
    formula="the same over each joint's speed limit",
    better="lower",
    about="At most 1 where the speed limits hold.",
)
def joint_speed_ratio(run: Run) -> Outcome:
    """Take the largest ratio of speed to limit."""
    if len(run) < 2:
        return Unmeasured(_TOO_SHORT.format("two"))
    return _peak(run, _speeds(run) / run.speed, "no frame")


@figure(
    "joint_overspeed_frames",
    unit="frames",
    formula="steps from frame to frame in which a joint is faster than its limit",
    better="lower",
    about="How often the speed limits do not hold.",
)
def overspeed(run: Run) -> Outcome:
    """Count the steps above the speed limit."""
    above = (_speeds(run) > run.speed * (1.0 + SPEED_TOLERANCE)).any(axis=1) if len(run) > 1 else np.zeros(0)
    return Sample.count(above, np.ones(len(above)), reason=_TOO_SHORT.format("two"))


@figure(
    "joint_saturated_frames",
    unit="frames",
    formula=f"steps in which a joint moves at {SATURATED:.0%} of its speed limit or more",
    better="lower",
    about="How often the robot lags because a joint cannot be faster, or chatters between its limits.",
)
def saturated(run: Run) -> Outcome:
    """Count the steps at a speed limit."""
    at = (_speeds(run) >= run.speed * SATURATED).any(axis=1) if len(run) > 1 else np.zeros(0)
    return Sample.count(at, np.ones(len(at)), reason=_TOO_SHORT.format("two"))


@figure(
    "base_speed_m_s",
    unit="m/s",
    formula="|p_k − p_(k−1)| / T of the base link",
    better="lower",
    about="Lurches of the whole body, which joint speeds do not show: a standing leg moves the base.",
)
def base_speed(run: Run) -> Outcome:
    """Take the speed of the base link."""
    moved = np.linalg.norm(np.diff(run.motion.root_position_m, axis=0), axis=1) / run.period_s
    return Sample.over(moved, reason=_TOO_SHORT.format("two"))


@figure(
    "joint_acceleration_to_limit_ratio",
    unit="-",
    formula="|q_(k+1) − 2 q_k + q_(k−1)| / T² over the joint's acceleration limit, joints that have one",
    better="lower",
    about="At most 1 where the acceleration limits hold.",
)
def acceleration_ratio(run: Run) -> Outcome:
    """Take the largest ratio of acceleration to limit."""
    limited = np.isfinite(run.acceleration)
    if not limited.any():
        return Unmeasured("the robot's card gives no acceleration limit")
    if len(run) < 3:
        return Unmeasured(_TOO_SHORT.format("three"))
    ratio = np.abs(np.diff(run.q, n=2, axis=0)) / run.period_s**2 / run.acceleration
    return _peak(run, ratio, "no frame")


@figure(
    "joint_jump_frames",
    unit="frames",
    formula=f"steps with a joint moving more than {JUMP_RAD} rad while no known segment of the human turns "
    f"more than {STILL_RAD} rad",
    better="lower",
    about="Flips and snaps that the human did not ask for.",
)
def jumps(run: Run) -> Outcome:
    """Count the steps in which a joint jumps and the human does not; an unknown segment counts as still."""
    if len(run) < 2:
        return Unmeasured(_TOO_SHORT.format("two"))
    directions = np.array(list(run.human_direction.values()))
    if np.isnan(directions).all():
        return Unmeasured("no segment of the human is known")
    turned = np.array([angle(d[:-1], d[1:]) for d in directions])
    still = np.nan_to_num(turned, nan=0.0).max(axis=0) <= STILL_RAD
    moved = np.abs(np.diff(run.q, axis=0))
    jumped = (moved > JUMP_RAD).any(axis=1) & still
    return Sample.count(jumped, np.ones(len(jumped)), reason="no frame", largest_step_rad=moved.max())


@figure(
    "joint_jerk_rad_s3",
    unit="rad/s³",
    formula="root mean square over joints and frames of (q_(k+2) − 3 q_(k+1) + 3 q_k − q_(k−1)) / T³",
    better="lower",
    about="Smoothness; grows steeply with the rate, so compare runs of one rate.",
)
def jerk(run: Run) -> Outcome:
    """Take the root mean square jerk."""
    if len(run) < 4:
        return Unmeasured(_TOO_SHORT.format("four"))
    jerks = np.diff(run.q, n=3, axis=0) / run.period_s**3
    return Sample({"rms": float(np.sqrt((jerks**2).mean())), "max": float(np.abs(jerks).max())}, len(jerks))
