"""What tests of live sources share: recordings to send, and what comes out at the other end."""

from __future__ import annotations

import socket
from collections.abc import Sequence
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
