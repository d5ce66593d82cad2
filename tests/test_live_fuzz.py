"""Every live source takes 100 000 mutated datagrams without an exception, without growing, and without a hang."""

from __future__ import annotations

import gc
import itertools
import socket
import tracemalloc
from typing import Any

import pytest

from imitor.live.receiver import Receiver
from imitor.live.source import LiveSource
from imitor.registry import Registry
from imitor.testing.live import Played, decoded, encoded, mutations

DATAGRAMS = 100_000
REGISTRY = Registry(entry_points=False)
SOURCES: list[type[LiveSource[Any]]] = [
    r.component for r in REGISTRY if r.kind == "source" and issubclass(r.component, LiveSource)
]


def test_all_live_sources_are_here() -> None:
    names = {cls.name for cls in SOURCES}
    assert names == {"art_udp", "joints_udp", "marker_udp", "optitrack", "vmc_osc", "xsens_udp"}


@pytest.mark.slow
@pytest.mark.parametrize("cls", SOURCES, ids=[c.name for c in SOURCES])
def test_it_takes_whatever_comes(cls: type[LiveSource[Any]]) -> None:
    played = Played()
    played.start()
    told = encoded(cls, played)
    source = cls(cls.config_type())
    source.rate_hz = played.rate_hz
    source.learn(decoded(source, source.decoder(), told)[:30])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        receiver = Receiver(sock, source.decoder())
        source.receiver = receiver
        wrong = itertools.islice(
            itertools.chain.from_iterable(mutations(told, seed, 20_000) for seed in itertools.count()),
            DATAGRAMS,
        )
        tracemalloc.start(1)
        try:
            warm = 0
            for i, datagram in enumerate(wrong):
                receiver.take(datagram, "127.0.0.1", 0.001 * i)
                arrival = receiver.box.take()
                if arrival is not None:
                    source.person(arrival, 0.001 * i)
                if i == DATAGRAMS // 4:
                    gc.collect()
                    warm = tracemalloc.get_traced_memory()[0]
            gc.collect()
            grown = tracemalloc.get_traced_memory()[0] - warm
        finally:
            tracemalloc.stop()
        reception = receiver.reception
        receiver.close()
    assert reception.datagrams == DATAGRAMS
    assert reception.malformed + reception.foreign > DATAGRAMS // 4
    assert grown < 1_000_000
