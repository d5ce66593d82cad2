"""What moves the joints: position servos with a stiffness, a damping and the most torque each can give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from imitor.errors import RobotError
from imitor.robot.card import expand_limits
from imitor.robot.model import BASE_NV, RobotModel
from imitor.types import SIDES, Array

GRAVITY: Final = 9.81
"""[m/s^2]"""
_HUGE_NM: Final = 1e5
"""A torque limit from here on is a placeholder [N m]."""
_LEG_LEVER: Final = 0.25
"""Lever of the whole weight about a leg joint, by the standing height of the base [-]."""
_RESERVE: Final = 2.0
"""Torque for moving, by the torque for holding [-]."""
_SHORTEST_LEVER_M: Final = 0.05

V = TypeVar("V")


@dataclass(frozen=True)
class Drives:
    """The servos of the n joints: torque = kp (target - q) - kv (q' - target'), within the limit.

    Attributes:
        limit: Most torque, shape (n,) [N m or N].
        kp: Stiffness, shape (n,) [N m/rad or N/m].
        kv: Damping, shape (n,) [N m s/rad or N s/m].
        notes: What had to be assumed.
    """

    limit: Array
    kp: Array
    kv: Array
    notes: tuple[str, ...] = ()


def make_drives(
    robot: RobotModel,
    *,
    kp_per_effort: float,
    kv_per_kp: float,
    effort: Mapping[str, float] | None = None,
    kp: Mapping[str, float] | None = None,
) -> Drives:
    """Return the servos of a robot; joints that one motor moves share its torque and stiffness equally.

    Args:
        robot: The robot; its model tells the torque limits.
        kp_per_effort: Stiffness by torque limit [1/rad].
        kv_per_kp: Damping by stiffness [s].
        effort: Torque limits that the model lacks or that are lower: joint, template or ``*`` -> [N m].
        kp: Stiffnesses that do not follow the rule: joint, template or ``*`` -> [N m/rad].

    Raises:
        UnknownJoint: The robot has no such joint. RobotError: A value is not above 0.
    """
    limit = np.asarray(robot.model.effortLimit[BASE_NV:], dtype=float).copy()
    for i, value in _by_joint(robot, effort or {}, "effort_nm").items():
        limit[i] = value
    unknown = ~np.isfinite(limit) | (limit <= 0.0) | (limit >= _HUGE_NM)
    notes = []
    if unknown.any():
        limit[unknown] = holding_torques(robot)[unknown]
        names = ", ".join(n for n, u in zip(robot.joint_names, unknown, strict=True) if u)
        notes.append(f"torque limits estimated from the weight, the model has none: {names}")
    share = _share_of_motor(robot)
    limit = limit * share
    stiffness = kp_per_effort * limit
    for i, value in _by_joint(robot, kp or {}, "kp_nm_per_rad").items():
        stiffness[i] = value * share[i]
    return Drives(limit, stiffness, kv_per_kp * stiffness, tuple(notes))


def holding_torques(robot: RobotModel) -> Array:
    """Estimate the torque limit a joint should have, shape (n,) [N m].

    Twice what holds the limb behind the joint level; between base and sole twice what the whole weight makes at a
    lever of a quarter of the base's height.
    """
    import pinocchio as pin

    model, data = robot.model, robot.model.createData()
    pin.centerOfMass(model, data, robot.standing, True)
    feet = sum(robot.ancestors(f"{side}_foot") for side in SIDES)
    leg = np.asarray(feet)[BASE_NV:] > 0.0
    whole = data.mass[0] * _LEG_LEVER * float(robot.standing[2])
    limb = np.array(
        [
            data.mass[j] * max(float(np.linalg.norm(data.com[j])), _SHORTEST_LEVER_M)
            for j in range(2, model.njoints)
        ]
    )
    return np.asarray(_RESERVE * GRAVITY * np.where(leg, whole, limb))


def coupled_groups(robot: RobotModel) -> list[tuple[int, dict[int, float]]]:
    """Return the joints that one motor moves: first joint, and follower -> motion per motion of the first [-]."""
    if robot.coupling is None:
        return []
    groups = []
    for first, column in zip(robot.coupling.argmax(axis=0).tolist(), robot.coupling.T, strict=True):
        followers = {
            int(i): float(column[i] / column[first]) for i in np.flatnonzero(column) if int(i) != first
        }
        if followers:
            groups.append((int(first), followers))
    return groups


def _share_of_motor(robot: RobotModel) -> Array:
    share = np.ones(robot.n)
    for first, followers in coupled_groups(robot):
        share[[first, *followers]] = 1.0 / (1 + len(followers))
    return share


def _by_joint(robot: RobotModel, values: Mapping[str, float], where: str) -> dict[int, float]:
    out = expand_limits(values)
    default = out.pop("*", None)
    found = {} if default is None else dict.fromkeys(range(robot.n), default)
    found |= {robot.joint_index(name, where): value for name, value in out.items()}
    if any(not value > 0.0 for value in found.values()):
        raise RobotError(f"{where}: every value must be above 0")
    return found
