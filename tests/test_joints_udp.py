"""Joint positions as JSON over UDP: the format of the page, what is wrong, and the person that arrives."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from imitor import testing
from imitor.errors import ImitorError
from imitor.human.rotations import about_z
from imitor.live.receiver import NO_USE
from imitor.live.sample import Foreign, Malformed, Sample
from imitor.live.stream import Network
from imitor.motion.normalise import UP_AXES
from imitor.plugins.sources.joints_udp import JointsDecoder, JointsUdp, JointsUdpConfig
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.testing.live import Played, encoded
from imitor.types import ROLE_INDEX
from known import known
from live_people import decode_all, heard

EXAMPLE = (
    b'{"schema":"imitor.joints.1","counter":7,"time_s":0.25,'
    b'"joints":{"pelvis":[0.0,0.0,0.95],"left_hip":[0,0.09,0.93],"head":null,"nose":[1,2,3]},'
    b'"orientation_wxyz":{"pelvis":[0.7071,0,0,0.7071]},'
    b'"confidence":{"left_hip":0.3}}'
)


def decoder(**options: Any) -> JointsDecoder:
    source = JointsUdp(JointsUdpConfig(**options))
    found = source.decoder()
    assert isinstance(found, JointsDecoder)
    return found


def test_the_example_of_the_page() -> None:
    page = Path(__file__).resolve().parents[1] / "docs" / "sources" / "joints_udp.md"
    shown = page.read_text().split("```json\n")[1].split("```")[0]
    assert json.loads(shown)["joints"].items() <= json.loads(EXAMPLE)["joints"].items()
    assert decoder().decode(shown.encode()).counter == 7
    sample = decoder().decode(EXAMPLE)
    assert (sample.counter, sample.time_s) == (7, 0.25)
    position, orientation = sample.body.position, known(sample.body.orientation)
    assert np.flatnonzero(np.isfinite(position).all(axis=1)).tolist() == [ROLE_INDEX["pelvis"]]
    np.testing.assert_array_equal(position[ROLE_INDEX["pelvis"]], [0.0, 0.0, 0.95])
    np.testing.assert_allclose(
        orientation[ROLE_INDEX["pelvis"]], about_z(np.array([np.pi / 2]))[0], atol=1e-12
    )
    assert np.isnan(orientation[ROLE_INDEX["left_hip"]]).all()


def test_doubtful_joints_are_lost_as_far_as_one_wants() -> None:
    hip = ROLE_INDEX["left_hip"]
    assert np.isnan(decoder().decode(EXAMPLE).body.position[hip]).all()
    np.testing.assert_array_equal(
        decoder(min_confidence=0.2).decode(EXAMPLE).body.position[hip], [0, 0.09, 0.93]
    )


def test_the_sender_may_have_its_own_names() -> None:
    told = decoder(names={"nose": "head_top"}).decode(EXAMPLE).body.position
    np.testing.assert_array_equal(told[ROLE_INDEX["head_top"]], [1, 2, 3])
    with pytest.raises(ValidationError, match=r"there is no role 'headtop'; did you mean 'head_top'\?"):
        JointsUdpConfig(names={"nose": "headtop"})


def message(**changes: Any) -> bytes:
    return json.dumps(json.loads(EXAMPLE) | changes).encode()


@pytest.mark.parametrize(
    ("datagram", "error"),
    [
        (b"", Foreign),
        (b"[]", Foreign),
        (b"MXTP02" + bytes(60), Foreign),
        (message(schema="imitor.joints.2"), Foreign),
        (message(schema=None), Foreign),
        (b'{"a":1}', Foreign),
        (b"{" + b" " * 20000 + b"}", Foreign),
        (b"{", Malformed),
        (EXAMPLE[:-1], Malformed),
        (b"{\xff}", Malformed),
        (b'{"a":' + b"[" * 10000, Malformed),
        (EXAMPLE.replace(b"0.95", b"NaN"), Malformed),
        (EXAMPLE.replace(b"0.95", b"1e999"), Malformed),
        (EXAMPLE.replace(b"0.95", b"9" * 5000), Malformed),
        (EXAMPLE.replace(b"0.95", b"true"), Malformed),
        (EXAMPLE.replace(b"0.95", b'"1"'), Malformed),
        (message(counter=-1), Malformed),
        (message(counter=1 << 64), Malformed),
        (message(counter=1.5), Malformed),
        (message(counter=True), Malformed),
        (message(time_s="now"), Malformed),
        (message(joints=[1]), Malformed),
        (message(joints={"pelvis": [1, 2]}), Malformed),
        (message(joints={f"j{i}": None for i in range(300)}), Malformed),
        (message(confidence={"pelvis": None}), Malformed),
        (message(orientation_wxyz={"pelvis": [1, 0, 0]}), Malformed),
    ],
)
def test_wrong_datagrams_are_told_apart(datagram: bytes, error: type[Exception]) -> None:
    with pytest.raises(error):
        decoder().decode(datagram)


def test_a_quaternion_that_is_none_is_not_known() -> None:
    for none in ([0, 0, 0, 0], None):
        told = decoder().decode(message(orientation_wxyz={"pelvis": none}))
        assert np.isnan(known(told.body.orientation)).all()


@settings(deadline=None, max_examples=100)
@given(st.data())
def test_mutations_do_no_harm(data: Any) -> None:
    changed = bytearray(EXAMPLE)
    for _ in range(data.draw(st.integers(0, 5))):
        at = data.draw(st.integers(0, len(changed) - 1))
        changed[at : at + 1] = data.draw(
            st.sampled_from([b"", b"[", b"]", b"{", b"}", b'"', b",", b"9", b"-", b"e", b"null", b"\xff"])
        )
    for wrong in (bytes(changed), bytes(changed[: data.draw(st.integers(0, len(changed)))])):
        try:
            sample = decoder().decode(wrong)
        except NO_USE:
            continue
        assert sample.body.position.shape == (len(ROLE_INDEX), 3)


def test_a_quaternion_is_of_length_one() -> None:
    told = decoder().decode(message(orientation_wxyz={"pelvis": [2, 0, 0, 0], "head": [0.999, 0, 0, 0]}))
    R = known(told.body.orientation)
    assert np.isnan(R[ROLE_INDEX["pelvis"]]).all()
    np.testing.assert_allclose(R[ROLE_INDEX["head"]], np.eye(3), atol=1e-15)


# ---------------------------------------------------------------- the person


def samples_of(scenario: str, rate_hz: float = 60.0) -> tuple[Performer, list[Sample]]:
    performer = Performer(PerformerConfig(scenario=scenario, rate_hz=rate_hz))
    performer.start()
    told = [d for parts in encoded(JointsUdp, performer) for d in parts]
    return performer, decode_all(decoder(), told)


def learned(samples: Sequence[Sample], rate_hz: float = 60.0, **options: Any) -> JointsUdp:
    source = JointsUdp(JointsUdpConfig(**options))
    source.rate_hz = rate_hz
    source.learn(samples)
    return source


def test_the_person_is_the_one_that_was_sent() -> None:
    performer, samples = samples_of("walk")
    source = learned(samples[:60])
    assert source.skeleton.height_m == pytest.approx(1.75, abs=0.05)
    for s in samples[::7]:
        frame = source.human(s, 0.0)
        np.testing.assert_allclose(frame.position, performer.truth.position[s.counter], atol=1e-5)
        np.testing.assert_allclose(
            known(frame.orientation), performer.truth.orientation[s.counter], atol=3e-6
        )


@pytest.mark.parametrize("up", ["x", "y", "-y", "-z"])
def test_any_axis_may_point_up(up: str) -> None:
    performer, samples = samples_of("squat")
    W = np.array(UP_AXES[up], dtype=float)
    turned = [
        Sample(s.counter, s.time_s, type(s.body)(s.body.position @ W, W.T @ s.body.orientation @ W))
        for s in samples
    ]
    source = learned(turned, up=up)
    frame = source.human(turned[50], 0.0)
    np.testing.assert_allclose(frame.position, performer.truth.position[50], atol=1e-5)
    np.testing.assert_allclose(known(frame.orientation), performer.truth.orientation[50], atol=3e-6)


def test_the_pelvis_follows_from_the_hips() -> None:
    performer, samples = samples_of("squat")
    for s in samples:
        s.body.position[ROLE_INDEX["pelvis"]] = np.nan
    source = learned(samples)
    assert source.skeleton.has("pelvis")
    frame = source.human(samples[30], 0.0)
    np.testing.assert_allclose(
        frame.position[ROLE_INDEX["pelvis"]], performer.truth.position[30, ROLE_INDEX["pelvis"]], atol=1e-5
    )


def test_a_joint_that_was_not_seen_at_first_is_none_of_the_body() -> None:
    _, samples = samples_of("squat")
    head = ROLE_INDEX["head"]
    shown = samples[5].body.position.copy()
    for s in samples:
        s.body.position[head] = np.nan
    source = learned(samples)
    frame = source.human(Sample(0, 0.0, type(samples[5].body)(shown, None)), 0.0)
    assert not source.skeleton.has("head") and not frame.valid[head] and np.isnan(frame.position[head]).all()


def test_what_is_no_body_is_refused() -> None:
    _, samples = samples_of("squat")
    swapped = [
        Sample(s.counter, s.time_s, type(s.body)(s.body.position * (1.0, -1.0, 1.0), None)) for s in samples
    ]
    with pytest.raises(ImitorError, match=r"^left and right are swapped"):
        learned(swapped)
    far = [Sample(s.counter, s.time_s, type(s.body)(100 * s.body.position, None)) for s in samples]
    with pytest.raises(
        ImitorError, match=r"^the body would be 17\d m tall: positions are to be sent in metres"
    ):
        learned(far)
    for s in samples:
        s.body.position[ROLE_INDEX["left_shoulder"]] = np.nan
    with pytest.raises(
        ImitorError, match=r"^left_shoulder: not seen in the first 1 s; a body needs hips and shoul"
    ):
        learned(samples)


def test_it_keeps_the_contract_of_a_live_source() -> None:
    testing.check_component(JointsUdp)


@pytest.mark.parametrize("network", [None, Network(loss=0.05, reorder=0.05, duplicate=0.05, jitter_s=0.005)])
def test_over_a_socket(network: Network | None) -> None:
    with heard(JointsUdp, Played("wave", rate_hz=60.0), network) as source:
        assert source.rate_hz == 60.0
        counts: list[int] = []
        while len(counts) < 40:
            arrival = known(source.take(5.0))
            assert source.human(arrival.sample, 0.0).valid.all()
            counts.append(arrival.sample.counter)
        assert counts == sorted(set(counts))
    assert source.reception.malformed == source.reception.foreign == 0


def test_who_is_not_on_the_list_is_not_heard() -> None:
    with (
        pytest.raises(ImitorError, match=r"none of use: 0 malformed, \d+ of another protocol or sender"),
        heard(JointsUdp, Played("wave", rate_hz=60.0), senders=["10.9.8.7"], wait_s=0.3),
    ):
        pass
