"""Measured quality of a preset over recordings, robots and solvers, as tables.

    python benchmarks/quality.py RECORDING... [--robot R]... [--solver S]... [--set ID.option=v]... [--collision]

Every figure is computed from the run's motion and reference by the same code as ``metrics.json``. The mean direction
error of a robot is the mean over frames, then over the nine segments, then over the recordings.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor import metrics
from imitor.kinds import RunInfo
from imitor.pipeline import Pipeline
from imitor.record import Recorder
from imitor.registry import Registry
from imitor.spec import load_pipeline

COLUMNS = (
    # heading, figure, statistic, factor, format
    ("direction [deg]", "direction_error_deg", "mean", 1, "{:.2f}"),
    ("slip [mm/s]", "foot_slip_human_contact_m_s", "mean", 1e3, "{:.1f}"),
    ("penetration max [mm]", "penetration_m", "max", 1e3, "{:.1f}"),
    ("float max [mm]", "float_m", "max", 1e3, "{:.1f}"),
    ("limit frames", "joint_limit_violation_frames", "count", 1, "{:.0f}"),
    ("overspeed frames", "joint_overspeed_frames", "count", 1, "{:.0f}"),
    ("jumps", "joint_jump_frames", "count", 1, "{:.0f}"),
)


def measure(
    registry: Registry,
    pipeline: str,
    recording: Path,
    robot: str,
    solver: str,
    sets: Sequence[str],
    collision: bool,
) -> dict[str, Any]:
    """Run one recording on one robot and return its metrics."""
    spec = load_pipeline(
        pipeline, registry, robot=robot, input=recording, uses=[f"solve={solver}"], sets=sets
    )
    built = Pipeline(spec, registry)
    recorder = Recorder(
        RunInfo(Path(), built.robot, built.skeleton, built.rate_hz, built.stack, built.n_frames)
    )
    for record in built.records():
        recorder.add(record)
    built.close()
    return metrics.evaluate(
        recorder.motion(), recorder.reference(), built.robot, collision_every=None if collision else 0
    )


def main() -> None:
    """Run all combinations and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--pipeline", default="retarget")
    parser.add_argument("--robot", action="append", dest="robots")
    parser.add_argument("--solver", action="append", dest="solvers")
    parser.add_argument("--set", action="append", default=[], dest="sets")
    parser.add_argument("--collision", action="store_true", help="measure self-collision too (slow)")
    args = parser.parse_args()
    registry = Registry(entry_points=False)
    summary = []
    for robot in args.robots or ["unitree_g1", "talos", "romeo"]:
        for solver in args.solvers or ["prioritized"]:
            print(f"\n### {robot}, {solver}{', ' + ', '.join(args.sets) if args.sets else ''}\n")
            print("| recording | frames | " + " | ".join(c[0] for c in COLUMNS) + " |")
            print("|---|---|" + "---|" * len(COLUMNS))
            rows = []
            for recording in args.recordings:
                found = measure(registry, args.pipeline, recording, robot, solver, args.sets, args.collision)
                figures = found["figures"]
                values = [
                    value_of(figures, key, statistic) * factor for _, key, statistic, factor, _ in COLUMNS
                ]
                rows.append(values)
                cells = [form.format(v) for v, (*_, form) in zip(values, COLUMNS, strict=True)]
                print(f"| {recording.name} | {found['frames']} | " + " | ".join(cells) + " |", flush=True)
            table = np.array(rows)
            summary.append((robot, solver, np.nanmean(table[:, 0]), *np.nansum(table[:, 4:], axis=0)))
    print("\n### Means\n")
    print("| robot | solver | direction error [deg] | limit frames | overspeed frames | jumps |")
    print("|---|---|---|---|---|---|")
    for robot, solver, error, *counts in summary:
        print(f"| {robot} | {solver} | {error:.2f} | " + " | ".join(f"{c:.0f}" for c in counts) + " |")
    sys.stdout.flush()


def value_of(figures: dict[str, Any], key: str, statistic: str) -> float:
    """Return one statistic of a figure; NaN where it was not measured."""
    figure = figures.get(key, {})
    value = figure.get(statistic, figure.get("value", figure.get("max", np.nan)))
    return float(value)


if __name__ == "__main__":
    main()
