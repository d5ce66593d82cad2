"""Plays a recording on the network: which datagram leaves when, and a sender that keeps the time.

`departures` decides everything, from a seed and without a clock; `send` only waits and sends.
"""

from __future__ import annotations

import heapq
import itertools
import math
import random
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from imitor.clock import at_rate, copied, played
from imitor.errors import ImitorError
from imitor.kinds import Source
from imitor.live.sender import Encoder

_SPIN_S: Final = 0.0002
"""The last of a wait is spent looking at the clock: a sleep ends too late [s]."""


@dataclass(frozen=True)
class Network:
    """What a network does to datagrams on their way; nothing by default.

    Attributes:
        loss: Share that never arrives [-].
        jitter_s: Greatest delay of those that keep their order [s].
        reorder: Share that is overtaken: it comes one or two periods late [-].
        duplicate: Share that comes a second time, within a period [-].
        seed: Seed of all chance.
    """

    loss: float = 0.0
    jitter_s: float = 0.0
    reorder: float = 0.0
    duplicate: float = 0.0
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Instant:
    """What is told of one instant of the person: when it is to be told, from the start [s], and the datagrams."""

    time_s: float
    datagrams: Sequence[bytes]


@dataclass(frozen=True, slots=True)
class Departure:
    """A datagram and when it leaves, from the start [s]."""

    at_s: float
    datagram: bytes


@dataclass
class Sent:
    """What was sent so far, and what `Network` did to it.

    Attributes:
        instants: Instants of the person begun.
        datagrams, bytes: What left.
        lost, reordered, duplicated: What chance did to datagrams.
        latest_s: How late the latest datagram left by the clock [s].
    """

    instants: int = 0
    datagrams: int = 0
    bytes: int = 0
    lost: int = 0
    reordered: int = 0
    duplicated: int = 0
    latest_s: float = 0.0


def instants(
    source: Source[Any],
    encoder: Encoder,
    *,
    speed: float = 1.0,
    rate_hz: float | None = None,
    loop: bool = False,
    seconds: float = math.inf,
) -> Iterator[Instant]:
    """Yield what is told of each instant of a recording, in order of time, from 0.

    The sender's clock, and its count, go on over the end of a loop; the person jumps there.

    Args:
        source: The recording, started.
        encoder: The protocol.
        speed: Playback speed [-].
        rate_hz: Instants a second on the network; ``None``: those of the recording [Hz].
        loop: Begin again at the end.
        seconds: Where to end, by the sender's clock [s].
    """
    own_hz = source.rate_hz * speed
    wire_hz = rate_hz or own_hz
    counter, start_s = 0, 0.0
    for _ in itertools.count() if loop else range(1):
        source.reset()
        first: float | None = None
        last = start_s
        for frame in at_rate(played(iter(source.frames()), speed), own_hz, wire_hz):
            first = frame.time_s if first is None else first
            last = start_s + (frame.time_s - first)
            if last >= seconds:
                return
            yield Instant(last, encoder.encode(copied(frame, last), counter))
            counter += 1
        if first is None:
            return
        start_s = last + 1.0 / wire_hz


def departures(
    told: Iterable[Instant], network: Network, period_s: float, sent: Sent | None = None
) -> Iterator[Departure]:
    """Yield what leaves when, in order of time.

    Chance is drawn alike for every datagram, so that the same ones are lost whatever the jitter.

    Args:
        told: The instants.
        network: What happens on the way.
        period_s: Time between two instants [s].
        sent: Where to count instants and what chance did.
    """
    sent = Sent() if sent is None else sent
    chance = random.Random(network.seed)
    waiting: list[tuple[float, int, bytes]] = []
    number, line_s = 0, 0.0
    for instant in told:
        while waiting and waiting[0][0] <= instant.time_s:
            yield _departure(heapq.heappop(waiting))
        sent.instants += 1
        for datagram in instant.datagrams:
            loss, jitter, reorder, behind, duplicate, again = (chance.random() for _ in range(6))
            if loss < network.loss:
                sent.lost += 1
                continue
            if reorder < network.reorder:
                sent.reordered += 1
                at_s = instant.time_s + network.jitter_s + (1.0 + behind) * period_s
            else:
                at_s = line_s = max(line_s, instant.time_s + network.jitter_s * jitter)
            copies = [at_s]
            if duplicate < network.duplicate:
                sent.duplicated += 1
                copies.append(at_s + again * period_s)
            for copy_s in copies:
                heapq.heappush(waiting, (copy_s, number, datagram))
                number += 1
    while waiting:
        yield _departure(heapq.heappop(waiting))


def _departure(waiting: tuple[float, int, bytes]) -> Departure:
    return Departure(waiting[0], waiting[2])


def send(
    leaving: Iterable[Departure],
    sock: socket.socket,
    address: tuple[Any, ...],
    sent: Sent,
    *,
    watch: Callable[[float], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Send datagrams, each at its time from now on. Times are absolute: what is late once makes nothing later.

    Args:
        leaving: What leaves when.
        sock: A datagram socket.
        address: Where to, as the socket takes it.
        sent: Where to count; kept up to date, so that it is right when the user interrupts.
        watch: Told the time from the start before each datagram [s].
        clock, sleep: A clock and a way to wait [s].

    Raises:
        ImitorError: The system refuses to send.
    """
    start = clock()
    for departure in leaving:
        due = start + departure.at_s
        if watch is not None:
            watch(departure.at_s)
        left = due - clock()
        if left > _SPIN_S:
            sleep(left - _SPIN_S)
        while (now := clock()) < due:
            pass
        try:
            sock.sendto(departure.datagram, address)
        except OSError as error:
            raise ImitorError(
                f"cannot send {len(departure.datagram)} bytes to {address[0]}:{address[1]}: {error.strerror or error}"
            ) from None
        sent.datagrams += 1
        sent.bytes += len(departure.datagram)
        sent.latest_s = max(sent.latest_s, now - due)


__all__ = ["Departure", "Instant", "Network", "Sent", "departures", "instants", "send"]
