"""The Rerun viewer, or a server for viewers elsewhere, as a process that is fed through a pipe.

The recording's own connection waits for a viewer that does not answer, for ever when it is to be closed, and its own
server listens at every address. Here nothing waits longer than it is told to, and what is not taken yet is known.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from typing import Final

from imitor.errors import SinkError

START_S: Final = 15.0
"""How long a viewer may take until it listens [s]."""
_POLL_S: Final = 0.02


class RerunProcess:
    """A process that shows or serves the bytes of a recording.

    Args:
        arguments: What follows the program's name; see `window` and `server`.
        address: Host and port where it will listen.
        first: The first bytes; a server reads them before it listens.
        stays: Whether it goes on when this program ends, as a window does.

    Raises:
        SinkError: It does not start; says why.
    """

    def __init__(
        self, arguments: Sequence[str], address: tuple[str, int], first: bytes, *, stays: bool
    ) -> None:
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process
        self._stays = stays
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rerun_cli", "-", *arguments],
            stdin=subprocess.PIPE, stdout=self._said, stderr=self._said,
            env={**os.environ, "RUST_LOG": "error"}, start_new_session=True,
        )  # fmt: skip
        if not stays:
            atexit.register(self.close)
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._rest = memoryview(first)
        self._await(address)

    def _await(self, address: tuple[str, int]) -> None:
        end = time.perf_counter() + START_S
        while time.perf_counter() < end and self.alive:
            self.taken(_POLL_S)
            with contextlib.suppress(OSError), socket.create_connection(address, 1.0):
                return
            time.sleep(_POLL_S)
        said = self.complaint()
        self.close(kill=True)
        raise SinkError(f"the Rerun viewer does not start{f': {said}' if said else ''}")

    @property
    def alive(self) -> bool:
        """Whether the process is there."""
        return self._process.poll() is None

    def taken(self, patience_s: float = 0.0) -> bool:
        """Hand over what is left; return whether all was taken.

        Args:
            patience_s: How long to wait for that at most [s].
        """
        end = time.perf_counter() + patience_s
        while self._rest:
            try:
                self._rest = self._rest[os.write(self._pipe, self._rest) :]
            except BlockingIOError:
                wait = end - time.perf_counter()
                if wait <= 0 or not self.alive:
                    return False
                select.select([], [self._pipe], [], min(wait, 0.2))
            except OSError:  # it is gone
                return False
        return True

    def send(self, content: bytes) -> None:
        """Hand over bytes; the rest of what was sent before must be taken."""
        if self._rest:
            raise ValueError("what was sent before is not taken yet")
        self._rest = memoryview(content)
        self.taken()

    def complaint(self) -> str:
        """Return the first line of what the process complained about, empty when it did not."""
        self._said.seek(0)
        lines = self._said.read().decode("utf-8", "replace").splitlines()
        marks = ("panicked", "ERROR", "error", "Error")
        return next((line.strip() for line in lines if any(m in line for m in marks)), "")

    def close(self, *, kill: bool = False) -> None:
        """Send nothing more, and end a process that does not stay; safe to call again.

        Args:
            kill: End it even if it stays.
        """
        atexit.unregister(self.close)
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        if (kill or not self._stays) and self.alive:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        self._said.close()


def window(memory_mb: int) -> tuple[list[str], tuple[str, int]]:
    """Return arguments and address of a viewer that forgets the oldest frames beyond a size [MB]."""
    port = _free_port("127.0.0.1")
    limits = ["--memory-limit", f"{memory_mb}MB", "--server-memory-limit", f"{max(memory_mb // 4, 1)}MB"]
    return ["--bind", "127.0.0.1", "--port", str(port), *limits], ("127.0.0.1", port)


def server(host: str, port: int, memory_mb: int) -> tuple[list[str], tuple[str, int]]:
    """Return arguments and address of a server for viewers elsewhere.

    Args:
        host: Address to listen at.
        port: Port, 0 for a free one.
        memory_mb: It forgets the oldest frames beyond this size [MB].

    Raises:
        SinkError: The address is not of this machine, or the port is taken.
    """
    try:
        port = port or _free_port(host)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.create_server((host, port), family=family):
            pass
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
        raise SinkError(
            f"nothing can be served at {host}:{port}: {reason}; set `host` or `port`, or end the program there"
        ) from None
    limit = ["--server-memory-limit", f"{memory_mb}MB"]
    near = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return ["--serve-grpc", "--bind", host, "--port", str(port), *limit], (near, port)


def _free_port(host: str) -> int:
    with socket.create_server((host, 0), family=socket.AF_INET6 if ":" in host else socket.AF_INET) as sock:
        return int(sock.getsockname()[1])


__all__ = ["RerunProcess", "server", "window"]
