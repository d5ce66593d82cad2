"""Markers over UDP: what arrives is what a recording of the same person gives, and nothing wrong does harm."""

from __future__ import annotations

import socket
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from captured_people import perform
from imitor import testing
from imitor.errors import ImitorError
from imitor.live.receiver import NO_USE
from imitor.live.sample import Foreign, Malformed, Sample
from imitor.live.stream import Network
from imitor.motion.marker_recording import MarkerOptions, make_marker_recording
from imitor.motion.marker_sets import choose_marker_set
from imitor.plugins.sources.marker_udp import (
    HEADER,
    LABELS,
    MOST_BYTES,
    POSITIONS,
    MarkerDecoder,
    MarkerEncoder,
    MarkerUdp,
    MarkerUdpConfig,
)
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.registry import Registry
from imitor.testing.live import Played, encoded
from imitor.types import Array, HumanFrame
from known import known
from live_people import decode_all, heard

NAMES = ("LASI", "RASI")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "sources" / "marker_udp.md"


@pytest.fixture
def shown() -> str:
    """The code on the page."""
    return PAGE.read_text().split("```python\n")[1].split("```")[0]


def frame(position: Array, time_s: float = 0.0) -> HumanFrame:
    out = testing.make_frames(n=1)[0]
    valid = np.asarray(np.isfinite(position).all(axis=1))
    return HumanFrame(time_s, out.position, out.valid, marker=position, marker_valid=valid)


def datagrams(n: int = 3, names: Sequence[str] = NAMES, rate_hz: float = 100.0) -> list[list[bytes]]:
    encoder = MarkerEncoder(names)
    rng = np.random.default_rng(0)
    return [list(encoder.encode(frame(rng.normal(size=(len(names), 3)), i / rate_hz), i)) for i in range(n)]


def head(kind: int, part: int = 0, parts: int = 1, *, labels: bytes, counter: int = 0, n: int = 2) -> bytes:
    return HEADER.pack(b"IMMK", 1, kind, part, parts, zlib.crc32(labels), counter, 0.25, n)


# ---------------------------------------------------------------- the format


def test_the_bytes_are_those_of_the_page() -> None:
    encoder = MarkerEncoder(NAMES)
    position = np.array([[1.0, -2.0, 0.5], [np.nan] * 3])
    labels, told = encoder.encode(frame(position, 0.25), 7)
    crc = zlib.crc32(b"LASI\0RASI\0")
    start = b"IMMK" + bytes([1, 0, 0, 1]) + struct.pack("<IIdH", crc, 7, 0.25, 2)
    assert len(start) == HEADER.size == 26
    assert labels == start + b"LASI\0RASI\0"
    assert told[:6] == b"IMMK" + bytes([1, 1]) and told[6:26] == start[6:]
    assert told[26:38] == bytes.fromhex("0000803f000000c00000003f")
    assert np.isnan(struct.unpack("<3f", told[38:])).all() and len(told) == 50


def test_it_comes_out_as_it_went_in() -> None:
    encoder, decoder = MarkerEncoder(NAMES), MarkerDecoder()
    position = np.array([[1.0, -2.0, 0.5], [np.nan] * 3])
    labels, told = encoder.encode(frame(position, 0.25), 7)
    assert decoder.decode(labels) is None
    sample = known(decoder.decode(told))
    assert (sample.counter, sample.time_s, sample.body.labels) == (7, 0.25, NAMES)
    np.testing.assert_array_equal(sample.body.position, position)


def test_labels_come_again_every_second() -> None:
    told = datagrams(350)
    assert [i for i, parts in enumerate(told) if len(parts) == 2] == [0, 100, 200, 300]


def test_many_markers_are_cut_into_datagrams_that_fit() -> None:
    names = [f"Somebody:marker number {i:03d}" for i in range(300)]
    told = datagrams(2, names)
    assert max(len(d) for parts in told for d in parts) <= MOST_BYTES
    assert [len(parts) for parts in told] == [6 + 3, 3]
    decoder = MarkerDecoder()
    assert [s.counter for s in decode_all(decoder, [d for parts in told for d in parts])] == [0, 1]
    decoder.reset()
    backwards = [d for parts in told for d in parts[::-1]]
    assert [s.counter for s in decode_all(decoder, [*told[0][:6], *backwards])] == [0, 1]


def test_positions_before_their_labels_are_of_no_use() -> None:
    (labels, first), (second,) = datagrams(2)
    decoder = MarkerDecoder()
    assert [decoder.decode(d) for d in (first, labels)] == [None, None]
    assert known(decoder.decode(second)).counter == 1


def test_positions_count_with_the_labels_that_they_were_sent_for() -> None:
    ours, theirs = datagrams(2), datagrams(2, ("RASI", "LASI", "C7"))
    decoder = MarkerDecoder()
    assert len(decode_all(decoder, ours[0])) == 1
    assert decoder.decode(theirs[1][0]) is None
    assert known(decode_all(decoder, theirs[0])[0]).body.labels == ("RASI", "LASI", "C7")
    assert decoder.decode(ours[1][0]) is None


def test_the_sender_of_the_page_sends(shown: str) -> None:
    frames = [[(0.1, 0.2, 0.3), (i, float("nan"), 0.0)] for i in range(3)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(5.0)
        assert shown.count("9770") == 1
        code = {"names": NAMES, "frames": frames}
        exec(shown.replace("9770", str(sock.getsockname()[1])), code)
        code["sock"].close()  # type: ignore[attr-defined]
        told = [sock.recv(2000) for _ in range(4)]
    samples = decode_all(MarkerDecoder(), told)
    assert [s.counter for s in samples] == [0, 1, 2]
    np.testing.assert_allclose(samples[2].body.position, [[0.1, 0.2, 0.3], [np.nan] * 3], atol=1e-7)


# ---------------------------------------------------------------- what is wrong

TEXT = b"LASI\0RASI\0"


@pytest.mark.parametrize(
    ("datagram", "error"),
    [
        (b"", Foreign),
        (b"MXTP02" + bytes(60), Foreign),
        (b"IMMK\x02" + bytes(60), Foreign),
        (b"IMMK\x01", Malformed),
        (head(POSITIONS, labels=TEXT)[:-1], Malformed),
        (head(POSITIONS, labels=TEXT), Malformed),
        (head(POSITIONS, labels=TEXT) + bytes(23), Malformed),
        (head(POSITIONS, labels=TEXT) + bytes(36), Malformed),
        (head(POSITIONS, labels=TEXT) + bytes(1401), Malformed),
        (head(2, labels=TEXT) + bytes(24), Malformed),
        (head(POSITIONS, 1, 1, labels=TEXT) + bytes(24), Malformed),
        (head(POSITIONS, 0, 0, labels=TEXT) + bytes(24), Malformed),
        (head(POSITIONS, labels=TEXT, n=0) + bytes(24), Malformed),
        (head(POSITIONS, labels=TEXT, n=60000) + bytes(24), Malformed),
        (head(LABELS, labels=b"other") + TEXT, Malformed),
        (head(LABELS, labels=b"A\0B") + b"A\0B", Malformed),
        (head(LABELS, labels=b"A\0\0") + b"A\0\0", Malformed),
        (head(LABELS, labels=b"A\0B\0C\0") + b"A\0B\0C\0", Malformed),
        (head(LABELS, labels=bytes([65] * 65) + b"\0B\0") + bytes([65] * 65) + b"\0B\0", Malformed),
    ],
)
def test_wrong_datagrams_are_told_apart(datagram: bytes, error: type[Exception]) -> None:
    decoder = MarkerDecoder()
    decoder.decode(head(LABELS, labels=TEXT) + TEXT)
    with pytest.raises(error):
        decoder.decode(datagram)
    assert known(decoder.decode(head(POSITIONS, labels=TEXT) + bytes(24))).body.labels == NAMES


def test_labels_that_are_no_text_are_refused() -> None:
    text = b"\xff\xfe\0B\0"
    with pytest.raises(NO_USE):
        MarkerDecoder().decode(head(LABELS, labels=text) + text)


def test_a_marker_at_the_end_of_the_world_is_lost() -> None:
    decoder = MarkerDecoder()
    decoder.decode(head(LABELS, labels=TEXT) + TEXT)
    points = struct.pack("<6f", 0.1, 0.2, 0.3, 0.1, 3e38, 0.3)
    seen = known(decoder.decode(head(POSITIONS, labels=TEXT) + points)).body.position
    np.testing.assert_array_equal(np.isfinite(seen).all(axis=1), [True, False])


def test_parts_that_never_complete_are_given_up() -> None:
    decoder = MarkerDecoder()
    decoder.decode(head(LABELS, labels=TEXT) + TEXT)
    for counter in range(100000):
        assert decoder.decode(head(POSITIONS, 0, 2, labels=TEXT, counter=counter) + bytes(12)) is None
    assert len(decoder._placed._open) <= 4


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_mutations_do_no_harm(data: Any) -> None:
    told = [d for parts in datagrams(4) for d in parts]
    decoder = MarkerDecoder()
    for datagram in told:
        changed = bytearray(datagram)
        for _ in range(data.draw(st.integers(0, 4))):
            changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
        cut = bytes(changed[: data.draw(st.integers(0, len(changed)))])
        for wrong in (bytes(changed), cut, cut + datagram):
            try:
                sample = decoder.decode(wrong)
            except NO_USE:
                continue
            assert sample is None or sample.body.position.shape == (len(sample.body.labels), 3)


# ---------------------------------------------------------------- the person


def samples_of(scenario: str, rate_hz: float = 60.0) -> tuple[Performer, list[Sample]]:
    performer = Performer(PerformerConfig(scenario=scenario, markers="41", rate_hz=rate_hz))
    performer.start()
    told = [d for parts in encoded(MarkerUdp, performer) for d in parts]
    return performer, decode_all(MarkerDecoder(), told)


def learned(samples: Sequence[Sample], rate_hz: float = 60.0, **options: Any) -> MarkerUdp:
    source = MarkerUdp(MarkerUdpConfig(**options))
    source.rate_hz = rate_hz
    source.learn(samples)
    return source


@pytest.mark.parametrize("scenario", ["walk", "squat"])
def test_the_person_is_that_of_a_recording(scenario: str) -> None:
    person = perform(scenario)
    cards = Registry(entry_points=False).cards("markersets")
    fit = choose_marker_set("a.c3d", person.file.labels, "auto", "", cards)
    clip = make_marker_recording("a.c3d", person.file, fit, MarkerOptions())
    _, samples = samples_of(scenario)
    source = learned(samples)
    assert source.skeleton.marker_names == clip.skeleton.marker_names
    assert source.skeleton.marker_segments == clip.skeleton.marker_segments
    np.testing.assert_allclose(source.skeleton.rest_position, clip.skeleton.rest_position, atol=1e-5)
    frames = [source.human(s, 0.0) for s in samples]
    # The wire has single precision.
    np.testing.assert_allclose([f.position for f in frames], clip.position, atol=2e-6)
    np.testing.assert_allclose([known(f.marker) for f in frames], known(clip.marker), atol=1e-6)


def test_a_second_is_enough_to_learn() -> None:
    performer, samples = samples_of("two_steps_and_reach")
    source = learned(samples[:60])
    truth = performer.truth.position
    position = np.array([source.human(s, 0.0).position for s in samples])
    error = np.linalg.norm(position - truth, axis=-1)
    assert np.nanmax(error) < 0.035
    assert source.skeleton.height_m == pytest.approx(1.75, abs=0.03)


def test_labels_in_another_order_are_the_same_markers() -> None:
    _, samples = samples_of("wave", 30.0)
    source = learned(samples, 30.0)
    told = samples[20].body
    before = source.human(samples[20], 0.0)
    order = np.random.default_rng(1).permutation(len(told.labels))
    shuffled = type(told)(tuple(told.labels[i] for i in order), told.position[order])
    after = source.human(Sample(0, 0.0, shuffled), 0.0)
    np.testing.assert_array_equal(after.position, before.position)
    np.testing.assert_array_equal(after.marker, before.marker)
    fewer = type(told)(told.labels[:-1], told.position[:-1])
    lost = known(source.human(Sample(0, 0.0, fewer), 0.0).marker_valid)
    assert lost.tolist() == [True] * 40 + [False]


def test_y_may_point_up() -> None:
    _, samples = samples_of("wave", 30.0)
    turned = [
        Sample(s.counter, s.time_s, type(s.body)(s.body.labels, s.body.position[:, [1, 2, 0]]))
        for s in samples
    ]
    one, other = learned(samples, 30.0), learned(turned, 30.0, up="y")
    np.testing.assert_allclose(
        other.human(turned[9], 0.0).position, one.human(samples[9], 0.0).position, atol=1e-9
    )


def test_markers_that_no_set_knows_are_refused() -> None:
    told = [d for parts in datagrams(10) for d in parts]
    with pytest.raises(ImitorError, match=r"^marker_udp: no marker set fits"):
        learned(decode_all(MarkerDecoder(), told))


def test_a_recording_without_markers_cannot_be_sent() -> None:
    performer = Performer(PerformerConfig())
    performer.start()
    with pytest.raises(ImitorError) as caught:
        MarkerUdp.encoder(performer)
    assert str(caught.value) == (
        "'marker_udp' sends markers, and this recording (performer) has none; c3d and trc files have some, and the "
        "performer with --set source.markers=41"
    )


def test_it_keeps_the_contract_of_a_live_source() -> None:
    testing.check_component(MarkerUdp)


@pytest.mark.parametrize("network", [None, Network(loss=0.05, reorder=0.05, duplicate=0.05, jitter_s=0.005)])
def test_over_a_socket(network: Network | None) -> None:
    with heard(MarkerUdp, Played("wave", rate_hz=100.0), network) as source:
        assert source.rate_hz == 100.0
        counts: list[int] = []
        while len(counts) < 60:
            arrival = known(source.take(5.0))
            assert source.human(arrival.sample, 0.0).valid.sum() > 20
            counts.append(arrival.sample.counter)
        assert counts == sorted(set(counts))
    reception = source.reception
    assert reception.malformed == reception.foreign == 0
    assert (reception.duplicated > 0) == (reception.reordered > 0) == (network is not None)
