"""Seconds from starting a process to its first frame, and to read a long BVH file.

    python benchmarks/start_up.py RECORDING.bvh [--repeat 3] [--robot R]

Repeats the recording's motion to 10 000 frames in a temporary file, reads it, and starts the preset `retarget` on it in
fresh processes. Wall time; the smallest of the repeats.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CHILD = """
import sys, time
begin = float(sys.argv[1])
from pathlib import Path
from imitor.registry import Registry
from imitor.spec import load_pipeline
from imitor.pipeline import Pipeline
registry = Registry()
pipeline = Pipeline(load_pipeline("retarget", registry, robot=sys.argv[2], input=Path(sys.argv[3])), registry)
next(pipeline.records())
print(time.time() - begin)
"""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--robot", default="unitree_g1")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.bvh"
        write_long(args.recording, path, 10000)
        best = min(read(path) for _ in range(args.repeat))
        print(f"reading {path.stat().st_size / 1e6:.1f} MB, 10000 frames: {best:.2f} s")
        short = Path(folder) / "short.bvh"
        write_long(args.recording, short, 300)
        for name, file in (("300 frames", short), ("10000 frames", path)):
            times = [
                float(
                    subprocess.run(
                        [sys.executable, "-c", CHILD, str(time.time()), args.robot, str(file)],
                        check=True, capture_output=True, text=True,
                    ).stdout
                )
                for _ in range(args.repeat)
            ]  # fmt: skip
            print(f"process start to first frame, {name}: {min(times):.2f} s")


def read(path: Path) -> float:
    """Return the time to read a file into a started source [s]."""
    from imitor.plugins.sources.bvh import Bvh, BvhConfig

    begin = time.perf_counter()
    Bvh(BvhConfig(path=str(path))).start()
    return time.perf_counter() - begin


def write_long(recording: Path, path: Path, frames: int) -> None:
    """Write a recording's motion over and over until it has so many frames."""
    lines = recording.read_text(encoding="utf-8", errors="replace").splitlines()
    start = next(i for i, line in enumerate(lines) if line.strip() == "MOTION")
    motion = [line for line in lines[start + 3 :] if line.strip()]
    again = [motion[i % len(motion)] for i in range(frames)]
    text = [*lines[: start + 1], f"Frames: {frames}", lines[start + 2], *again]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
