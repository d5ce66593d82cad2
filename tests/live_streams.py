"""What tests of live sources share: recordings to send, what comes out at the other end, and a real socket."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imitor.kinds import Source
from imitor.live.receiver import Receiver
from imitor.live.sample import Decoder, Sample
from imitor.live.source import LiveSource
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.types import HumanFrame

Array = NDArray[np.float64]


def performer(scenario: str = "walk_in_place", **options: Any) -> Performer:
    """Return a started performer."""
    source = Performer(PerformerConfig(scenario=scenario, **{"rate_hz": 60.0, **options}))
    source.start()
    return source


def datagrams(cls: type[LiveSource[Any]], source: Source[Any], n: int | None = None) -> list[bytes]:
    """Return what a protocol sends for a recording."""
    encoder = cls.encoder(source)
    return [d for i, f in enumerate(islice(source.frames(), n)) for d in encoder.encode(f, i)]


def decoded(decoder: Decoder, packets: Sequence[bytes]) -> list[Sample]:
    """Return the samples in some datagrams."""
    return [s for s in map(decoder.decode, packets) if s is not None]


def received(
    live: LiveSource[Any], source: Source[Any], n: int | None = None, *, learn: int | None = None
) -> list[HumanFrame]:
    """Return the frames of a recording after it was sent and received, without a socket."""
    samples = decoded(live.decoder(), datagrams(type(live), source, n))
    live.rate_hz = source.rate_hz
    live.learn(samples[:learn])
    return [live.human(s, i / source.rate_hz) for i, s in enumerate(samples)]


def taken(decoder: Decoder, packets: Sequence[bytes]) -> Receiver:
    """Return a receiver that was given some datagrams; it has a socket, but nothing is read from it."""
    receiver = Receiver(socket.socket(socket.AF_INET, socket.SOCK_DGRAM), decoder)
    for i, packet in enumerate(packets):
        receiver.take(packet, at_s=0.001 * i)
    receiver.close()
    return receiver


@contextlib.contextmanager
def listening(
    live: LiveSource[Any], source: Source[Any], *, rate_hz: float = 100.0
) -> Iterator[LiveSource[Any]]:
    """Start a live source at a free port of this machine and send it a recording, over and over."""
    failed: list[BaseException] = []
    done = threading.Event()

    def start() -> None:
        try:
            live.start()
        except BaseException as error:  # shown in the test's own thread
            failed.append(error)

    def send() -> None:
        encoder = type(live).encoder(source)
        frames = list(source.frames())
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            for i in range(100_000):
                if done.is_set():
                    return
                frame = frames[i % len(frames)]
                sent = HumanFrame(i / rate_hz, frame.position, frame.valid, frame.orientation, frame.marker)
                sent.marker_valid = frame.marker_valid
                for packet in encoder.encode(sent, i):
                    sock.sendto(packet, ("127.0.0.1", port))
                time.sleep(1 / rate_hz)

    starting = threading.Thread(target=start)
    starting.start()
    while (receiver := live.receiver) is None and not failed:
        time.sleep(0.001)
    port = 0 if receiver is None else receiver.port
    sending = threading.Thread(target=send)
    sending.start()
    try:
        starting.join()
        if failed:
            raise failed[0]
        yield live
    finally:
        done.set()
        sending.join()
        live.close()
