"""Time per frame of the post-processor fcl_collision, in milliseconds and in units of one 30x30 SVD.

    python benchmarks/collision_time.py [--robot unitree_g1] [--scenario NAME ...]

Time is that of the one thread, so that other work on the machine does not count; the unit is timed through the same
run. Frames in which nothing was changed are told apart from the others,
and the motion after the correction is looked at by a second engine: frames with links deeper than 1 mm.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor.metrics.collision import CollisionModel, full_configurations, robot_collision_model
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.spec import load_pipeline
from imitor.testing import make_context
from imitor.types import Array


def main() -> None:
    """Run and print one line a scenario."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robot", default="unitree_g1")
    parser.add_argument("--scenario", nargs="+", default=["walk", "wave", "slow_dance"])
    args = parser.parse_args()
    registry = Registry(entry_points=False)
    cls = registry.get("postprocessor", "fcl_collision")
    matrix = np.random.default_rng(0).normal(size=(30, 30))
    for name in args.scenario:
        spec = load_pipeline("retarget", registry, robot=args.robot, sets=[f"source.scenario={name}"])
        pipeline = Pipeline(spec, registry)
        stage = cls(cls.config_type(), make_context(pipeline.robot, rate_hz=pipeline.rate_hz))
        stage.start()
        robot = pipeline.robot
        second = robot_collision_model(robot)

        seconds, units, changed, before, after = [], [], [], 0, 0
        for record in pipeline.records():
            state = record.state
            given, count = state.q.copy(), stage.correction.changed
            before += _collides(second, robot, state.q)
            begin = time.thread_time()
            stage.step(record.stack, state)
            seconds.append(time.thread_time() - begin)
            changed.append(stage.correction.changed > count)
            after += _collides(second, robot, state.q)
            begin = time.thread_time()
            np.linalg.svd(matrix)
            units.append(time.thread_time() - begin)
            state.q[:] = given
            robot.update(given)
        unit, ms, was = float(np.median(units)), 1e3 * np.array(seconds), np.array(changed)
        correction = stage.correction
        print(f"{name}: {len(ms)} frames, {was.sum()} changed by at most {correction.largest_rad:.3f} rad")
        print(f"  deeper than 1 mm before {before}, after {after}; nearer than the margin {correction.left}")
        for label, values in (("nothing near", ms[~was]), ("changed", ms[was]), ("all", ms)):
            if len(values):
                p50, p99 = np.percentile(values, (50, 99))
                a, b = p50 / unit / 1e3, p99 / unit / 1e3
                print(f"  {label}: median {p50:.3f} ms ({a:.2f} SVD), p99 {p99:.3f} ms ({b:.2f} SVD)")
        pipeline.close()


def _collides(second: CollisionModel, robot: RobotModel, q: Array) -> bool:
    full = full_configurations(second.model, robot.locked, robot.joint_names, q[None])[0]
    return bool(second.collisions(full))


if __name__ == "__main__":
    main()
