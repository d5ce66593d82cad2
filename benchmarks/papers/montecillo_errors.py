"""Table 1 of Montecillo-Puente et al. (ICINCO 2010): how far the robot is from the HN model.

Errors are the root mean square over time of each axis, and its mean over the axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from experiment import Played, number
from page import table

from imitor.kinds import Record
from imitor.pipeline import Pipeline
from imitor.types import SIDES, Array

PARTS = ("head", "chest", "waist")
SETTLED_S = 2.0
"""The robot goes to the human's first pose in this time: it counts for nothing [s]."""
DANCE, LIFT = "slow_dance", "weight_shift_foot_lift"
"""The scenarios of the paper."""
PAPER = {
    "CoM": ("0", ""),
    "head": ("0 m; 4.09°", "R 11.8, P 0.22, Y 0.26°"),
    "left wrist": ("0.02 m", "X 0.013, Y 0.02, Z 0.3 (0.03) m"),
    "right wrist": ("0.05 m", "X 0.05, Y 0.017, Z 0.08 m"),
    "chest": ("4.2°", "R 1.1, P 6.7, Y 4.8°"),
    "waist": ("6.4°", "R 1.1, P 4.62, Y 0.52°"),
}


def observe(pipeline: Pipeline, record: Record) -> Array:
    """Return the HN model of a frame: head (3), wrists (2 x 16), turns of head, chest and waist (3 x 9)."""
    model = next(c for _, c in pipeline.stages if c.name == "normalized_model").model  # type: ignore[attr-defined]
    turns = [model.turn[part].ravel() for part in PARTS]
    return np.concatenate([model.head, *(pose.ravel() for pose in model.wrist), *turns])


def roll_pitch_yaw(R: Array) -> Array:
    """Return the angles about x, y and z of rotations, shape (..., 3) [deg]."""
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    pitch = np.arcsin(-np.clip(R[..., 2, 0], -1.0, 1.0))
    return np.degrees(np.stack([roll, pitch, np.arctan2(R[..., 1, 0], R[..., 0, 0])], axis=-1))


def turn_of(p: Played, part: str) -> Array:
    """Return how a part of the HN model is turned, shape (T, 3, 3)."""
    first = 35 + 9 * PARTS.index(part)
    return p.observed[:, first : first + 9].reshape(-1, 3, 3)


def settled(p: Played) -> Array:
    """Return which frames count, shape (T,)."""
    return np.asarray(p.time_s >= SETTLED_S)


def errors(p: Played, name: str) -> Array:
    """Return the errors of a row of table 1 over the frames that count, shape (T', axes) [m or deg]."""
    rows = settled(p)
    if name == "CoM":
        return np.asarray((p.run.path.com - p.reference.target["com"])[rows, :2])
    if name.endswith("wrist"):
        side = name.removesuffix(" wrist")
        asked = p.observed[:, 3 + 16 * SIDES.index(side) :][:, :16].reshape(-1, 4, 4)
        return np.asarray((p.frame(f"{side}_wrist")[:, :3, 3] - asked[:, :3, 3])[rows])
    if name == "head position":
        return np.asarray((p.frame("head")[:, :3, 3] - p.observed[:, :3])[rows])
    off = roll_pitch_yaw(p.frame(name)[:, :3, :3]) - roll_pitch_yaw(turn_of(p, name))
    return np.asarray((off + 180.0) % 360.0 - 180.0)[rows]


def rms(values: Array) -> Array:
    """Return the root mean square over time, by axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def table_1(played: Sequence[Played], program: str) -> str:
    """Return table 1 with the dance and the foot lift beside the paper's."""
    found = {p.case.title: p for p in played if p.case.title in (DANCE, LIFT)}
    if not found:
        return ""
    rows = []
    for name, (mean, axes) in PAPER.items():
        cells_ = [name, mean, axes]
        for p in found.values():
            cells_ += list(_row(p, name))
        rows.append(cells_)
    head = ["mean RMS error", "paper", "by axis"]
    for title in found:
        head += [title, "by axis"]
    commands = ", ".join(f"`python {program} {title}`" for title in found)
    return f"Table 1 ({commands}):\n\n{table(head, rows)}"


def _row(p: Played, name: str) -> tuple[str, str]:
    if name == "CoM" or name.endswith("wrist"):
        e = 1e3 * rms(errors(p, name))
        return f"{number(e.mean(), 1)} mm", ", ".join(
            f"{a} {number(v, 1)}" for a, v in zip("XYZ", e, strict=False)
        ) + " mm"
    e = rms(errors(p, name))
    mean = f"{number(e.mean(), 1)}°"
    if name == "head":
        mean = f"{number(1e3 * rms(errors(p, 'head position')).mean(), 1)} mm; {mean}"
    return mean, ", ".join(f"{a} {number(v, 2)}" for a, v in zip("RPY", e, strict=True)) + "°"
