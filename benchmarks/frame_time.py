"""Time per frame of a whole pipeline without sinks, in milliseconds and in units of one 30x30 SVD.

    python benchmarks/frame_time.py [--pipeline retarget] [--robot unitree_g1] [--input FILE] [--use ID=PLUGIN]

One thread. The unit, one ``numpy.linalg.svd`` of a fixed 30x30 matrix, is timed all through the same run (one call
after every tenth frame), so that a busy or slow machine changes both alike.
"""

from __future__ import annotations

import argparse
import gc
import time
from pathlib import Path

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline


def main() -> None:
    """Run and print one line a figure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pipeline", default="retarget")
    parser.add_argument("--robot", default=None)
    parser.add_argument("--input", type=Path, action="append", help="recording; may be given several times")
    parser.add_argument("--use", action="append", default=[])
    parser.add_argument("--set", action="append", default=[], dest="sets")
    args = parser.parse_args()
    registry = Registry(entry_points=False)
    frame_s: list[float] = []
    unit_s: list[float] = []
    matrix = np.random.default_rng(0).normal(size=(30, 30))
    for _ in range(200):
        np.linalg.svd(matrix)
    clock = time.perf_counter
    for path in args.input or [None]:
        spec = load_pipeline(
            args.pipeline, registry, robot=args.robot, input=path, uses=args.use, sets=args.sets
        )
        pipeline = Pipeline(spec, registry)
        gc.collect()
        for record in pipeline.records():
            if record.index >= 10:  # the first frames settle and warm up
                frame_s.append(record.compute_s)
            if record.index % 10 == 0:
                begin = clock()
                np.linalg.svd(matrix)
                unit_s.append(clock() - begin)
        pipeline.close()
    unit = float(np.median(unit_s))
    frames = np.array(frame_s)
    print(f"unit (median of {len(unit_s)} SVDs 30x30): {1e3 * unit:.4f} ms")
    print(f"frames: {len(frames)}")
    for name, value in (
        ("mean", frames.mean()),
        ("median", np.median(frames)),
        ("p99", np.percentile(frames, 99)),
        ("p99.9", np.percentile(frames, 99.9)),
        ("max", frames.max()),
    ):
        print(f"{name:>7}: {1e3 * value:8.4f} ms  {value / unit:6.2f} units")


if __name__ == "__main__":
    main()
