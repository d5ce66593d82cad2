"""How far a run is: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager
from typing import Any, Final, TextIO

from imitor.cli.logged import logged

_REDRAW_S: Final = 0.1
_LINE_S: Final = 10.0
"""Without a known end, and for slow runs, a line comes at least this often [s]."""


class Progress:
    """Tell a person how far a run is: the runner calls ``progress(done, total)`` after each frame.

    Trouble with the terminal never stops a run: output is given up instead.

    Args:
        stream: Where to write; the terminal of errors, so that results can be piped.
        rate_hz: Frames per second of the motion, for the ratio to real time; may be set later.
        quiet: Say nothing.
    """

    def __init__(
        self, stream: TextIO | None = None, *, rate_hz: float | None = None, quiet: bool = False
    ) -> None:
        self.stream = stream if stream is not None else sys.stderr
        self.rate_hz = rate_hz
        self._mute = quiet
        self._bar: Any = None
        self._task: Any = None
        self._start: float | None = None
        self._next_s = 0.0
        self._next_tenth = 1
        self._terminal = not quiet and self.stream.isatty()

    def __call__(self, done: int, total: int | None) -> None:
        """Report ``done`` frames of ``total`` (``None``: open end)."""
        if self._mute:
            return
        now = time.perf_counter()
        if self._start is None:
            self._start = now
            self._next_s = now + (0.0 if self._terminal else _LINE_S)
        finished = total is not None and done >= total
        if self._terminal:
            if now >= self._next_s or finished:
                self._next_s = now + _REDRAW_S
                self._guarded(self._draw, done, total, now - self._start)
            return
        tenth = total is not None and done * 10 >= total * self._next_tenth
        if tenth or now >= self._next_s:
            self._next_s = now + _LINE_S
            if total:
                self._next_tenth = done * 10 // total + 1
            self._guarded(self._line, done, total, now - self._start)

    def say(self, text: str) -> None:
        """Print a line without tearing the bar."""
        if not self._mute:
            self._guarded(self._print, text)

    def logged(self) -> AbstractContextManager[None]:
        """Say what the logger ``imitor`` is told, e.g. what is prepared once, while the context lasts."""
        return logged(self.say)

    def close(self) -> None:
        """Leave the terminal as it was; safe to call again."""
        bar, self._bar = self._bar, None
        if bar is not None:
            self._guarded(bar.stop)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def speed(self, done: int, elapsed_s: float) -> str:
        """Return the speed as text: ``240 frames/s, 8.0 × real time``."""
        if done == 0 or elapsed_s <= 0:
            return ""
        rate = done / elapsed_s
        text = f"{rate:.0f} frames/s" if rate >= 10 else f"{rate:.1f} frames/s"
        return text + (f", {rate / self.rate_hz:.1f} × real time" if self.rate_hz else "")

    def _guarded(self, act: Any, *args: Any) -> None:
        try:
            act(*args)
        except (OSError, ValueError):
            self._mute = True

    def _print(self, text: str) -> None:
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=self.stream, flush=True)

    def _line(self, done: int, total: int | None, elapsed_s: float) -> None:
        share = f" ({100 * done // total} %)" if total else ""
        of = f" of {total}" if total else ""
        speed = self.speed(done, elapsed_s)
        self._print(f"frame {done}{of}{share}" + (f", {speed}" if speed else ""))

    def _draw(self, done: int, total: int | None, elapsed_s: float) -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as RichProgress

            self._bar = RichProgress(
                TextColumn("{task.completed:.0f} of {task.fields[of]} frames"),
                BarColumn(),
                TextColumn("{task.fields[speed]}"),
                TimeRemainingColumn(),
                console=Console(file=self.stream),
                auto_refresh=False,
            )
            self._task = self._bar.add_task("", completed=done, total=total, of=total or "?", speed="")
            self._bar.start()
        self._bar.update(
            self._task,
            completed=done,
            total=total,
            of=total or "?",
            speed=self.speed(done, elapsed_s),
            refresh=True,
        )
