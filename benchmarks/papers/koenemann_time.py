"""Time a frame of koenemann_2014 takes: with the paper's fixed iterations, and stopping at a tolerance.

    python benchmarks/papers/koenemann_time.py [--robot nao_v4] [--scenario NAME] [--repeats N]

Without sinks and without `fcl_collision`. The variants take turns, so that both see the same machine. Wall time holds
what other processes take of the machine, CPU time of the thread does not; the unit is one 30x30 SVD, timed after every
frame. The first frame settles from the standing posture and is listed apart. Below: how far hands and feet of the two
variants are apart in the world, at most over the frames.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.types import Array

ENDS = ("left_hand", "right_hand", "left_foot", "right_foot")
VARIANTS = {"fixed, 30 and 5": [], "tolerance": ["posture.tolerance.position_m=0.0002"]}
SCENARIOS = (
    "single_leg_balance",
    "two_steps_and_reach",
    "step_forward",
    "weight_shift_foot_lift",
    "slow_dance",
)


@dataclass
class Times:
    """What was measured in the frames of one variant [s]."""

    first: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    unit: list[float] = field(default_factory=list)
    spent: list[list[int]] = field(default_factory=list)
    collecting: list[float] = field(default_factory=list)


def main() -> None:
    """Run and print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robot", default="nao_v4")
    parser.add_argument("--scenario", default="single_leg_balance", help="what is timed")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each variant")
    args = parser.parse_args()
    print(
        "variant | frames | wall mean, p99.9 (ms) | CPU mean, p99.9 (ms) | CPU mean (units) | first frame, CPU (ms) | "
        "iterations, posture and balance | most of a frame in garbage collection (ms)"
    )
    times = {name: Times() for name in VARIANTS}
    for _ in range(args.repeats):
        for name, sets in VARIANTS.items():
            measure(args.scenario, args.robot, sets, times[name])
    for name, measured in times.items():
        print(line(name, measured), flush=True)
    print("\nscenario | hands apart, most (mm) | feet apart, most (mm)")
    for scenario in SCENARIOS:
        fixed, stopped = (ends(scenario, args.robot, sets) for sets in VARIANTS.values())
        apart = 1e3 * np.linalg.norm(fixed - stopped, axis=2).max(axis=0)
        print(f"{scenario} | {apart[:2].max():.2f} | {apart[2:].max():.2f}", flush=True)


def pipeline_of(scenario: str, robot: str, sets: Sequence[str]) -> Pipeline:
    """Return the preset without collision correction."""
    registry = Registry(entry_points=False)
    spec = load_pipeline("koenemann_2014", registry, robot=robot, sets=[f"source.scenario={scenario}", *sets])
    spec.stages[:] = [stage for stage in spec.stages if stage.name != "fcl_collision"]
    return Pipeline(spec, registry)


def measure(scenario: str, robot: str, sets: Sequence[str], out: Times) -> None:
    """Add the frames of one run."""
    pipeline = pipeline_of(scenario, robot, sets)
    solvers: list[Any] = [stage for _, stage in pipeline.stages if hasattr(stage, "spent")]
    matrix = np.random.default_rng(0).normal(size=(30, 30))
    began, collected = 0.0, 0.0

    def watch(phase: str, _: Any) -> None:
        nonlocal began, collected
        if phase == "start":
            began = time.perf_counter()
        else:
            collected += time.perf_counter() - began

    gc.callbacks.append(watch)
    try:
        records = pipeline.records()
        while True:
            begin, collected = time.thread_time(), 0.0
            record = next(records, None)
            cpu = time.thread_time() - begin
            if record is None:
                break
            if record.index == 0:
                out.first.append(cpu)
                continue
            out.wall.append(record.compute_s)
            out.cpu.append(cpu)
            out.collecting.append(collected)
            out.spent.append([solver.spent for solver in solvers])
            begin = time.thread_time()
            np.linalg.svd(matrix)
            out.unit.append(time.thread_time() - begin)
    finally:
        gc.callbacks.remove(watch)
        pipeline.close()


def line(name: str, times: Times) -> str:
    """Return a variant's line of the table."""
    wall, cpu, spent = 1e3 * np.array(times.wall), 1e3 * np.array(times.cpu), np.array(times.spent)
    units = cpu.mean() / (1e3 * np.median(times.unit))
    return (
        f"{name} | {len(cpu)} | {wall.mean():.2f}, {np.percentile(wall, 99.9):.2f} | "
        f"{cpu.mean():.2f}, {np.percentile(cpu, 99.9):.2f} | {units:.1f} | {1e3 * np.median(times.first):.1f} | "
        f"{', '.join(f'{n:.1f}' for n in spent.mean(axis=0))} | {1e3 * max(times.collecting):.2f}"
    )


def ends(scenario: str, robot: str, sets: Sequence[str]) -> Array:
    """Return where hands and feet are in the world in every frame, shape (T, 4, 3) [m]."""
    pipeline = pipeline_of(scenario, robot, sets)
    found = [[pipeline.robot.position(end).copy() for end in ENDS] for _ in pipeline.records()]
    pipeline.close()
    return np.array(found)


if __name__ == "__main__":
    main()
