"""Checks of a live source, without a socket: what is sent is what arrives, and no datagram does any harm."""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from imitor.errors import ImitorError
from imitor.kinds import Config, Source
from imitor.live.receiver import NO_USE
from imitor.live.sample import Decoder, Sample
from imitor.live.source import LiveSource
from imitor.testing.expect import Snapshot, attempt, build, check_same, expect, fail
from imitor.testing.fixtures import make_frames, make_skeleton
from imitor.testing.frames import ARRAYS, check_frame, check_skeleton, given_words, snapshot
from imitor.types import ROLES, Array, HumanFrame

RATE_HZ: Final = 30.0
LARGEST_DATAGRAM: Final = 65507
"""What fits into one datagram of IPv4 [bytes]."""
MOST_MEMORY: Final = 16_000_000
"""What decoding a wrong datagram may take [bytes]."""
USUAL_M: Final = 0.05
WORST_M: Final = 0.20
"""How far points may come out from where they were: in the median, and in the mean of any one role [m]."""


class Played(Source[Config]):
    """Plays an authored person with everything that a frame can hold, for encoders."""

    name = "played"
    gives = frozenset({"support", "com", "orientation", "markers", "targets"})

    def __init__(
        self, scenario: str = "step_forward", *, rate_hz: float = RATE_HZ, loss: float = 0.0
    ) -> None:
        super().__init__(Config())
        self._scenario, self._loss, self.rate_hz = scenario, loss, rate_hz

    def start(self) -> None:
        """Perform."""
        self.skeleton = make_skeleton()
        self._frames = make_frames(self._scenario, rate_hz=self.rate_hz, loss=self._loss)
        self.n_frames = len(self._frames)

    def frames(self) -> Iterator[HumanFrame]:
        """Yield the frames."""
        return iter(self._frames)


def check_live_source(cls: type[LiveSource[Any]], config: Mapping[str, Any] | None = None) -> None:
    """Check a live source by what its encoder makes of an authored person.

    A source without an encoder cannot be checked like this and passes.
    """
    if getattr(cls.encoder, "__func__", None) is getattr(LiveSource.encoder, "__func__", 0):
        return
    played = Played()
    played.start()
    frames = list(played.frames())
    told = encoded(cls, played)
    source = build(cls, config)
    samples = decoded(source, source.decoder(), told)
    _learn(source, samples, played.rate_hz)
    first = _frames(source, samples)
    _check_agreement(source, frames, samples, first)
    source.reset()
    check_same(cls, first, _frames(source, samples), "the same samples again after reset()")
    lossy = Played(loss=0.1)
    lossy.start()
    _frames(source, decoded(source, source.decoder(), encoded(cls, lossy)))
    _check_harmless(source, told, len(samples))
    source.close()
    source.close()


def encoded(cls: type[LiveSource[Any]], played: Source[Any]) -> list[list[bytes]]:
    """Return the datagrams of every instant of a started source."""
    encoder = attempt(cls, "encoder()", lambda: cls.encoder(played))
    out = []
    for i, frame in enumerate(played.frames()):
        before = snapshot(frame)
        datagrams = list(attempt(cls, f"encode() of frame {i}", lambda f=frame, i=i: encoder.encode(f, i)))  # type: ignore[misc]
        check_same(cls, [before], [snapshot(frame)], f"encode() of frame {i}, before and after")
        for datagram in datagrams:
            expect(isinstance(datagram, bytes), cls, f"frame {i}: a datagram is of {type(datagram).__name__}")
            expect(
                0 < len(datagram) <= LARGEST_DATAGRAM, cls, f"frame {i}: a datagram has {len(datagram)} bytes"
            )
        out.append(datagrams)
    return out


def decoded(source: LiveSource[Any], decoder: Decoder, told: Sequence[Sequence[bytes]]) -> list[Sample]:
    """Return the samples of datagrams that arrive in order; one instant may be complete when the next begins."""
    cls, out = type(source), []
    for i, datagrams in enumerate(told):
        for datagram in datagrams:
            sample = attempt(cls, f"decode() of frame {i}", lambda d=datagram: decoder.decode(d))  # type: ignore[misc]
            if sample is not None:
                out.append(sample)
    n = len(told)
    expect(n - 1 <= len(out) <= n, cls, f"{n} instants were sent, and {len(out)} came out of the decoder")
    counts = np.array([s.counter for s in out])
    expect((np.diff(counts) == 1).all(), cls, f"the samples count {counts[:5]}..., not one by one")
    times = np.array([s.time_s for s in out])
    expect(
        np.isnan(times).all() or (np.diff(times) > 0).all(), cls, "the time of the samples does not increase"
    )
    return out


def _learn(source: LiveSource[Any], samples: Sequence[Sample], rate_hz: float) -> None:
    source.rate_hz = rate_hz
    seen = samples[: max(3, round(source.config.learn_s * rate_hz))]
    attempt(type(source), "learn()", lambda: source.learn(seen))
    check_skeleton(type(source), source.skeleton)


def _frames(source: LiveSource[Any], samples: Sequence[Sample]) -> list[Snapshot]:
    cls, out = type(source), []
    for i, sample in enumerate(samples):
        which, time_s = f"the frame of sample {i}", i / 7.0
        frame = attempt(cls, which, lambda s=sample, t=time_s: source.human(s, t))  # type: ignore[misc]
        check_frame(cls, frame, source.skeleton, which)
        expect(
            frame.time_s == time_s,
            cls,
            f"{which} bears the time {frame.time_s} s, not the {time_s} s it is to",
        )
        for name in ARRAYS:
            array = getattr(frame, name)
            if array is not None and array.flags.writeable:
                fail(cls, f"{which}: {name} can be written; pass it through imitor.types.read_only")
        extra = given_words(frame) - cls.gives
        expect(not extra, cls, f"{which} holds {', '.join(sorted(extra))}, which `gives` does not name")
        out.append(snapshot(frame))
    return out


def _check_agreement(
    source: LiveSource[Any], frames: Sequence[HumanFrame], samples: Sequence[Sample], seen: Sequence[Snapshot]
) -> None:
    """Compare role positions with those sent, but for one shift of the whole world."""
    cls = type(source)
    true: Array = np.array([f.position for f in frames[: len(seen)]])
    found: Array = np.array([s["position"] for s in seen])
    gap = found - true
    gap -= np.nanmedian(gap, axis=(0, 1))
    distance = np.linalg.norm(gap, axis=-1)
    usual = float(np.nanmedian(distance))
    expect(usual < USUAL_M, cls, f"the person comes out {usual:.3f} m from where it was, in the median")
    for i in np.flatnonzero(np.isfinite(distance).any(axis=0)):
        worst = float(np.nanmean(distance[:, i]))
        expect(worst < WORST_M, cls, f"{ROLES[i]} comes out {worst:.3f} m from where it was, in the mean")


def mutations(told: Sequence[Sequence[bytes]], seed: int = 0, rounds: int = 200) -> Iterator[bytes]:
    """Yield datagrams that are wrong: cut, changed, doubled, of nothing and of noise."""
    chance = random.Random(seed)
    every = [datagram for datagrams in told for datagram in datagrams]
    longest = max(every, key=len)
    yield b""
    for n in (1, 4, 16, 64, 1400, LARGEST_DATAGRAM):
        yield bytes(n)
        yield b"\xff" * n
        yield chance.randbytes(n)
        yield longest[:4] + b"\xff" * (n - 4 if n > 4 else 0)
    for n in range(0, len(longest), max(1, len(longest) // 60)):
        yield longest[:n]
    for _ in range(rounds):
        datagram = bytearray(chance.choice(every))
        for _ in range(chance.choice((1, 1, 2, 8))):
            # Heads hold the lengths and counts: they are changed more often.
            where = chance.randrange(min(len(datagram), chance.choice((16, 64, len(datagram)))))
            datagram[where] = chance.choice((0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)))
        yield bytes(datagram)
        cut = chance.randrange(len(datagram))
        yield bytes(datagram[:cut]) + chance.choice(every)[cut // 2 :]


def _check_harmless(source: LiveSource[Any], told: Sequence[Sequence[bytes]], n: int) -> None:
    """Feed wrong datagrams among right ones: refused or survived, without much memory, and then forgotten."""
    cls, decoder = type(source), source.decoder()
    right = [d for datagrams in told for d in datagrams]
    tracing = tracemalloc.is_tracing()
    if not tracing:
        tracemalloc.start()
    try:
        for i, datagram in enumerate(mutations(told)):
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            sample = _refused_or(source, decoder, datagram, f"wrong datagram {i}")
            peak = tracemalloc.get_traced_memory()[1] - before
            expect(peak < MOST_MEMORY, cls, f"wrong datagram {i}, {datagram[:32]!r}..., takes {peak} bytes")
            if sample is not None:
                _survive(source, sample, f"wrong datagram {i}")
            _refused_or(source, decoder, right[i % len(right)], "a right datagram among wrong ones")
    finally:
        if not tracing:
            tracemalloc.stop()
    after = sum(
        _refused_or(source, decoder, d, "a right datagram after wrong ones") is not None for d in right
    )
    expect(after >= n // 2, cls, f"after wrong datagrams only {after} of {n} instants came through")
    decoder.reset()
    expect(len(decoded(source, decoder, told)) == n, cls, "after reset() the decoder is not as new")


def _refused_or(source: LiveSource[Any], decoder: Decoder, datagram: bytes, which: str) -> Sample | None:
    try:
        return decoder.decode(datagram)
    except NO_USE:
        return None
    except Exception as error:
        text = f"{which}, {datagram[:32]!r}...: {type(error).__name__}: {error}; raise Malformed or Foreign"
        raise AssertionError(f"source '{source.name}': {text}") from error


def _survive(source: LiveSource[Any], sample: Sample, which: str) -> None:
    try:
        frame = source.human(sample, 0.0)
    except ImitorError as error:
        fail(
            type(source),
            f"{which} is decoded, but human() refuses it: {error}; give a frame in which it is lost",
        )
    except Exception as error:
        raise AssertionError(
            f"source '{source.name}': {which} is decoded, and human() fails: {type(error).__name__}: {error}"
        ) from error
    check_frame(type(source), frame, source.skeleton, f"the frame of {which}")
