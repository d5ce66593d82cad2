"""Time per frame of the post-processor fcl_collision, in milliseconds and in units of one 30x30 SVD.

    python benchmarks/collision_time.py [--robot unitree_g1] [--scenario NAME ...]

Time is that of the one thread, so that other work on the machine does not count; the unit is timed through the same
run. Frames in which nothing was changed are told apart from the others, and the pose before and after the correction is
looked at by a second engine: frames with links deeper than 1 mm.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from typing import Any

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor.kinds import Config
from imitor.metrics.collision import CollisionModel, full_configurations, robot_collision_model
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.spec import PipelineSpec, StageSpec, load_pipeline
from imitor.types import Array


def main() -> None:
    """Run and print one line a scenario."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robot", default="unitree_g1")
    parser.add_argument("--scenario", nargs="+", default=["walk", "wave", "slow_dance"])
    args = parser.parse_args()
    for name in args.scenario:
        print(measured(args.robot, name), flush=True)


def measured(robot_name: str, scenario: str) -> str:
    """Return the lines of one scenario."""
    registry = Registry(entry_points=False)
    spec = load_pipeline("retarget", registry, robot=robot_name, sets=[f"source.scenario={scenario}"])
    pipeline = Pipeline(
        with_stage(spec, registry.get("postprocessor", "fcl_collision").config_type()), registry
    )
    stage: Any = next(c for _, c in pipeline.stages if c.name == "fcl_collision")
    second, matrix = robot_collision_model(pipeline.robot), np.random.default_rng(0).normal(size=(30, 30))
    seconds, units, changed, before = [], [], [], 0
    step = stage.step

    def timed(stack: Any, state: Any) -> None:
        nonlocal before
        before += collides(second, pipeline.robot, state.q)
        count, begin = stage.correction.changed, time.thread_time()
        step(stack, state)
        seconds.append(time.thread_time() - begin)
        changed.append(stage.correction.changed > count)
        begin = time.thread_time()
        np.linalg.svd(matrix)
        units.append(time.thread_time() - begin)

    stage.step = timed
    pipeline._bind()
    after = sum(collides(second, pipeline.robot, record.state.q) for record in pipeline.records())
    unit, ms, was = float(np.median(units)), 1e3 * np.array(seconds), np.array(changed)
    found = stage.correction
    lines = [
        f"{scenario}: {len(ms)} frames, {was.sum()} changed by at most {found.largest_rad:.3f} rad",
        f"  deeper than 1 mm before {before}, after {after}; nearer than the margin {found.left}",
    ]
    for label, values in (("nothing near", ms[~was]), ("changed", ms[was]), ("all", ms)):
        if len(values):
            p50, p99 = np.percentile(values, (50, 99))
            a, b = p50 / unit / 1e3, p99 / unit / 1e3
            lines.append(f"  {label}: median {p50:.3f} ms ({a:.2f} SVD), p99 {p99:.3f} ms ({b:.2f} SVD)")
    pipeline.close()
    return "\n".join(lines)


def with_stage(spec: PipelineSpec, config: Config) -> PipelineSpec:
    """Return a pipeline with fcl_collision as its last stage."""
    stage = StageSpec(
        "postprocessor", "fcl_collision", "fcl_collision", config, f"stages[{len(spec.stages)}]"
    )
    return dataclasses.replace(spec, stages=[*spec.stages, stage])


def collides(second: CollisionModel, robot: RobotModel, q: Array) -> bool:
    """Tell whether links overlap by more than 1 mm."""
    full = full_configurations(second.model, robot.locked, robot.joint_names, q[None])[0]
    return bool(second.collisions(full))


if __name__ == "__main__":
    main()
