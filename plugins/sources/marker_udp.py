"""The source of labelled markers in binary datagrams; docs/sources/marker_udp.md describes them."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from pydantic import Field

from imitor import hookimpl
from imitor.kinds import Source
from imitor.live.body_options import AxesConfig
from imitor.live.markers import MarkerPerson
from imitor.live.parts import Parts
from imitor.live.sample import Decoder, Foreign, Malformed, Sample
from imitor.live.sender import Encoder, lacking
from imitor.live.source import LiveSource
from imitor.motion.marker_file import MarkerFile
from imitor.motion.marker_recording import MarkerOptions, learn_markers
from imitor.motion.marker_sets import choose_marker_set
from imitor.registry import Registry
from imitor.types import Array, HumanFrame

PORT: Final = 9770
MAGIC: Final = b"IMMK"
VERSION: Final = 1
HEADER: Final = struct.Struct("<4sBBBBIIdH")
"""Magic, version, kind, part, parts, CRC-32 of the labels, counter, time [s], number of markers."""
LABELS, POSITIONS = 0, 1
"""Kinds of datagram."""
MOST_BYTES: Final = 1400
MOST_MARKERS: Final = 1024
LONGEST_LABEL: Final = 64
REPEAT_S: Final = 1.0
"""How often the labels are told [s]."""
FARTHEST_M: Final = 1000.0
"""A marker beyond this is lost [m]."""
_POINT: Final = np.dtype("<f4")


class MarkerUdpConfig(AxesConfig):
    """Options of the source of markers."""

    port: int = Field(PORT, ge=0, le=65535, description="Port to listen at; 0 takes a free one [-].")
    marker_set: str = Field(
        "auto", description="Marker set: auto, a card's name or the path of a card's .yaml file [-]."
    )
    subject: str = Field(
        "", description="The subject to take where several are sent, by the prefix of its labels [-]."
    )


@dataclass(frozen=True, slots=True)
class Told:
    """The labels, the same object as long as they do not change, and the markers, shape (M, 3) [m]; NaN where lost."""

    labels: tuple[str, ...]
    position: Array


def checksum(labels: Sequence[str]) -> int:
    """Return the CRC-32 of labels, each followed by a zero byte."""
    return zlib.crc32(_joined(labels))


def _joined(labels: Sequence[str]) -> bytes:
    return b"".join(label.encode() + b"\0" for label in labels)


class MarkerDecoder:
    """Reads labels and positions; positions count only with the labels that they were sent for."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the labels and parts of instants."""
        self._labels: tuple[str, ...] = ()
        self._checksum = -1
        self._described: Parts[tuple[int, int], bytes] = Parts(2)
        self._placed: Parts[tuple[int, int], bytes] = Parts(4)

    def decode(self, datagram: bytes) -> Sample | None:
        """Return the instant that a datagram completes.

        Raises:
            Foreign: It is of another protocol or version.
            Malformed: Its length does not fit its header, or its labels not their checksum.
        """
        if datagram[:4] != MAGIC or len(datagram) < 5 or datagram[4] != VERSION:
            raise Foreign
        if len(datagram) < HEADER.size or len(datagram) > MOST_BYTES:
            raise Malformed
        _, _, kind, part, parts, crc, counter, time_s, markers = HEADER.unpack_from(datagram)
        if not 0 < markers <= MOST_MARKERS or math.isinf(time_s):
            raise Malformed
        payload = datagram[HEADER.size :]
        if kind == LABELS:
            self._describe(crc, part, parts, markers, payload)
            return None
        if kind != POSITIONS or len(payload) % 12:
            raise Malformed
        if crc != self._checksum:
            return None
        whole = self._placed.add((crc, counter), part, parts, payload)
        if whole is None:
            return None
        payload = b"".join(whole)
        if len(payload) != 12 * len(self._labels):
            raise Malformed
        with np.errstate(invalid="ignore"):  # a NaN of whatever kind is a lost marker
            position = np.frombuffer(payload, _POINT).reshape(-1, 3).astype(np.float64)
        lost = ~(np.abs(position) < FARTHEST_M).all(axis=1)
        position[lost] = np.nan
        return Sample(counter, time_s, Told(self._labels, position))

    def _describe(self, crc: int, part: int, parts: int, markers: int, payload: bytes) -> None:
        whole = self._described.add((crc, markers), part, parts, payload)
        if whole is None or crc == self._checksum:
            return
        text = b"".join(whole)
        words = text.split(b"\0")
        if zlib.crc32(text) != crc or len(words) != markers + 1 or words[-1]:
            raise Malformed
        if not all(0 < len(w) <= LONGEST_LABEL for w in words[:-1]):
            raise Malformed
        self._labels, self._checksum = tuple(w.decode() for w in words[:-1]), crc
        self._placed.clear()


class MarkerEncoder:
    """Tells the labels at first and every second, and the markers of every frame."""

    def __init__(self, labels: Sequence[str]) -> None:
        self._labels, self._crc = tuple(labels), checksum(labels)
        self._next_s = -math.inf

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return the datagrams of a frame."""
        out = []
        if frame.time_s >= self._next_s:
            self._next_s = frame.time_s + REPEAT_S
            out += self._cut(LABELS, _joined(self._labels), MOST_BYTES - HEADER.size, counter, frame.time_s)
        marker = np.full((len(self._labels), 3), np.nan) if frame.marker is None else frame.marker
        room = (MOST_BYTES - HEADER.size) // 12 * 12
        out += self._cut(POSITIONS, marker.astype(_POINT).tobytes(), room, counter, frame.time_s)
        return out

    def _cut(self, kind: int, payload: bytes, room: int, counter: int, time_s: float) -> list[bytes]:
        pieces = [payload[i : i + room] for i in range(0, len(payload), room)]
        n, m, count = len(pieces), len(self._labels), counter & 0xFFFFFFFF
        return [
            HEADER.pack(MAGIC, VERSION, kind, i, n, self._crc, count, time_s, m) + piece
            for i, piece in enumerate(pieces)
        ]


class MarkerUdp(LiveSource[MarkerUdpConfig]):
    """Receives labelled optical markers over UDP, with joint centres by published regressions."""

    name = "marker_udp"
    gives: ClassVar[frozenset[str]] = frozenset({"markers"})

    def decoder(self) -> Decoder:
        """Return a new decoder."""
        return MarkerDecoder()

    def learn(self, samples: Sequence[Sample]) -> None:
        """Find marker set, lengths and floor, as of a recording.

        Raises:
            SourceError: No marker set fits, or there is no body.
        """
        c = self.config
        labels: tuple[str, ...] = samples[-1].body.labels
        position = np.array([s.body.position for s in samples if s.body.labels == labels])
        cards = Registry().cards("markersets")
        fit = choose_marker_set(self.name, labels, c.marker_set, c.subject, cards)
        file = MarkerFile(labels, position, self.rate_hz, unit="m")
        options = MarkerOptions(
            up=c.up, floor=c.recorded_floor, height_m=c.height_m, mass_kg=c.mass_kg, sex=c.sex
        )
        self._person = MarkerPerson(labels, fit, learn_markers(self.name, file, fit, options), position)
        self.skeleton = self._person.skeleton

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        """Return the frame of one instant."""
        told: Told = sample.body
        return self._person.frame(time_s, told.labels, told.position)

    def reset(self) -> None:
        """Forget how the elbows were last bent."""
        if hasattr(self, "_person"):
            self._person.reset()

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        """Return what sends a recording with markers.

        Raises:
            ImitorError: It has none.
        """
        labels = source.skeleton.marker_names
        if not labels:
            remedy = "c3d and trc files have some, and the performer with --set source.markers=41"
            raise lacking(cls.name, source, "markers", remedy)
        return MarkerEncoder(labels)


@hookimpl
def imitor_components() -> list[type[MarkerUdp]]:
    """Return the components of this module."""
    return [MarkerUdp]
