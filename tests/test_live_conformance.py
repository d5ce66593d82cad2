"""The kit's check of live sources passes a sound one, and sees each way of being wrong."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest

from imitor import HumanFrame, Source, Support, testing
from imitor.live.body_options import AxesConfig
from imitor.live.points import PointBody
from imitor.live.sample import Decoder, Foreign, Malformed, Sample
from imitor.live.sender import Encoder
from imitor.live.source import LiveConfig, LiveSource
from imitor.types import N_ROLES, ROLE_INDEX

HEAD = struct.Struct("<2sIdI")
SIZE = HEAD.size + 24 * N_ROLES


class Raw:
    """Encode all positions, one whole instant a datagram."""

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        return [HEAD.pack(b"RW", counter, frame.time_s, N_ROLES) + frame.position.tobytes()]


class RawDecoder:
    """Decode them."""

    def decode(self, datagram: bytes) -> Sample | None:
        if datagram[:2] != b"RW":
            raise Foreign
        if len(datagram) != SIZE:
            raise Malformed
        _, counter, time_s, n = HEAD.unpack_from(datagram)
        if n != N_ROLES:
            raise Malformed
        position = np.frombuffer(datagram, "<f8", offset=HEAD.size).reshape(-1, 3)
        with np.errstate(invalid="ignore"):
            position = np.where((np.abs(position) < 100.0).all(axis=1, keepdims=True), position, np.nan)
        return Sample(counter, time_s, position)

    def reset(self) -> None:
        """Nothing is kept."""


class RawUdp(LiveSource[AxesConfig]):
    """Receive them."""

    name = "raw_udp"
    decoder_type: ClassVar[Any] = RawDecoder

    def decoder(self) -> Decoder:
        made: Decoder = self.decoder_type()
        return made

    def learn(self, samples: Sequence[Sample]) -> None:
        self.body = PointBody(self.name, np.array([s.body for s in samples]), self.rate_hz, self.config)
        self.skeleton = self.body.skeleton

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        return self.body.frame(time_s, sample.body)

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        return Raw()


class TrustingDecoder(RawDecoder):
    """Fault."""

    def decode(self, datagram: bytes) -> Sample | None:
        if datagram[:2] == b"RW" and len(datagram) >= HEAD.size:
            room = np.zeros(HEAD.unpack_from(datagram)[3] % (1 << 24), dtype=np.float64)
            del room
        return super().decode(datagram)


class RaisingDecoder(RawDecoder):
    """Fault."""

    def decode(self, datagram: bytes) -> Sample | None:
        try:
            return super().decode(datagram)
        except Malformed:
            raise TypeError("bad") from None


class LosingDecoder(RawDecoder):
    """Fault."""

    def decode(self, datagram: bytes) -> Sample | None:
        sample = super().decode(datagram)
        return sample if sample is not None and sample.counter % 2 else None


class UncountingDecoder(RawDecoder):
    """Fault."""

    def decode(self, datagram: bytes) -> Sample | None:
        sample = super().decode(datagram)
        return None if sample is None else replace(sample, counter=0)


class OffendedDecoder(RawDecoder):
    """Fault."""

    def __init__(self) -> None:
        self.offended = False

    def decode(self, datagram: bytes) -> Sample | None:
        if self.offended:
            raise Malformed
        try:
            return super().decode(datagram)
        except Malformed:
            self.offended = True
            raise

    def reset(self) -> None:
        self.offended = False


class StubbornDecoder(RawDecoder):
    """Fault."""

    newest = -1

    def decode(self, datagram: bytes) -> Sample | None:
        sample = super().decode(datagram)
        if sample is not None and sample.counter < self.newest < 1000:
            return None
        if sample is not None:
            self.newest = sample.counter
        return sample


class TiredDecoder(RawDecoder):
    """Fault."""

    skip = 0

    def decode(self, datagram: bytes) -> Sample | None:
        sample = super().decode(datagram)
        if sample is not None and self.skip:
            self.skip -= 1
            return None
        return sample

    def reset(self) -> None:
        self.skip = 2


def decoding(decoder: type[RawDecoder]) -> Any:
    """Return a source with a decoder."""
    return type(decoder.__name__, (RawUdp,), {"decoder_type": decoder, "__doc__": "Receive."})


class WritableUdp(RawUdp):
    """Fault."""

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        frame = super().human(sample, time_s)
        frame.position = frame.position.copy()
        return frame


class WrongTimeUdp(RawUdp):
    """Fault."""

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        return super().human(sample, sample.time_s)


class MisplacingUdp(RawUdp):
    """Fault."""

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        told = sample.body.copy()
        told[ROLE_INDEX["left_hand"], 0] += 0.3
        return super().human(replace(sample, body=told), time_s)


class MirroringUdp(RawUdp):
    """Fault."""

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        return super().human(replace(sample, body=sample.body * (1.0, -1.0, 1.0)), time_s)


class RememberingUdp(RawUdp):
    """Fault."""

    shift = 0.0

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        self.shift += 1e-6
        return super().human(replace(sample, body=sample.body + self.shift), time_s)


class SecretUdp(RawUdp):
    """Fault."""

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        frame = super().human(sample, time_s)
        frame.support = Support(True, True)
        return frame


class FragileUdp(RawUdp):
    """Fault."""

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        if ((sample.body != 0.0) & (np.abs(sample.body) < 1e-200)).any():
            raise RuntimeError("too small")
        return super().human(sample, time_s)


class TextUdp(RawUdp):
    """Fault."""

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        class Text(Raw):
            def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
                return ["text"]  # type: ignore[list-item]

        return Text()


FAULTS = [
    (decoding(TrustingDecoder), "bytes"),
    (decoding(RaisingDecoder), "TypeError: bad; raise Malformed or Foreign"),
    (decoding(LosingDecoder), "instants were sent, and"),
    (decoding(UncountingDecoder), "the samples count [0 0 0 0 0]..., not one by one"),
    (decoding(OffendedDecoder), "after wrong datagrams only 0 of"),
    (decoding(StubbornDecoder), "after wrong datagrams only 49 of 196 instants came through"),
    (decoding(TiredDecoder), "instants were sent, and"),
    (WritableUdp, "position can be written"),
    (WrongTimeUdp, "not the 0.14285714285714285 s it is to"),
    (MisplacingUdp, "left_hand comes out 0.3"),
    (MirroringUdp, "m from where it was, in the median"),
    (RememberingUdp, "the same samples again after reset()"),
    (SecretUdp, "holds support, which `gives` does not name"),
    (FragileUdp, "human() fails: RuntimeError: too small"),
    (TextUdp, "a datagram is of str"),
]


def test_a_sound_source_passes() -> None:
    testing.check_component(RawUdp)


@pytest.mark.parametrize(("cls", "said"), FAULTS, ids=[cls.__name__ for cls, _ in FAULTS])
def test_a_fault_is_seen(cls: Any, said: str) -> None:
    with pytest.raises(AssertionError) as caught:
        testing.check_live_source(cls)
    assert said in str(caught.value)
    assert str(caught.value).startswith("source 'raw_udp': ")


def test_a_source_that_cannot_be_sent_is_not_checked() -> None:
    class Deaf(LiveSource[LiveConfig]):
        """Receive nothing."""

        name = "deaf"

    testing.check_live_source(Deaf)
