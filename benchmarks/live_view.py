"""What the live view in Rerun costs: computing time and bytes a picture, with every frame sent by itself.

python benchmarks/live_view.py --robot unitree_g1 --frames 300
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from imitor import testing
from imitor.record import Recorder
from imitor.visual.rerun_log import RerunLog
from imitor.visual.rerun_plots import RerunPlots
from imitor.visual.rerun_scene import RerunScene


def main() -> None:
    """Measure and print."""
    import tempfile
    from pathlib import Path

    import rerun as rr

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="unitree_g1")
    parser.add_argument("--frames", type=int, default=300)
    options = parser.parse_args()
    robot = testing.make_robot(options.robot)
    with tempfile.TemporaryDirectory() as folder:
        run = testing.make_run(Path(folder), options.frames, robot=robot)
        recorder = Recorder(run.info)
        for record in run.records():
            recorder.add(record)
    motion, reference = recorder.motion(), recorder.reference()
    stream = rr.RecordingStream("live_view")
    memory, log = stream.binary_stream(), RerunLog(stream)
    scene, plots = RerunScene(robot, run.info.stack), RerunPlots(robot)
    begin = time.perf_counter()
    scene.begin(log)
    plots.begin(log)
    print(f"at the start: {1e-6 * len(memory.read() or b''):.1f} MB, {time.perf_counter() - begin:.2f} s")
    picture_s, size = [], []
    for i in range(len(motion)):
        rows = np.array([i])
        begin = time.thread_time()
        scene.add(log, scene.clip(motion, reference, rows), reference, rows)
        size.append(len(memory.read() or b""))
        picture_s.append(time.thread_time() - begin)
    begin = time.thread_time()
    plots.add(log, motion, reference)
    size_plots = len(memory.read() or b"")
    plots_s = time.thread_time() - begin
    middle, high = 1e3 * np.quantile(picture_s, [0.5, 0.99])
    print(
        f"a picture: {middle:.1f} ms of computing time (p99 {high:.1f}), {1e-3 * np.median(size):.0f} kB; "
        f"curves of {len(motion)} frames at once: {1e3 * plots_s:.0f} ms, {1e-3 * size_plots:.0f} kB"
    )


if __name__ == "__main__":
    main()
