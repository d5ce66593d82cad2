"""The same input gives the same bytes, in processes that know nothing of each other."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import load_pipeline

SOLVERS = tuple(Registry(entry_points=False).names("solver"))
SETS = ("scenario=two_steps_and_reach", "rate_hz=30", "loss=0.05", "noise_std_m=0.005", "seed=4")


def in_a_fresh_process(folder: Path, solver: str, hash_seed: str) -> Path:
    """Run the preset through the command line; return the run directory."""
    sets = [part for option in SETS for part in ("--set", f"source.{option}")]
    command = [
        sys.executable, "-m", "imitor.cli", "run", "retarget", "--use", f"solve={solver}", *sets, "--sink", "csv",
        "--frames", "120", "--out", str(folder), "--quiet",
    ]  # fmt: skip
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("solver", SOLVERS)
def test_two_processes_write_the_same_bytes(tmp_path: Path, solver: str) -> None:
    one, other = (in_a_fresh_process(tmp_path / seed, solver, seed) for seed in ("1", "2"))
    for name in ("motion.npz", "motion.csv", "pipeline.yaml"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    with np.load(one / "reference.npz") as a, np.load(other / "reference.npz") as b:
        assert a.files == b.files
        for name in a.files:
            if name != "compute_s":  # how long it took is no result
                assert a[name].tobytes() == b[name].tobytes(), name


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_pipeline_runs_again_after_a_reset(solver: str) -> None:
    registry = Registry(entry_points=False)
    spec = load_pipeline(
        "retarget", registry, uses=[f"solve={solver}"], sets=[f"source.{option}" for option in SETS]
    )
    pipeline = Pipeline(spec, registry)
    first = np.array([record.state.q.copy() for record in pipeline.records(90)])
    pipeline.reset()
    again = np.array([record.state.q.copy() for record in pipeline.records(90)])
    other = Pipeline(spec, registry)
    fresh = np.array([record.state.q.copy() for record in other.records(90)])
    pipeline.close()
    other.close()
    assert first.tobytes() == again.tobytes() == fresh.tobytes()


def test_another_seed_gives_another_motion(tmp_path: Path) -> None:
    registry = Registry(entry_points=False)
    motions = []
    for seed in (4, 5):
        sets = [f"source.{option}" for option in SETS[:-1]] + [f"source.seed={seed}"]
        pipeline = Pipeline(load_pipeline("retarget", registry, sets=sets), registry)
        motions.append(np.array([record.state.q.copy() for record in pipeline.records(30)]))
        pipeline.close()
    assert np.abs(motions[0] - motions[1]).max() > 1e-4


def test_a_start_at_another_time_gives_the_same_motion() -> None:
    """The motion depends on what the human does, not on when the clock started."""
    from imitor.testing import make_frames

    registry = Registry(entry_points=False)
    runs = []
    for shift in (0.0, 1000.0):
        pipeline = Pipeline(
            load_pipeline("retarget", registry, sets=["source.scenario=step_forward", "source.rate_hz=30"]),
            registry,
        )
        q = []
        for frame in make_frames("step_forward", 90):
            frame.time_s += shift
            pipeline.step(frame)
            q.append(pipeline.state.q.copy())
        pipeline.close()
        runs.append(np.array(q))
    assert runs[0].tobytes() == runs[1].tobytes()


@pytest.mark.parametrize("yaw", [0.7, -2.5, np.pi])
def test_another_place_and_heading_give_the_same_motion_there(yaw: float) -> None:
    """Turn and move the human in the world: the joints do the same, the base turns and moves along."""
    from dataclasses import replace

    from imitor.testing import make_frames

    registry = Registry(entry_points=False)
    R = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([3.0, -2.0, 0.0])
    runs, places = [], []
    for turned in (False, True):
        pipeline = Pipeline(
            load_pipeline("retarget", registry, sets=["source.scenario=step_forward", "source.rate_hz=30"]),
            registry,
        )
        q, feet = [], []
        for frame in make_frames("step_forward", 120):
            human = frame
            if turned:
                com = None if frame.com is None else R @ frame.com + shift
                human = replace(frame, position=frame.position @ R.T + shift, com=com, orientation=None)
            pipeline.step(human)
            q.append(pipeline.state.q.copy())
            feet.append(pipeline.robot.position("left_foot").copy())
        pipeline.close()
        runs.append(np.array(q))
        places.append(np.array(feet))
    np.testing.assert_allclose(runs[1][:, 7:], runs[0][:, 7:], atol=1e-5)
    moved = [p - p[0] for p in places]
    np.testing.assert_allclose(moved[1], moved[0] @ R.T, atol=1e-5)
