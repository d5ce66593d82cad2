"""Measure a run: from motion and reference to ``metrics.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.atomic import atomic
from imitor.metrics.catalogue import FIGURES
from imitor.metrics.figure import Sample
from imitor.metrics.run import Run
from imitor.record import MOTION_FILE, REFERENCE_FILE, Motion, Reference

if TYPE_CHECKING:
    from imitor.registry import Registry
    from imitor.robot.model import RobotModel

SCHEMA: Final = "imitor-metrics-1"
METRICS_FILE: Final = "metrics.json"
DIGITS: Final = 6
ROUNDING: Final = 1e-12
"""Smaller numbers are rounding errors of the arithmetic and are written as 0."""


def evaluate(
    motion: Motion, reference: Reference, robot: RobotModel, *, collision_every: int | None = None
) -> dict[str, Any]:
    """Return the measured quality of a run, ready for JSON.

    Args:
        motion: What the robot was told.
        reference: What it was meant to do, the same frames.
        robot: The robot of the motion.
        collision_every: Look for self-collision in every so many-th frame; 0 leaves it out, ``None`` chooses
            at most 50 frames a second.

    Raises:
        SourceError: Motion and reference do not fit together or hold numbers that are none.
        RobotError: The motion's joints are not the robot's.
    """
    run = Run(motion, reference, robot, collision_every)
    figures: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for figure in FIGURES:
        for name, outcome in figure.measure(run).items():
            if isinstance(outcome, Sample):
                figures[name] = {key: _plain(value) for key, value in outcome.as_dict().items()}
            else:
                reasons[name] = outcome.reason
    return {
        "schema": SCHEMA,
        "robot": motion.robot,
        "frames": len(motion),
        "duration_s": float(motion.time_s[-1] - motion.time_s[0]),
        "figures": figures,
        "not_measured": reasons,
    }


def evaluate_dir(
    path: Path, registry: Registry | None = None, *, collision_every: int | None = None
) -> dict[str, Any]:
    """Return the measured quality of a run directory, from its ``motion.npz`` and ``reference.npz`` alone.

    Raises:
        SourceError: A file is missing or wrong. SpecError, RobotError: The motion's robot cannot be loaded.
    """
    from imitor.robot.model import RobotModel

    motion, reference = Motion.load(path / MOTION_FILE), Reference.load(path / REFERENCE_FILE)
    robot = RobotModel.load(motion.robot, registry)
    return evaluate(motion, reference, robot, collision_every=collision_every)


def write(report: Mapping[str, Any], path: Path) -> None:
    """Write a report as JSON with sorted keys and six significant digits; it appears whole or not at all."""
    text = json.dumps(_rounded(report), indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
    with atomic(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """Return numpy scalars as Python's."""
    return value.item() if isinstance(value, np.generic) else value


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    if isinstance(value, float):
        return 0.0 if abs(value) < ROUNDING else float(f"{value:.{DIGITS}g}")
    return value
