"""A live run over a bad network for a long time: exceptions, memory, commands outside limits, latency.

    python benchmarks/live_soak.py --minutes 60
    python benchmarks/live_soak.py --minutes 2 --preset koenemann_2014 --robot nao_v4 --loss 0 --jitter 0 --reorder 0 \
        --prepare

A sender in a process of its own plays the performer as JSON datagrams; a robot sink checks every command against the
limits of the card. With ``--prepare`` it makes all of them before the first one leaves, and takes hardly any of this
machine's time from the run, as if another machine sent. Memory is the resident set of this process; warm-up is the
first tenth of the run, at most 2 min.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from imitor import Config, Record, RunInfo, Sink
from imitor.live.operator import Operator
from imitor.live.run import LiveRun
from imitor.registry import Registry
from imitor.robot.model import BASE_NQ
from imitor.run import run
from imitor.spec import load_pipeline

SLACK = 1e-9


class Checked(Sink[Config]):
    """Checks every command and keeps nothing."""

    name = "checked"
    realtime = True
    last: Checked

    def open(self, run: RunInfo) -> None:
        """Note the limits."""
        robot = run.robot
        self.lower, self.upper = robot.lower - SLACK, robot.upper + SLACK
        self.step = robot.speed / run.rate_hz + SLACK
        self.joints: Any = None
        self.commands = self.outside = self.too_fast = self.not_finite = 0
        Checked.last = self

    def write(self, record: Record) -> None:
        """Check one command."""
        joints = record.state.q[BASE_NQ:]
        self.commands += 1
        self.not_finite += not np.isfinite(record.state.q).all()
        self.outside += bool((joints < self.lower).any() or (joints > self.upper).any())
        if self.joints is not None:
            self.too_fast += bool((np.abs(joints - self.joints) > self.step).any())
        self.joints = joints.copy()


def resident_mb() -> float:
    """Return the memory of this process that is in use [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def unit_ms() -> float:
    """Return the median time of one SVD of 30 x 30 [ms]: what the other times are to be compared with."""
    matrix, times = np.random.default_rng(0).normal(size=(30, 30)), []
    for _ in range(200):
        begin = time.perf_counter()
        np.linalg.svd(matrix)
        times.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(times))


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--preset", default="retarget")
    parser.add_argument("--robot")
    parser.add_argument("--scenario", default="single_leg_balance")
    parser.add_argument("--rate", type=float, default=100.0)
    parser.add_argument("--port", type=int, default=9881)
    parser.add_argument(
        "--set", action="append", default=[], dest="sets", help="change an option of the pipeline"
    )
    parser.add_argument(
        "--prepare", action="store_true", help="make the datagrams before the run, see `imitor stream`"
    )
    parser.add_argument("--json", type=Path, help="write what was found to this file too")
    for name, value in (("loss", 2.0), ("jitter", 20.0), ("reorder", 2.0)):
        parser.add_argument(f"--{name}", type=float, default=value)
    args = parser.parse_args()
    registry = Registry(entry_points=False)
    registry.add(Checked, "benchmark")
    sets = [
        f"source.port={args.port}",
        f"rate_hz={args.rate}",
        f"source.wait_s={120 + 5 * args.minutes}",
        *args.sets,
    ]
    spec = load_pipeline(
        args.preset, registry, source="joints_udp", robot=args.robot, sets=sets, add_sinks=["checked"]
    )
    ahead = ["--prepare", "--seconds", str(60.0 * args.minutes + 60.0)] if args.prepare else []
    sender = subprocess.Popen(
        [sys.executable, "-m", "imitor.cli", "stream", "--source", "performer", "--set",
         f"source.scenario={args.scenario}", "--as", "joints_udp", "--to", f"127.0.0.1:{args.port}", "--loop",
         "--quiet", "--rate", str(args.rate), "--loss", str(args.loss), "--jitter", str(args.jitter), "--reorder",
         str(args.reorder), *ahead],
    )  # fmt: skip
    memory: list[tuple[float, float]] = []
    operator = Operator()

    def observe(live: LiveRun) -> None:
        threading.Thread(target=watch, args=(live,), daemon=True).start()

    def watch(live: LiveRun) -> None:
        start = time.perf_counter()
        while (passed := time.perf_counter() - start) < 60.0 * args.minutes:
            memory.append((passed, resident_mb()))
            if len(memory) % 30 == 1:
                figures = live.figures()["output"]["latency"]
                print(f"{passed:7.0f} s  {memory[-1][1]:7.1f} MB  {figures}", flush=True)
            time.sleep(min(10.0, 6.0 * args.minutes))
        operator.quits = True

    try:
        with tempfile.TemporaryDirectory() as folder:
            result = run(spec, registry, out_dir=Path(folder) / "run", operator=operator, observe=observe)
    finally:
        sender.kill()
    found = report(result.status, result.message, result.metrics, memory, args.minutes)
    found["unit, one SVD of 30 x 30 [ms]"] = unit_ms()
    for name, value in found.items():
        print(f"{name}: {value}")
    if args.json:
        args.json.write_text(json.dumps(found, indent=1), encoding="utf-8")


def report(
    status: str, message: str, metrics: dict[str, Any], memory: list[tuple[float, float]], minutes: float
) -> dict[str, Any]:
    """Return what was found."""
    live, checked = metrics["live"], Checked.last
    warm_s = min(120.0, 6.0 * minutes)
    after = [mb for at, mb in memory if at >= warm_s]
    return {
        "ended": f"{status} {message}".strip(),
        "steps": live["steps"],
        "steps without a frame": live["without_frame"],
        "steps longer than a period": live["overruns"],
        "commands": checked.commands,
        "commands not finite": checked.not_finite,
        "commands outside limits": checked.outside,
        "commands too fast": checked.too_fast,
        "commands scaled by the output's guard": live["output"]["guard_scaled"],
        "reception": live["reception"],
        "tracking": metrics["tracking"],
        "time of a step": live["compute"],
        "latency to command": live["output"]["latency"],
        "latency to solution": live["latency_to_solution"],
        "memory after warm-up, at the end [MB]": [round(after[0], 1), round(after[-1], 1)],
        "memory grown [%]": round(100 * (after[-1] / after[0] - 1), 2),
    }


if __name__ == "__main__":
    main()
