"""Figures of the preset koenemann_2014: errors of hands and feet, balance, and time, in units of one 30x30 SVD.

    python benchmarks/papers/koenemann_2014.py [--robot nao_v4] [--frames N] [--set KEY=VALUE ...] [SCENARIO ...]

Errors are distances to the targets of eq. 5 after all stages [koenemann2014], in the carrying link's axes; the margin
is that of the CoM in the hull of sole corners at or under 3 mm. The unit is timed through the same run.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor.metrics.polygon import convex_hull, margin
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline

SCENARIOS = (
    "single_leg_balance",
    "two_steps_and_reach",
    "step_forward",
    "weight_shift_foot_lift",
    "slow_dance",
)
LIMBS = (("left_hand", "chest"), ("right_hand", "chest"), ("left_foot", "waist"), ("right_foot", "waist"))
TOUCH_M = 0.003


def main() -> None:
    """Run and print one line a scenario."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS, metavar="SCENARIO")
    parser.add_argument("--robot", default="nao_v4")
    parser.add_argument("--frames", type=int, help="only the first frames")
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    args = parser.parse_args()
    print(
        "scenario | hands mean (mm) | left, right foot mean (mm) | least margin (mm) | "
        "single support, human and robot (frames) | mean, p99.9 (ms) | mean (units)"
    )
    for scenario in args.scenarios:
        print(measured(scenario, args.robot, args.sets, args.frames), flush=True)


def measured(scenario: str, robot_name: str, sets: list[str], most: int | None) -> str:
    """Return the line of one scenario."""
    registry = Registry(entry_points=False)
    spec = load_pipeline(
        "koenemann_2014", registry, robot=robot_name, sets=[f"source.scenario={scenario}", *sets]
    )
    pipeline = Pipeline(spec, registry)
    robot = pipeline.robot
    mapper: Any = next(stage for title, stage in pipeline.stages if title.split()[-1] == "map")
    limbs = [(pipeline.stack[n].frame, carrier) for n, carrier in LIMBS]
    matrix = np.random.default_rng(0).normal(size=(30, 30))
    errors, margins, seconds, units, human, single = [], [], [], [], 0, 0
    for record in pipeline.records():
        if most is not None and record.index >= most:
            break
        ends = [
            (robot.position(end) - robot.position(carrier)) @ robot.rotation(carrier)
            for end, carrier in limbs
        ]
        errors.append(np.linalg.norm(np.array(ends) - mapper.limb_targets, axis=1))
        touching = [tuple(c[:2]) for c in robot.sole_corners().reshape(-1, 3) if c[2] <= TOUCH_M]
        margins.append(margin(tuple(robot.com[:2]), convex_hull(touching)))
        human += record.human.support.left != record.human.support.right
        single += record.state.contact.sum() == 1
        seconds.append(record.compute_s)
        begin = time.perf_counter()
        np.linalg.svd(matrix)
        units.append(time.perf_counter() - begin)
    mean = 1e3 * np.array(errors[1:]).mean(axis=0)  # the first frame has other iterations
    ms = 1e3 * np.array(seconds[1:])
    return (
        f"{scenario} | {mean[:2].mean():.1f} | {mean[2]:.1f}, {mean[3]:.1f} | {1e3 * min(margins):.1f} | "
        f"{human}, {single} | {ms.mean():.2f}, {np.percentile(ms, 99.9):.2f} | "
        f"{ms.mean() / (1e3 * np.median(units)):.1f}"
    )


if __name__ == "__main__":
    main()
