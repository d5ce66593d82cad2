"""Losses of 50 ms to 10 s at random places: limits are kept, balanced robots stay balanced, nothing jumps back."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.kinds import Tick
from imitor.metrics.polygon import convex_hull, margin
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import HumanFrame

REGISTRY = Registry(entry_points=False)
TOUCH_M = 0.003
LENGTHS_S = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
CARDS = Path(__file__).parents[1] / "plugins/robots/cards"


def with_accelerations(robot: str, rad_s2: float, folder: Path) -> str:
    """Return a card of the robot in which every joint has an acceleration limit."""
    text = (CARDS / f"{robot}.yaml").read_text(encoding="utf-8")
    text = text.replace("../models/", f"{CARDS.parent / 'models'}/")
    limit = f"  acceleration_rad_s2: {{'*': {rad_s2}}}\n"
    text = (
        text.replace("\nlimits:\n", f"\nlimits:\n{limit}", 1)
        if "\nlimits:\n" in text
        else f"{text}\nlimits:\n{limit}"
    )
    path = folder / f"{robot}.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def losses(frames: list[HumanFrame], seed: int) -> list[tuple[float, float]]:
    chance, out = random.Random(seed), []
    at = frames[0].time_s + 0.5 + chance.random()
    while at < frames[-1].time_s:
        length = chance.choice(LENGTHS_S)
        out.append((at, at + length))
        at += length + chance.uniform(0.3, 3.0)
    return out


def check(pipeline: Pipeline, seed: int, *, balanced: bool = True) -> None:
    """Play the source with losses and hold every command to the contract."""
    frames = list(pipeline._human_frames(pipeline.source.frames()))
    lost = losses(frames, seed)
    pipeline.reset()
    robot, hz = pipeline.robot, pipeline.rate_hz
    q, least = [], 1.0
    for frame in frames:
        gone = any(a <= frame.time_s < b for a, b in lost)
        pipeline.advance(Tick(frame.time_s, None if gone else frame))
        q.append(pipeline.state.q.copy())
        least = min(least, stands(pipeline))
    joints = np.array(q)[:, 7:]
    speed = np.diff(joints, axis=0) * hz
    assert np.isfinite(joints).all()
    assert (joints >= robot.lower - 1e-9).all()
    assert (joints <= robot.upper + 1e-9).all()
    assert (np.abs(speed) <= robot.speed + 1e-6).all()
    assert (np.abs(np.diff(speed, axis=0)) * hz <= robot.acceleration + 1e-4).all()
    assert pipeline.tracking.report.losses >= 1
    if balanced:
        assert least > 0.0, f"the CoM leaves the polygon by {-1e3 * least:.1f} mm"


def stands(pipeline: Pipeline) -> float:
    """Return how far inside the feet on the floor the CoM is [m]."""
    robot = pipeline.robot
    touching = [(float(x), float(y)) for x, y, z in robot.sole_corners().reshape(-1, 3) if z <= TOUCH_M]
    return margin((float(robot.com[0]), float(robot.com[1])), convex_hull(touching)) if touching else -1.0


CASES = [
    ("koenemann_2014", "nao_v4", "two_steps_and_reach"),
    ("koenemann_2014", "nao_v4", "single_leg_balance"),
    ("penna_poubel_2014", "nao_v4", "two_steps_and_reach"),
    ("montecillo_2010", "hrp2", "weight_shift_foot_lift"),
]


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("preset", "robot", "scenario"), CASES)
def test_a_balanced_robot_stays_balanced_whatever_is_lost(
    preset: str, robot: str, scenario: str, seed: int, tmp_path: Path
) -> None:
    sets = [
        f"source.scenario={scenario}",
        "tracking.resume=automatic",
        f"tracking.stop_s={1.0 if seed % 2 else 3.0}",
    ]
    card = with_accelerations(robot, 60.0, tmp_path)
    pipeline = Pipeline(load_pipeline(preset, REGISTRY, robot=card, sets=sets), REGISTRY)
    try:
        check(pipeline, seed)
    finally:
        pipeline.close()


@pytest.mark.parametrize("robot", ["unitree_g1", "talos"])
def test_limits_are_kept_without_balance_too(robot: str, tmp_path: Path) -> None:
    card = with_accelerations(robot, 80.0, tmp_path) if robot == "unitree_g1" else robot
    sets = ["source.scenario=walk"]
    pipeline = Pipeline(load_pipeline("retarget", REGISTRY, robot=card, sets=sets), REGISTRY)
    try:
        check(pipeline, 3, balanced=False)
    finally:
        pipeline.close()


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("preset", ["koenemann_2014", "penna_poubel_2014"])
def test_real_captures_with_losses(preset: str, tmp_path: Path, shared: Path) -> None:
    card = with_accelerations("nao_v4", 60.0, tmp_path)
    spec: Any = load_pipeline(preset, REGISTRY, robot=card, input=shared / "mocap/cmu_bvh/49_18.bvh")
    pipeline = Pipeline(spec, REGISTRY)
    try:
        check(pipeline, 5)
    finally:
        pipeline.close()


def test_nothing_jumps_when_the_person_is_seen_again() -> None:
    """After each loss the robot goes on from where it is, at the speed of the blend and not at that of its motors."""
    sets = ["source.scenario=slow_dance", "tracking.resume=automatic", "tracking.stop_s=0.5"]
    pipeline = Pipeline(load_pipeline("retarget", REGISTRY, sets=sets), REGISTRY)
    frames = list(pipeline._human_frames(pipeline.source.frames()))
    hz = pipeline.rate_hz
    seen = moves(pipeline, frames, [])
    gone = moves(pipeline, frames, [(2.0, 2.4), (3.5, 4.9), (6.0, 6.1)])
    pipeline.close()
    usual = np.abs(np.diff(seen, axis=0)).max() * hz
    largest = np.abs(np.diff(gone, axis=0)).max() * hz
    assert largest <= usual + 3.0  # rad/s; the motors could do 30


def moves(pipeline: Pipeline, frames: list[HumanFrame], lost: list[tuple[float, float]]) -> Any:
    pipeline.reset()
    out = []
    for frame in frames:
        gone = any(a <= frame.time_s < b for a, b in lost)
        pipeline.advance(Tick(frame.time_s, None if gone else frame))
        out.append(pipeline.state.q[7:].copy())
    return np.array(out)[30:]
