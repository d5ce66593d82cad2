"""One thread that reads a socket: what is wrong is counted, what is old is dropped, the newest is kept."""

from __future__ import annotations

import contextlib
import ipaddress
import math
import socket
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final

from imitor.errors import ImitorError
from imitor.live.mailbox import Mailbox
from imitor.live.sample import BadDatagram, Decoder, Foreign, Sample

LARGEST_DATAGRAM: Final = 65535
RECEIVE_BUFFER: Final = 1 << 20
"""Bytes that the system keeps for us between two reads."""
RESTART_AFTER: Final = 1000
"""A count that falls by more is a sender that began anew, not a late datagram [samples]."""
SILENCE_S: Final = 1.0
"""After so long a silence any count is a new beginning [s]."""
NO_USE: Final = (BadDatagram, ValueError, IndexError, KeyError, OverflowError, RecursionError, struct.error)
"""What a decoder raises at a datagram that is no use."""
_POLL_S: Final = 0.2


@dataclass
class Reception:
    """What was received [datagrams], and what became of the instants in them [samples]."""

    datagrams: int = 0
    malformed: int = 0
    foreign: int = 0
    samples: int = 0
    duplicated: int = 0
    reordered: int = 0
    lost: int = 0
    restarts: int = 0

    def figures(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Arrival:
    """A sample and when its last datagram arrived by our monotonic clock [s]."""

    sample: Sample
    at_s: float


class Order:
    """Tells new samples from old ones by the sender's count."""

    def __init__(self, reception: Reception) -> None:
        self._reception = reception
        self._last: int | None = None
        self._at_s = -math.inf

    def accepts(self, counter: int, at_s: float) -> bool:
        """Tell whether a sample is newer than every one before; count it either way."""
        last, r = self._last, self._reception
        silent = at_s - self._at_s > SILENCE_S
        if last is not None and not silent and last - RESTART_AFTER < counter <= last:
            if counter == last:
                r.duplicated += 1
            else:
                r.reordered += 1
                r.lost = max(0, r.lost - 1)  # it came late, but it came
            return False
        if last is not None:
            if counter <= last or counter > last + RESTART_AFTER:
                r.restarts += 1
            else:
                r.lost += counter - last - 1
        self._last, self._at_s = counter, at_s
        r.samples += 1
        return True


class Receiver:
    """Reads datagrams in a thread of its own and keeps the newest sample.

    Args:
        sock: A bound datagram socket; closed by `close`.
        decoder: Makes samples out of datagrams.
        senders: Addresses to listen to; empty: everybody.

    Attributes:
        box: Where the newest sample lies.
        reception: What was received so far.
        port: The port that is listened at.
    """

    def __init__(self, sock: socket.socket, decoder: Decoder, senders: Sequence[str] = ()) -> None:
        self.box: Mailbox[Arrival] = Mailbox()
        self.reception = Reception()
        self.port = int(sock.getsockname()[1])
        self._socket, self._decoder, self._senders = sock, decoder, frozenset(senders)
        self._order = Order(self.reception)
        self._closing = threading.Event()
        sock.settimeout(_POLL_S)
        self._thread = threading.Thread(target=self._read, name="imitor-receiver", daemon=True)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def take(self, datagram: bytes, sender: str = "", at_s: float = 0.0) -> None:
        """Take one datagram; what is no use is counted and forgotten."""
        r = self.reception
        r.datagrams += 1
        try:
            if self._senders and sender not in self._senders:
                raise Foreign
            sample = self._decoder.decode(datagram)
        except Foreign:
            r.foreign += 1
            return
        except NO_USE:
            r.malformed += 1
            return
        if sample is not None and self._order.accepts(sample.counter, at_s):
            self.box.put(Arrival(sample, at_s))

    def _read(self) -> None:
        sock, clock = self._socket, time.perf_counter
        while not self._closing.is_set():
            try:
                datagram, sender = sock.recvfrom(LARGEST_DATAGRAM)
            except TimeoutError:
                continue
            except ConnectionError:  # an earlier answer of ours found nobody
                continue
            except OSError:  # closed, or a network that went away and may come back
                self._closing.wait(_POLL_S)
                continue
            self.take(datagram, sender[0], clock())

    def close(self) -> None:
        """Stop listening; safe to call again."""
        self._closing.set()
        self.box.close()
        with contextlib.suppress(OSError):
            self._socket.close()
        if self._thread.is_alive():
            self._thread.join(2.0)


def bind(host: str, port: int, *, multicast: str = "") -> socket.socket:
    """Return a datagram socket that listens at an address.

    Args:
        host: Address of the interface to listen at; 127.0.0.1 hears this machine alone, 0.0.0.0 everybody.
        port: Port; 0 takes a free one.
        multicast: Group to join on that interface; empty: none.

    Raises:
        ImitorError: The address is no address of this machine, or the port is taken.
    """
    try:
        family = socket.AF_INET6 if ipaddress.ip_address(host).version == 6 else socket.AF_INET
    except ValueError:
        raise ImitorError(f"host '{host}' is no IP address; 127.0.0.1 hears this machine alone") from None
    sock = socket.socket(family, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        if multicast:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(("", port))
            group = socket.inet_aton(multicast) + socket.inet_aton(host)
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        else:
            sock.bind((host, port))
    except (OSError, OverflowError) as error:
        sock.close()
        why = getattr(error, "strerror", None) or str(error)
        raise ImitorError(
            f"cannot listen at {host}:{port}: {why}; does another program listen there, or is the address another's?"
        ) from None
    return sock


__all__ = ["Arrival", "Receiver", "Reception", "bind"]
