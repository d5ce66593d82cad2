"""A thread that asks a sender, from the socket that listens, so that the answers come where the poses come."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Sequence


class Asker:
    """Sends what is to be sent, again and again, until it is closed.

    Args:
        sock: The socket that listens.
        address: Whom to ask.
        requests: Returns the datagrams to be sent now.
        every_s: How often [s].
    """

    def __init__(
        self,
        sock: socket.socket,
        address: tuple[str, int],
        requests: Callable[[], Sequence[bytes]],
        every_s: float,
    ) -> None:
        self._socket, self._address, self._requests, self._every_s = sock, address, requests, every_s
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="imitor-asker", daemon=True)
        self._thread.start()

    def _ask(self) -> None:
        while not self._closing.is_set():
            for datagram in self._requests():
                with contextlib.suppress(OSError):  # nobody there yet, or the socket is closed
                    self._socket.sendto(datagram, self._address)
            self._closing.wait(self._every_s)

    def close(self) -> None:
        """Stop asking; safe to call again."""
        self._closing.set()
        self._thread.join(2.0)


__all__ = ["Asker"]
