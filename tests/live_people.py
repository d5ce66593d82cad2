"""Live sources heard over a real socket: a sender in a thread plays a person to a free port of this machine."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from imitor.kinds import Source
from imitor.live.receiver import bind
from imitor.live.sample import BadDatagram, Decoder, Sample
from imitor.live.source import LiveSource
from imitor.live.stream import Network, Sent, departures, instants, send
from imitor.testing.live import Played


@contextlib.contextmanager
def heard(
    cls: type[LiveSource[Any]],
    played: Source[Any] | None = None,
    network: Network | None = None,
    **options: Any,
) -> Iterator[LiveSource[Any]]:
    """Yield a started live source to which a person is sent over and over on the loopback interface."""
    played = Played() if played is None else played
    played.start()
    source = cls(cls.config_type(**{"port": 0, "learn_s": 0.5, "wait_s": 20.0, **options}))
    listening = bind("127.0.0.1", 0)
    source.open = lambda: listening  # type: ignore[method-assign]
    over = threading.Event()

    def play() -> None:
        told = instants(played, cls.encoder(played), loop=True)
        leaving = departures(told, network or Network(), 1.0 / played.rate_hz)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            while_open = (d for d in leaving if not over.is_set() or _stop())
            with contextlib.suppress(StopPlaying):
                send(while_open, sock, listening.getsockname(), Sent())

    thread = threading.Thread(target=play, daemon=True)
    thread.start()
    try:
        source.start()
        yield source
    finally:
        over.set()
        source.close()
        thread.join(5.0)


def check_over_a_bad_network(cls: type[LiveSource[Any]], played: Source[Any]) -> None:
    """Check that frames go forward in time over a network that loses, delays and doubles, and all of it is told."""
    bad = Network(loss=0.1, jitter_s=0.002, reorder=0.1, duplicate=0.1, seed=1)
    with heard(cls, played, bad, learn_s=1.2) as source:
        frames = [f for f, _ in zip(source.frames(), range(100), strict=False)]
        r = source.reception
        assert len(frames) == 100
        assert min(r.duplicated, r.reordered) > 0
        assert r.malformed == r.foreign == 0
        assert np.diff([f.time_s for f in frames]).min() > 0


class StopPlaying(Exception):
    """The test is over."""


def _stop() -> bool:
    raise StopPlaying


def decode_all(decoder: Decoder, datagrams: Sequence[bytes]) -> list[Sample]:
    """Return the samples of datagrams; wrong ones are left out, as a receiver does."""
    out = []
    for datagram in datagrams:
        with contextlib.suppress(BadDatagram):
            sample = decoder.decode(datagram)
            if sample is not None:
                out.append(sample)
    return out
