"""One line about a live run, a few times a second on a terminal, now and then elsewhere; works over ssh."""

from __future__ import annotations

import contextlib
import sys
import threading
from contextlib import AbstractContextManager
from typing import Final, TextIO

from imitor.cli.logged import logged
from imitor.live.operator import HELP
from imitor.live.run import LiveRun

REDRAW_S: Final = 0.25
LINE_S: Final = 10.0
_CLEAR: Final = "\r\x1b[2K"


class LiveStatus:
    """Shows rates, latency, state and losses while the context lasts.

    Args:
        stream: Where to write; by default the terminal of errors.
        quiet: Say nothing.
    """

    def __init__(self, stream: TextIO | None = None, *, quiet: bool = False) -> None:
        self.stream = stream if stream is not None else sys.stderr
        self._quiet = quiet
        self._terminal = not quiet and self.stream.isatty()
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._keys = False

    def watch(self, live: LiveRun, *, keys: bool = False) -> None:
        """Begin to show a run.

        Args:
            live: The run.
            keys: Whether the operator's keys are listened to.
        """
        if self._quiet:
            return
        receiver = live.source.receiver
        if receiver is not None:
            self._say(f"listening at {live.source.config.host}:{receiver.port} ({live.source.name})")
        if keys:
            self._say(HELP)
        self._thread = threading.Thread(target=self._run, args=(live,), name="imitor-status", daemon=True)
        self._thread.start()

    def logged(self) -> AbstractContextManager[None]:
        """Say what the logger ``imitor`` is told while the context lasts; when quiet, warnings alone are seen."""
        return contextlib.nullcontext() if self._quiet else logged(self._tell)

    def _tell(self, text: str) -> None:
        self._say(_CLEAR + text if self._terminal else text)

    def __enter__(self) -> LiveStatus:
        return self

    def __exit__(self, *exc: object) -> None:
        self._closing.set()
        if self._thread is not None:
            self._thread.join(2.0)
            if self._terminal:
                self._write("\n")

    def _run(self, live: LiveRun) -> None:
        rates = _Rates(live)
        while not self._closing.wait(REDRAW_S if self._terminal else LINE_S):
            line = status_line(live, rates)
            if self._terminal:
                self._write(_CLEAR + line[: _width(self.stream)])
            else:
                self._say(line)

    def _say(self, text: str) -> None:
        self._write(text + "\n")

    def _write(self, text: str) -> None:
        try:
            self.stream.write(text)
            self.stream.flush()
        except (OSError, ValueError):  # a terminal that went away is no reason to stop a robot
            self._closing.set()


class _Rates:
    """Instants, steps and commands a second since the last look."""

    def __init__(self, live: LiveRun) -> None:
        import time

        self._clock = time.perf_counter
        self._at, self._before = self._clock(), self._counts(live)

    @staticmethod
    def _counts(live: LiveRun) -> tuple[int, int, int]:
        sent = 0 if live.output is None else live.output.sent
        return live.source.reception.samples, live.report.steps, sent

    def now(self, live: LiveRun) -> list[float]:
        at, counts = self._clock(), self._counts(live)
        between = max(at - self._at, 1e-6)
        out = [(a - b) / between for a, b in zip(counts, self._before, strict=True)]
        self._at, self._before = at, counts
        return out


def status_line(live: LiveRun, rates: _Rates) -> str:
    """Return the line: state, rates, latency, losses."""
    received, steps, sent = rates.now(live)
    reception, report = live.source.reception, live.report
    latency = report.latency if live.output is None or not live.output.latency.count else live.output.latency
    parts = [f"{live.pipeline.tracking.state.value}", f"in {received:.0f}/s", f"solved {steps:.0f}/s"]
    if live.output is not None:
        parts.append(f"out {sent:.0f}/s")
    if latency.count:
        parts.append(f"latency {1e3 * latency.quantile(0.5):.1f} ms (p99 {1e3 * latency.quantile(0.99):.1f})")
    bad = reception.malformed + reception.foreign
    parts.append(f"lost {reception.lost}, late {reception.reordered}" + (f", of no use {bad}" if bad else ""))
    tracking = live.pipeline.tracking.report
    parts.append(f"losses {tracking.losses}, stops {tracking.stops}")
    return " | ".join(parts)


def _width(stream: TextIO) -> int:
    import os

    try:
        return max(20, os.get_terminal_size(stream.fileno()).columns - 1)
    except (OSError, ValueError):
        return 100
