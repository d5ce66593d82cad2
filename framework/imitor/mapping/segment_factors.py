"""How much longer a person's segments are than a robot's, from the first samples of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from imitor.robot.growth import SCALABLE
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SEGMENTS, SIDES, Array, HumanFrame

_ENDS = {
    **{name: ends for name, ends in SEGMENTS.items() if name != "torso"},
    "left_hand": ("left_wrist", "left_hand"),
    "right_hand": ("right_wrist", "right_hand"),
    "hips": ("left_hip", "right_hip"),
    "shoulders": ("left_shoulder", "right_shoulder"),
}
_LEAST, _MOST = 0.25, 4.0
"""A factor beyond these comes from points that are no body."""


def segment_factors(robot: RobotModel, frames: Sequence[HumanFrame]) -> dict[str, float]:
    """Return SF = L_human / L_robot per segment, for `RobotModel.scaled` [tomic2018] section 3 (T1).

    Lengths are means over the samples, those of paired segments also over left and right. What neither person nor robot
    has keeps the factor of the hands (``*``), or 1.

    Args:
        robot: The robot in its own size.
        frames: Samples of the person, in any pose.
    """
    own = robot.segment_lengths()
    factors = {name: _factor(length, own.get(name)) for name, length in mean_lengths(frames).items()}
    found = {name: factor for name, factor in factors.items() if factor is not None}
    out = {name: factor for name, factor in found.items() if name in SCALABLE}
    for name in SCALABLE:
        out.setdefault(name, 1.0)  # or the factor of the hands would apply to it
    out["*"] = found.get("left_hand", 1.0)
    return out


def mean_lengths(frames: Sequence[HumanFrame]) -> Mapping[str, float]:
    """Return mean lengths of the segments that were seen, left and right alike [m]."""
    position = np.stack([f.position for f in frames])

    def point(role: str) -> Array:
        return np.asarray(position[:, ROLE_INDEX[role]])

    def middle(joint: str) -> Array:
        return 0.5 * (point(f"left_{joint}") + point(f"right_{joint}"))

    vectors = {name: point(b) - point(a) for name, (a, b) in _ENDS.items()}
    vectors["torso"] = middle("shoulder") - middle("hip")
    vectors["head"] = point("head") - middle("shoulder")
    means = {}
    for name, vector in vectors.items():
        length = np.sqrt(np.einsum("ti,ti->t", vector, vector))
        if np.isfinite(length).any():
            means[name] = float(np.nanmean(length))
    return {name: _paired(means, name) for name in means}


def _paired(means: Mapping[str, float], name: str) -> float:
    side, _, part = name.partition("_")
    pair = [means[f"{s}_{part}"] for s in SIDES if f"{s}_{part}" in means] if side in SIDES else [means[name]]
    return sum(pair) / len(pair)


def _factor(human_m: float, robot_m: float | None) -> float | None:
    if robot_m is None or robot_m < 1e-6:
        return None
    factor = human_m / robot_m
    return factor if _LEAST < factor < _MOST else None


__all__ = ["mean_lengths", "segment_factors"]
