"""What the operator asks for: keys on the terminal, or calls from a program."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, Final

from imitor.safety.tracking import Request

KEYS: Final = {"p": Request.PAUSE, " ": Request.PAUSE, "r": Request.RESUME, "s": Request.STOP}
HELP: Final = "keys: p or space pause, r resume, s stop, q quit"
_ESCAPE: Final = b"\x1b"
_QUIT: Final = "q"
_POLL_S: Final = 0.2


class Operator:
    """Takes requests from whatever thread; the run takes one a step.

    Attributes:
        quits: Whether the run is to end.
        interrupted: Whether it is to end because of Ctrl-C.
    """

    def __init__(self) -> None:
        self._stop, self._last = False, Request.NONE
        self._lock = threading.Lock()
        self.quits = self.interrupted = False

    def ask(self, request: Request) -> None:
        """Ask for something at the next step: a stop, which is never forgotten, and then what was asked for last."""
        with self._lock:
            if request is Request.STOP:
                self._stop, self._last = True, Request.NONE
            else:
                self._last = request

    def take(self) -> Request:
        """Return what is asked for, if anything."""
        with self._lock:
            if self._stop:
                self._stop = False
                return Request.STOP
            request, self._last = self._last, Request.NONE
            return request

    @contextlib.contextmanager
    def on_interrupt(self) -> Iterator[None]:
        """End the run at Ctrl-C, SIGTERM or a lost terminal after this step; a second Ctrl-C interrupts it."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def leave(number: int, frame: FrameType | None) -> None:
            if self.interrupted and number == signal.SIGINT:
                raise KeyboardInterrupt
            self.quits = self.interrupted = True

        ends = [signal.SIGINT, signal.SIGTERM]
        hang_up = getattr(signal, "SIGHUP", None)
        if hang_up is not None and signal.getsignal(hang_up) is not signal.SIG_IGN:  # nohup ignores it
            ends.append(hang_up)
        before = {s: signal.signal(s, leave) for s in ends}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextlib.contextmanager
    def keys(self) -> Iterator[bool]:
        """Listen to keys while the context lasts; yields whether there is a terminal to listen to.

        SIGTERM then ends the program by way of `SystemExit`, so that the terminal is left as it was.
        """
        listener = _Keys(self) if sys.stdin is not None and sys.stdin.isatty() else None
        if listener is None:
            yield False
            return
        main = threading.current_thread() is threading.main_thread()
        before = signal.signal(signal.SIGTERM, _leave) if main else None
        try:
            yield listener.begin()
        finally:
            if main:
                signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the terminal first
            listener.end()
            if main:
                signal.signal(signal.SIGTERM, before)

    def press(self, key: str) -> None:
        """Take a key."""
        if key == _QUIT:
            self.quits = True
        elif key in KEYS:
            self.ask(KEYS[key])


def _leave(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


class _Keys(threading.Thread):
    """Reads single keys of a terminal, which is left as it was."""

    def __init__(self, operator: Operator) -> None:
        super().__init__(name="imitor-keys", daemon=True)
        self._operator = operator
        self._closing = threading.Event()
        self._before: list[Any] | None = None

    def begin(self) -> bool:
        try:
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        except (ImportError, OSError, ValueError):  # no such terminal here
            return False
        self.start()
        return True

    def run(self) -> None:
        import select

        while not self._closing.is_set():
            ready, _, _ = select.select([sys.stdin], [], [], _POLL_S)
            if not ready:
                continue
            try:
                pressed = os.read(sys.stdin.fileno(), 64)  # all that was: none waits for the next key
            except OSError:
                return
            if not pressed:  # the terminal went away
                return
            if not pressed.startswith(_ESCAPE):  # F3 is no r
                for key in pressed.decode(errors="ignore").lower():
                    self._operator.press(key)

    def end(self) -> None:
        if self._before is None:
            return
        import termios

        self._closing.set()
        self.join(1.0)
        with contextlib.suppress(termios.error, OSError, ValueError):  # it went away
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)


__all__ = ["HELP", "KEYS", "Operator"]
