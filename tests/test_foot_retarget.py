"""Foot retargeting: a statically stable pose in every frame, feet on the ground [koenemann2014] section V-C."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imitor.balance.offset import offset_of
from imitor.metrics.polygon import convex_hull, margin
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline

TOUCH_M = 0.003


@pytest.fixture(scope="module", params=["single_leg_balance", "two_steps_and_reach"])
def played(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    """Run the preset and keep what the tests look at."""
    registry = Registry(entry_points=False)
    pipeline = Pipeline(
        load_pipeline("koenemann_2014", registry, sets=[f"source.scenario={request.param}"]), registry
    )
    stages: dict[str, Any] = {where.split()[-1]: c for where, c in pipeline.stages}
    robot, stack = pipeline.robot, pipeline.stack
    out: dict[str, list[Any]] = {
        k: [] for k in ("margin", "contact", "sole", "offset", "wanted", "error", "anchor")
    }
    for record in pipeline.records():
        soles = robot.sole_corners()
        touching = [(float(x), float(y)) for x, y, z in soles.reshape(-1, 3) if z <= TOUCH_M]
        out["margin"].append(margin((float(robot.com[0]), float(robot.com[1])), convex_hull(touching)))
        out["contact"].append(record.state.contact.copy())
        out["sole"].append(soles)
        out["offset"].append(offset_of(robot.com, robot.position("left_foot"), robot.position("right_foot")))
        out["wanted"].append(stages["com_offset"].machine.offset)
        mapped = stages["map"]
        ends = [
            (robot.position(t.frame) - robot.position(t.relative_to)) @ robot.rotation(t.relative_to)
            for t in (stack[n] for n in ("left_hand", "right_hand", "left_foot", "right_foot"))
        ]
        out["error"].append(np.linalg.norm(np.array(ends) - mapped.limb_targets, axis=1))
        out["anchor"].append(robot.is_at(stack.anchor, stack.anchor_pose) and stack.anchor.endswith("_foot"))
    pipeline.close()
    return {k: np.array(v) for k, v in out.items()}


def test_the_com_stays_in_the_polygon_of_touching_feet(played: dict[str, np.ndarray]) -> None:
    assert played["margin"].min() > 0.005


def test_feet_in_contact_lie_on_the_floor(played: dict[str, np.ndarray]) -> None:
    heights = np.abs(played["sole"][..., 2])[played["contact"]]
    assert heights.mean() < 0.002
    assert np.percentile(heights, 95) < 0.005
    assert heights.max() < 0.012


def test_the_foot_really_leaves_the_floor(played: dict[str, np.ndarray]) -> None:
    lowest = played["sole"][..., 2].min(axis=2)
    free = ~played["contact"]
    assert free.sum() > 60
    assert np.median(lowest[free]) > 0.008


def test_the_offset_is_met(played: dict[str, np.ndarray]) -> None:
    both = played["contact"].all(axis=1)
    assert np.abs(played["offset"] - played["wanted"])[both].mean() < 0.05


def test_the_support_foot_is_the_anchor(played: dict[str, np.ndarray]) -> None:
    assert played["anchor"].all()


def test_hands_and_feet_are_near_their_targets(played: dict[str, np.ndarray]) -> None:
    mean = played["error"][:250].mean(axis=0)
    assert mean[:2].mean() < 0.014  # [koenemann2014] section VI-A
    assert mean[2:].mean() < 0.016
