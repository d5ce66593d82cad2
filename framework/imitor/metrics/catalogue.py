"""Every figure, in the order of the report."""

from __future__ import annotations

from typing import Final

from imitor.metrics import balance, collision, feet, imitation, joints, support, timing
from imitor.metrics.figure import Figure

FIGURES: Final[tuple[Figure, ...]] = (
    imitation.mean_direction_error,
    imitation.direction_error,
    imitation.end_effector_error,
    imitation.support_agreement,
    support.support_delay,
    support.single_support_executed,
    support.human_unseen,
    support.human_flight,
    feet.slip_in_human_contact,
    feet.slip_in_declared_contact,
    feet.penetration,
    feet.penetration_frames,
    feet.float_height,
    feet.contact_disagreement,
    feet.flight,
    balance.com_margin,
    balance.zmp_margin,
    joints.limit_violations,
    joints.joint_speed,
    joints.joint_speed_ratio,
    joints.overspeed,
    joints.saturated,
    joints.base_speed,
    joints.acceleration_ratio,
    joints.jumps,
    joints.jerk,
    collision.self_collision,
    timing.compute_time,
    timing.compute_share,
    timing.held,
)
"""A new figure is written in its module with `imitor.metrics.figure.figure` and named here."""
