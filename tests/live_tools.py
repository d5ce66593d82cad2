"""A capture system and a robot for tests of live runs: a sender in a process of its own, a sink that keeps commands."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from imitor import Config, Record, RunInfo, Sink
from imitor.live.operator import Operator
from imitor.live.run import LiveRun
from imitor.registry import Registry
from imitor.run import RunResult, run
from imitor.spec import load_pipeline
from imitor.types import Array


class Kept(Sink[Config]):
    """A robot that remembers what it was told and when."""

    name = "kept"
    realtime = True
    told: list[Kept] = []  # noqa: RUF012 - instances are made by the runner; tests look here

    def open(self, run: RunInfo) -> None:
        self.robot, self.rate_hz = run.robot, run.rate_hz
        self.q: list[Array] = []
        self.time_s: list[float] = []
        self.status: list[int] = []
        Kept.told.append(self)

    def write(self, record: Record) -> None:
        self.q.append(record.state.q.copy())
        self.time_s.append(record.time_s)
        self.status.append(record.state.status)

    def joints(self) -> Array:
        """Return the commanded joints, shape (T, n) [rad]."""
        return np.array(self.q)[:, 7:]


def heeds_interrupts(*arguments: str) -> list[str]:
    """Return a command of imitor that heeds SIGINT, which a background job is started to ignore."""
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from imitor.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    return [sys.executable, "-c", code, *arguments]


def registry() -> Registry:
    """Return the built-in plugins and the robot of tests."""
    out = Registry(entry_points=False)
    out.add(Kept, "tests")
    return out


def free_port() -> int:
    """Return a port that nobody listens at now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@contextmanager
def sender(port: int, *arguments: str, protocol: str = "joints_udp") -> Iterator[subprocess.Popen[bytes]]:
    """Stream the performer to a port for as long as the context lasts."""
    command = [
        sys.executable, "-m", "imitor.cli", "stream", "--as", protocol, "--to", f"127.0.0.1:{port}", "--loop",
        "--quiet", *arguments,
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def live(
    preset: str,
    out_dir: Path,
    port: int,
    *,
    plugins: Registry | None = None,
    frames: int | None = None,
    sets: Sequence[str] = (),
    source: str = "joints_udp",
    sinks: Sequence[str] = ("kept",),
    operator: Operator | None = None,
    robot: str | None = None,
    observe: Callable[[LiveRun], None] | None = None,
) -> RunResult:
    """Run a preset live from a port."""
    plugins = plugins or registry()
    own = [f"source.port={port}", "source.learn_s=0.5", "source.wait_s=60"]
    spec = load_pipeline(
        preset, plugins, source=source, robot=robot, sets=[*own, *sets], add_sinks=list(sinks)
    )
    return run(spec, plugins, out_dir=out_dir, max_frames=frames, operator=operator, observe=observe)


def later(seconds: float, act: Any, *arguments: Any) -> threading.Timer:
    """Call something later, from another thread."""
    timer = threading.Timer(seconds, act, arguments)
    timer.daemon = True
    timer.start()
    return timer
