"""How long the run took, and how often it had to wait for the human."""

from __future__ import annotations

import numpy as np

from imitor.metrics.figure import Outcome, Sample, Unmeasured, figure
from imitor.metrics.run import Run


@figure(
    "compute_time_s",
    unit="s",
    formula="time spent on a frame by all stages without sinks; p99 and p99_9 are percentiles",
    better="lower",
    about="Speed and its tail; the first frame solves from the standing posture and is often the slowest.",
)
def compute_time(run: Run) -> Outcome:
    """Take the time per frame."""
    times = np.asarray(run.reference.compute_s, dtype=float)
    if not times.any():
        return Unmeasured("the time per frame was not recorded")
    p50, p99, p999 = np.percentile(times, [50.0, 99.0, 99.9])
    values = {"mean": times.mean(), "median": p50, "p99": p99, "p99_9": p999, "max": times.max()}
    return Sample(values, times.size)


@figure(
    "compute_time_to_period_ratio",
    unit="-",
    formula="the same over the time between frames",
    better="lower",
    about="Below 1 the pipeline keeps up with a live capture.",
)
def compute_share(run: Run) -> Outcome:
    """Take the time per frame relative to real time."""
    times = np.asarray(run.reference.compute_s, dtype=float)
    if not times.any():
        return Unmeasured("the time per frame was not recorded")
    if len(run) < 2:
        return Unmeasured("it takes two frames")
    share = times / run.period_s
    return Sample({"mean": share.mean(), "p99": np.percentile(share, 99.0), "max": share.max()}, share.size)


@figure(
    "held_frames",
    unit="frames",
    formula="frames whose status is held or stopped",
    better="lower",
    about="How often the human was lost or the robot stopped.",
)
def held(run: Run) -> Outcome:
    """Count the frames that are not ok."""
    status = np.array(list(run.motion.status))
    stopped = int((status == "stopped").sum())
    return Sample.count(status != "ok", np.ones(len(run)), reason="no frame", stopped=stopped)
