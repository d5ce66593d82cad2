"""The live view in Rerun: what viewers elsewhere get, what is kept, and what happens when nobody takes it."""

from __future__ import annotations

import argparse
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor.cli import run as command
from imitor.errors import SinkError
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.visual.rerun_process import RerunProcess, server, window
from live_tools import free_port, live, sender
from test_sinks_files import Play, make

LONG = 8000


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry(entry_points=False)


@pytest.fixture(scope="module")
def robot(registry: Registry) -> RobotModel:
    return RobotModel.load("unitree_g1", registry)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


class Served:
    """A sink that serves at a free port."""

    def __init__(self, registry: Registry, play: Play, **options: Any) -> None:
        with socket.create_server(("127.0.0.1", 0)) as sock:
            self.port = int(sock.getsockname()[1])
        self.sink = make(registry, "rerun_live", **{"port": self.port, "memory_mb": 64, **options})
        self.sink.start()
        self.sink.open(play.info)

    @property
    def process(self) -> RerunProcess:
        process = self.sink._process
        assert isinstance(process, RerunProcess)
        return process

    def signal(self, number: int) -> None:
        os.killpg(self.process._process.pid, number)

    def seen(self, path: Path) -> Path:
        """Write what a viewer elsewhere gets to a file, and end the sink."""
        url = f"rerun+http://127.0.0.1:{self.port}/proxy"
        program = [sys.executable, "-m", "rerun_cli", url, "--save", str(path)]
        with subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as viewer:
            size, same = -1, 0
            while same < 10:
                time.sleep(0.1)
                now = path.stat().st_size if path.exists() else 0
                same = same + 1 if now == size and now > 0 else 0
                size = now
            self.sink.close()
            viewer.wait(30)
        return path


@pytest.fixture
def play(robot: RobotModel, tmp_path: Path) -> Play:
    return Play(robot, tmp_path)


@pytest.fixture
def served(registry: Registry, play: Play) -> Iterator[Served]:
    out = Served(registry, play)
    yield out
    out.sink.close()


def rows_of(path: Path) -> tuple[dict[str, int], set[str]]:
    """Return the number of rows of each entity that changes, and the entities that stay."""
    from rerun.chunk import RrdReader

    rows: dict[str, int] = {}
    fixed: set[str] = set()
    for chunk in RrdReader(path).stream():
        if chunk.is_static:
            fixed.add(chunk.entity_path)
        else:
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    return rows, fixed


def test_who_looks_late_gets_the_same_picture_as_the_file(
    registry: Registry, robot: RobotModel, play: Play, served: Served, tmp_path: Path
) -> None:
    for record in play.records():
        served.sink.write(record)
    report = served.sink.finish()
    assert report.figures["rerun_live"] == {"shown": play.n, "left_out": 0}
    rows, fixed = rows_of(served.seen(tmp_path / "seen.rrd"))
    (path,) = play.into(make(registry, "rerun", max_hz=1000.0)).files
    in_file, fixed_in_file = rows_of(path)
    assert rows == in_file
    assert fixed == fixed_in_file
    assert rows["/world/robot"] == play.n * (robot.n + 1)


def test_latency_of_a_live_run_is_a_curve(play: Play, served: Served, tmp_path: Path) -> None:
    for record in play.records():
        record.latency_s = 0.01 if record.index % 2 else np.nan
        served.sink.write(record)
    served.sink.finish()
    rows, _ = rows_of(served.seen(tmp_path / "seen.rrd"))
    assert rows["/plots/times_ms/latency"] == play.n // 2


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
@pytest.mark.parametrize("stalled", [False, True], ids=["taken", "not-taken"])
def test_memory_does_not_grow(registry: Registry, robot: RobotModel, tmp_path: Path, stalled: bool) -> None:
    play = Play(robot, tmp_path, n=LONG, live=True)
    served = Served(registry, play, max_hz=10.0)
    sent, most, early = 0, 0, 0.0
    send = served.process.send

    def counting(content: bytes) -> None:
        nonlocal sent
        sent += len(content)
        send(content)

    served.process.send = counting  # type: ignore[method-assign]
    if stalled:
        served.signal(signal.SIGSTOP)
    for record in play.records():
        served.sink.write(record)
        most = max(most, len(served.sink._recorder))
        if not stalled:
            served.process.taken(10.0)
        if record.index == LONG // 4:
            early = resident_mb()
    grown = resident_mb() - early
    left_out = served.sink._left_out
    served.sink.close()
    assert most <= 256
    assert grown < 8.0
    if stalled:
        assert left_out > LONG - 600
    else:
        assert left_out == 0
        assert sent > 16e6  # far more than what it grew


def test_a_viewer_that_pauses_delays_nobody_and_gets_the_newest(
    registry: Registry, robot: RobotModel, tmp_path: Path
) -> None:
    play = Play(robot, tmp_path, n=2000, live=True)
    served = Served(registry, play)
    for record in play.records():
        if record.index == 100:
            served.signal(signal.SIGSTOP)
        if record.index == 1900:
            served.signal(signal.SIGCONT)
            assert served.process.taken(10.0)
        served.sink.write(record)
    figures = served.sink.finish().figures["rerun_live"]
    assert figures["left_out"] > 500
    assert figures["shown"] + figures["left_out"] == play.n
    rows, _ = rows_of(served.seen(tmp_path / "seen.rrd"))
    assert rows["/world/com"] == figures["shown"]


def test_a_viewer_that_goes_away_is_told_of_once(
    play: Play, served: Served, caplog: pytest.LogCaptureFixture
) -> None:
    records, process = play.records(), served.process
    assert process.taken(10.0)
    served.sink.write(next(records))
    served.signal(signal.SIGKILL)
    process._process.wait()
    for record in records:
        served.sink._picture_s = 0.0
        served.sink.write(record)
    assert caplog.messages == ["rerun_live: the viewer was closed; the run goes on without it"]
    assert caplog.records[0].levelno == logging.WARNING
    assert served.sink.finish().figures["rerun_live"]["shown"] == 1


def test_the_server_ends_with_the_sink(served: Served) -> None:
    process = served.process
    assert process.alive
    served.sink.close()
    served.sink.close()
    assert not process.alive


def test_it_listens_at_its_own_address_alone(served: Served) -> None:
    with socket.create_connection(("127.0.0.1", served.port), 5.0):
        pass
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", served.port), 5.0)


def test_a_port_that_is_taken(registry: Registry, play: Play, served: Served) -> None:
    sink = make(registry, "rerun_live", port=served.port)
    with pytest.raises(
        SinkError,
        match=rf"^nothing can be served at 127\.0\.0\.1:{served.port}: Address already in use; set `host` or `port`",
    ):
        sink.open(play.info)


def test_an_address_of_another_machine(registry: Registry, play: Play) -> None:
    with pytest.raises(SinkError, match=r"^nothing can be served at 192\.0\.2\.1:9876: Cannot assign"):
        make(registry, "rerun_live", host="192.0.2.1").open(play.info)


def test_without_a_display_it_says_how_to_look(
    registry: Registry, robot: RobotModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imitor.visual.offscreen.headless", lambda: True)
    run = Play(robot, tmp_path, view=True).info
    with pytest.raises(SinkError, match=r"no display here .* --set rerun_live\.serve=true"):
        make(registry, "rerun_live").open(run)
    sink = make(registry, "rerun_live", serve=True, port=0)
    sink.open(run)
    sink.close()


def test_a_viewer_that_does_not_start_says_why() -> None:
    arguments, address = server("127.0.0.1", 0, 64)
    with pytest.raises(SinkError, match=r"^the Rerun viewer does not start: error: .*--no-such-option"):
        RerunProcess([*arguments, "--no-such-option"], address, b"", stays=True)


def test_a_window_keeps_to_its_memory_and_to_this_machine() -> None:
    arguments, (host, port) = window(400)
    assert arguments == [
        "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", "400MB", "--server-memory-limit", "100MB"
    ]  # fmt: skip
    assert host == "127.0.0.1"


@pytest.mark.parametrize(
    ("source", "viewer"), [("joints_udp", "rerun_live"), ("performer", "rerun")], ids=["live", "recorded"]
)
def test_view_shows_a_live_run_live(source: str, viewer: str, registry: Registry) -> None:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    args = parser.parse_args(["retarget", "--view", "--source", source])
    assert [s.name for s in command._load(args, registry).sinks][-1:] == [viewer]


def test_a_live_run_is_shown(tmp_path: Path) -> None:
    port = free_port()
    with sender(port, "--source", "performer", "--set", "source.scenario=wave", "--rate", "30"):
        result = live(
            "retarget", tmp_path / "run", port, frames=60,
            sets=["rate_hz=30", "rerun_live.port=0"], sinks=["rerun_live"],
        )  # fmt: skip
    assert result.status == "done"
    assert result.metrics["rerun_live"]["left_out"] == 0
    assert result.metrics["rerun_live"]["shown"] == result.metrics["live"]["viewers"]["shown"] > 10


def test_the_server_forgets_the_oldest_but_not_the_robot(
    registry: Registry, robot: RobotModel, tmp_path: Path
) -> None:
    from rerun.chunk import RrdReader

    play = Play(robot, tmp_path, n=LONG)
    served = Served(registry, play, memory_mb=16, max_hz=10.0)
    for record in play.records():
        served.sink.write(record)
    assert served.sink.finish().figures["rerun_live"] == {"shown": LONG, "left_out": 0}
    path = served.seen(tmp_path / "seen.rrd")
    rows, fixed = rows_of(path)
    assert 0 < rows["/world/com"] < LONG
    assert "/world/robot/left_knee_joint/part0" in fixed
    assert len(RrdReader(path).blueprints()) == 1
