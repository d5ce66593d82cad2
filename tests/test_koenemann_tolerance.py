"""The preset koenemann_2014 stopping at a tolerance: the motion of the paper's fixed iterations, in fewer of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline

ENDS = ("left_hand", "right_hand", "left_foot", "right_foot")


def ends(scenario: str, *sets: str) -> tuple[np.ndarray, np.ndarray]:
    """Return hands and feet in the world, (T, 4, 3) [m], and the iterations of both solvers, (T, 2)."""
    registry = Registry(entry_points=False)
    spec = load_pipeline("koenemann_2014", registry, sets=[f"source.scenario={scenario}", *sets])
    spec.stages[:] = [stage for stage in spec.stages if stage.name != "fcl_collision"]
    pipeline = Pipeline(spec, registry)
    solvers: list[Any] = [stage for _, stage in pipeline.stages if hasattr(stage, "spent")]
    places, spent = [], []
    for _ in pipeline.records():
        places.append([pipeline.robot.position(end).copy() for end in ENDS])
        spent.append([solver.spent for solver in solvers])
    pipeline.close()
    return np.array(places), np.array(spent)


@pytest.mark.parametrize("scenario", ["single_leg_balance", "two_steps_and_reach"])
def test_a_tolerance_gives_the_same_motion_within_a_millimetre(scenario: str) -> None:
    fixed, all_of_them = ends(scenario)
    stopped, some = ends(scenario, "posture.tolerance.position_m=0.0002")
    assert (all_of_them[1:, 0] == 30).all()
    assert some[1:, 0].mean() < 10
    assert np.linalg.norm(fixed - stopped, axis=2).max() < 0.001
