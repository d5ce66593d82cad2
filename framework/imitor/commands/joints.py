"""Joint names on both sides: those of the robot's card, and those that the receiver knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from imitor.errors import SinkError, did_you_mean
from imitor.robot.card import expand
from imitor.types import IntArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


def renamed(robot: RobotModel, names: Mapping[str, str]) -> list[str]:
    """Return the receiver's names of the robot's joints, in the robot's order.

    Args:
        robot: The robot.
        names: Name in the card -> name at the receiver, where they differ; both may be templates with ``{side}``.

    Raises:
        UnknownJoint: The robot has no such joint. SinkError: Two joints would get one name.
    """
    out = list(robot.joint_names)
    for key, value in names.items():
        sides = expand({key: 0})
        for name, other in zip(sides, expand({value: 0}) if "{" in key else [value], strict=True):
            out[robot.joint_index(name, "joints")] = other
    twice = sorted({name for name in out if out.count(name) > 1})
    if twice:
        raise SinkError(f"option `joints` gives the name {', '.join(twice)} to two joints; names must differ")
    return out


def places(robot: RobotModel, order: Sequence[str], who: str) -> IntArray:
    """Return where the joints of another order are among the robot's, shape (len(order),).

    Args:
        robot: The robot; it must have exactly these joints.
        order: Names, in the other order.
        who: Whose order it is, for the message.

    Raises:
        SinkError: The robot has other joints.
    """
    missing = [name for name in order if name not in robot.joint_names]
    surplus = [name for name in robot.joint_names if name not in order]
    if missing or surplus:
        name = (missing or surplus)[0]
        hint = did_you_mean(name, robot.joint_names if missing else order)
        raise SinkError(
            f"{who} moves {len(order)} joints, and robot '{robot.name}' "
            + (f"lacks {name}" if missing else f"has {name} besides")
            + (f"; {hint}" if hint else "")
            + "; choose the robot with --robot, or another sink"
        )
    return np.array([robot.joint_names.index(name) for name in order], dtype=np.int_)


__all__ = ["places", "renamed"]
