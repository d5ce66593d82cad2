"""Records for robot sinks, and what listens at the other end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from imitor import Configuration, Record, Sink
from imitor.robot.model import RobotModel
from imitor.testing import make_robot, make_run
from imitor.testing.fixtures import Run

RATE_HZ = 50.0


def run_of(folder: Path, robot: str | RobotModel = "unitree_g1", **info: Any) -> Run:
    """Return a live run at 50 Hz."""
    model = make_robot(robot) if isinstance(robot, str) else robot
    return make_run(folder, 2, robot=model, **{"rate_hz": RATE_HZ, "live": True, **info})


def opened(sink_type: Any, run: Run, **options: Any) -> Any:
    """Return a started and opened sink."""
    sink: Sink[Any] = sink_type(sink_type.config_type(**options))
    sink.start()
    sink.open(run.info)
    return sink


def records(run: Run, configurations: Any, status: int = 0) -> Iterator[Record]:
    """Yield records of configurations, one a period, as in a real run the same object every time."""
    state = Configuration(run.info.robot.standing.copy(), np.ones(2, dtype=bool), status)
    record = Record(0, 0.0, run.frames[0], run.info.stack, state)
    for i, q in enumerate(configurations):
        state.q[:] = q
        record.index, record.time_s = i, i / run.info.rate_hz
        yield record


def written(sink: Any, run: Run, configurations: Any, status: int = 0) -> None:
    """Write records of configurations."""
    for record in records(run, configurations, status):
        sink.write(record)


def moved(robot: RobotModel, **joints: float) -> Any:
    """Return the standing configuration with some joints elsewhere [rad]."""
    q = robot.standing.copy()
    for name, value in joints.items():
        q[7 + robot.joint_index(name)] = value
    return q
