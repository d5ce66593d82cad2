"""DTrack's ASCII datagrams: the maker's example lines, the 17 targets, the human model, and what is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from captured_people import perform_with_targets
from imitor import testing
from imitor.errors import ImitorError
from imitor.human.markers import TARGETS
from imitor.live.art import ArtFrame, read_art, write_art
from imitor.live.receiver import NO_USE
from imitor.live.sample import Foreign, Malformed, Sample
from imitor.live.stream import Network
from imitor.motion.art_file import BODY_17
from imitor.motion.target_recording import TargetOptions, make_target_recording
from imitor.plugins.sources.art_udp import JOINTS_61, ArtUdp, ArtUdpConfig
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.testing.live import Played, encoded
from imitor.types import ROLE_INDEX
from known import known
from live_people import decode_all, heard

EXAMPLE = (
    b"fr 3823\r\n"
    b"ts 44597.741924\r\n"
    b"6dcal 2\r\n"
    b"6d 1 [0 1.000][84.203 37.681 172.102 99.1970 6.7130 9.6575]"
    b"[0.979069 0.086946 0.184021 -0.166608 -0.176923 0.970021 0.116897 -0.980377 -0.158734]\r\n"
    b"6dj 1 1 [0 2][0 1.000][-8.07 -173.69 995.96 0 0 -6][0.9945 -0.1045 0 0.1045 0.9945 0 0 0 1]"
    b"[1 1.000][1 2 3 0 0 0][1 0 0 0 1 0 0 0 1]\r\n"
    b"3d 0\r\n"
)


def test_the_example() -> None:
    frame = read_art(EXAMPLE)
    assert (frame.counter, frame.time_s) == (3823, 44597.741924)
    assert list(frame.bodies) == [0]
    pose = frame.bodies[0]
    np.testing.assert_array_equal(pose[:3, 3], [84.203, 37.681, 172.102])
    np.testing.assert_allclose(pose[:3, 0], [0.979069, 0.086946, 0.184021], atol=1e-6)
    np.testing.assert_allclose(pose[:3, 2], [0.116897, -0.980377, -0.158734], atol=1e-6)
    assert list(frame.humans) == [0] and list(frame.humans[0]) == [0, 1]
    np.testing.assert_array_equal(frame.humans[0][0][:3, 3], [-8.07, -173.69, 995.96])
    assert frame.humans[0][0][1, 0] == pytest.approx(-0.1045, abs=1e-4)
    for each in (pose, *frame.humans[0].values()):  # rounded on the way, a rotation here
        np.testing.assert_allclose(each[:3, :3] @ each[:3, :3].T, np.eye(3), atol=1e-12)


def test_what_is_written_are_the_bytes_of_the_example() -> None:
    frame = read_art(EXAMPLE)
    written = write_art(replace(frame, humans={}), 2).split(b"\r\n")
    lines = EXAMPLE.split(b"\r\n")
    assert written[:3] == lines[:3]
    head, angles, matrix = (b.strip(b"[") for b in written[3].split(b"]")[:3])
    assert head == b"6d 1 [0 1.000"
    assert b"[" + matrix + b"]" == lines[3][lines[3].rindex(b"[") :]
    told = [float(w) for w in lines[3].split(b"]")[1].strip(b"[").split()]
    np.testing.assert_allclose([float(w) for w in angles.split()], told, atol=1e-3)
    assert (
        write_art(replace(frame, bodies={}), 0)
        .split(b"\r\n")[2]
        .startswith(b"6dj 1 1 [0 2][0 1.000][-8.070 ")
    )


def test_the_order_of_lines_unknown_lines_and_line_ends_do_not_matter() -> None:
    lines = EXAMPLE.strip().split(b"\r\n")
    other = b"\n".join([b"6dxyz 1 [9 9", *lines[::-1], b"6di 0"]) + b"\n\0"
    one, two = read_art(EXAMPLE), read_art(other)
    assert (two.counter, two.time_s) == (one.counter, one.time_s)
    np.testing.assert_array_equal(two.bodies[0], one.bodies[0])


def test_surplus_values_in_a_block_are_left_out() -> None:
    more = EXAMPLE.replace(b"9.6575]", b"9.6575 5 5]").replace(b"-0.158734]", b"-0.158734 7]")
    np.testing.assert_array_equal(read_art(more).bodies[0], read_art(EXAMPLE).bodies[0])
    fewer = EXAMPLE.replace(b" 99.1970 6.7130 9.6575]", b"]")  # newer versions send no angles
    np.testing.assert_array_equal(read_art(fewer).bodies[0], read_art(EXAMPLE).bodies[0])


def test_the_newer_time_stamp() -> None:
    assert read_art(b"fr 1\r\nts2 1700000000 250000 3000\r\n").time_s == 1700000000.25
    assert np.isnan(read_art(b"fr 1\r\n").time_s)


@pytest.mark.parametrize(
    "lost",
    [
        b"6d 1 [0 -1.000][0 0 0][0 0 0 0 0 0 0 0 0]\r\n",
        b"6d 1 [0 1.000][1 2 3][0 0 0 0 0 0 0 0 0]\r\n",
        b"6d 1 [0 1.000][1 2 3][1 0 0 0 1 0 0 0 -1]\r\n",
        b"6d 1 [0 1.000][1 2 3][1e200 0 0 0 1 0 0 0 1]\r\n",
        b"6d 1 [0 1.000][1e9 2 3][1 0 0 0 1 0 0 0 1]\r\n",
        b"6d 0\r\n",
        b"",
    ],
)
def test_what_is_not_tracked_is_not_there(lost: bytes) -> None:
    assert read_art(b"fr 5\r\n" + lost).bodies == {}


@pytest.mark.parametrize(
    ("datagram", "error"),
    [
        (b"", Foreign),
        (b"\xffr 1", Foreign),
        (b"MXTP02" + bytes(40), Foreign),
        (b"ts 1.0\r\n", Foreign),
        (b"fr x\r\n", Malformed),
        (b"fr -1\r\n", Malformed),
        (b"fr " + b"9" * 5000, Malformed),
        (b"fr 1\r\nts abc\r\n", Malformed),
        (b"fr 1\r\nts inf\r\n", Malformed),
        (b"fr 1\r\nts2 12\r\n", Malformed),
        (b"fr 1\r\n6d\r\n", Malformed),
        (b"fr 1\r\n6d 2 [0 1.000][1 2 3][1 0 0 0 1 0 0 0 1]\r\n", Malformed),
        (b"fr 1\r\n6d 999999999 [0 1.000][1 2 3][1 0 0 0 1 0 0 0 1]\r\n", Malformed),
        (b"fr 1\r\n6d 1 [0][1 2 3][1 0 0 0 1 0 0 0 1]\r\n", Malformed),
        (b"fr 1\r\n6d 1 [0 1.000][1 2][1 0 0 0 1 0 0 0 1]\r\n", Malformed),
        (b"fr 1\r\n6d 1 [0 1.000][1 2 3][1 0 0 0 1 0 0 0]\r\n", Malformed),
        (b"fr 1\r\n6d 1 [0 1.000][1 nan 3][1 0 0 0 1 0 0 0 1]\r\n", Malformed),
        (b"fr 1\r\n6dj 1 1 [0 999999999][0 1.000][1 2 3][1 0 0 0 1 0 0 0 1]\r\n", Malformed),
        (b"fr 1\r\n6dj 1 999999999 [0 1][0 1.000][1 2 3][1 0 0 0 1 0 0 0 1]\r\n", Malformed),
        (EXAMPLE[: EXAMPLE.index(b"0.970021")], Malformed),
    ],
)
def test_wrong_datagrams_are_told_apart(datagram: bytes, error: type[Exception]) -> None:
    with pytest.raises(error):
        read_art(datagram)


@settings(deadline=None, max_examples=150)
@given(st.data())
def test_mutations_do_no_harm(data: Any) -> None:
    changed = bytearray(EXAMPLE)
    for _ in range(data.draw(st.integers(0, 6))):
        at = data.draw(st.integers(0, len(changed) - 1))
        changed[at : at + 1] = data.draw(
            st.sampled_from([b"", b"[", b"]", b" ", b"9", b"-", b"e", b"\n", b"\xff"])
        )
    cut = bytes(changed[: data.draw(st.integers(0, len(changed)))])
    for wrong in (bytes(changed), cut):
        try:
            frame = read_art(wrong)
        except NO_USE:
            continue
        assert isinstance(frame, ArtFrame)
        assert all(np.isfinite(pose).all() for pose in frame.bodies.values())


# ---------------------------------------------------------------- the person


def samples_of(scenario: str, *, targets: bool, rate_hz: float = 60.0) -> tuple[Performer, list[Sample]]:
    performer = Performer(PerformerConfig(scenario=scenario, targets=targets, rate_hz=rate_hz))
    performer.start()
    told = [d for parts in encoded(ArtUdp, performer) for d in parts]
    return performer, decode_all(ArtUdp(ArtUdpConfig()).decoder(), told)


def learned(samples: Sequence[Sample], rate_hz: float = 60.0, **options: Any) -> ArtUdp:
    source = ArtUdp(ArtUdpConfig(**options))
    source.rate_hz = rate_hz
    source.learn(samples)
    return source


def test_the_person_is_that_of_a_recording() -> None:
    truth = perform_with_targets("squat")
    pose = np.asarray(truth.target)[:, [TARGETS.index(n) for n in BODY_17]]
    clip = make_target_recording("a.txt", pose, BODY_17, TargetOptions(unit="m"))
    _, samples = samples_of("squat", targets=True)
    source = learned(samples)
    assert source.skeleton.target_names == BODY_17
    frames = [source.human(s, 0.0) for s in samples]
    # The wire has whole micrometres and six digits of a matrix.
    np.testing.assert_allclose([known(f.target) for f in frames], known(clip.target), atol=2e-6)
    np.testing.assert_allclose([f.position for f in frames], clip.position, atol=2e-5)


def test_a_target_that_is_lost_takes_its_joints_along() -> None:
    _, samples = samples_of("squat", targets=True)
    source = learned(samples)
    told = samples[40].body
    target = told.target.copy()
    target[BODY_17.index("left_forearm")] = np.nan
    frame = source.human(Sample(0, 0.0, type(told)(target, told.joint)), 0.0)
    lost = {"left_elbow", "left_wrist", "left_hand"}
    assert {r for r in source.skeleton.roles if not frame.valid[ROLE_INDEX[r]]} == lost
    assert known(frame.target_valid).sum() == 16


def test_bodies_may_have_other_ids() -> None:
    _, samples = samples_of("squat", targets=True)
    table = ["", "", *reversed(BODY_17)]
    decoder = ArtUdp(ArtUdpConfig(targets=table)).decoder()
    poses = {table.index(n): samples[0].body.target[i] for i, n in enumerate(BODY_17)}
    seen = known(decoder.decode(write_art(ArtFrame(0, 0.0, {**poses, 0: np.eye(4), 99: np.eye(4)}, {}))))
    np.testing.assert_allclose(seen.body.target, samples[0].body.target[::-1], atol=2e-3)


def test_the_human_model_gives_its_joints() -> None:
    performer, samples = samples_of("walk", targets=False)
    source = learned(samples)
    assert source.skeleton.roles == {r for r in JOINTS_61 if r}
    truth = performer.truth.position
    for s in samples[::10]:
        frame = source.human(s, 0.0)
        assert frame.target is None
        np.testing.assert_allclose(frame.position[frame.valid], truth[s.counter][frame.valid], atol=1e-5)


def test_the_human_model_goes_before_rigid_bodies_unless_said() -> None:
    _, modelled = samples_of("squat", targets=False)
    _, worn = samples_of("squat", targets=True)
    both = [
        Sample(w.counter, w.time_s, replace(w.body, joint=m.body.joint))
        for w, m in zip(worn, modelled, strict=True)
    ]
    assert learned(both).human(both[0], 0.0).target is None
    assert learned(both, body="targets").human(both[0], 0.0).target is not None


def test_nobody_there() -> None:
    nobody = decode_all(ArtUdp(ArtUdpConfig()).decoder(), [b"fr %d\r\n6d 0\r\n" % i for i in range(10)])
    with pytest.raises(ImitorError) as caught:
        learned(nobody)
    assert str(caught.value) == (
        "no rigid body seen in the first 3 s, nor a human model 0; let the sender tell 6d or 6dj, or set learn_s higher"
    )
    with pytest.raises(ImitorError, match=r"^pelvis, left_hip, .*: not seen in the first 3 s; a body needs"):
        learned(nobody, body="human")


def test_targets_that_are_never_seen_are_named() -> None:
    _, samples = samples_of("squat", targets=True, rate_hz=10.0)
    for s in samples:
        s.body.target[BODY_17.index("left_shin")] = np.nan
    with pytest.raises(ImitorError) as caught:
        learned(samples, 10.0)
    assert str(caught.value) == (
        "left_shin: not seen in the first 3 s, put the ids of their bodies into the option targets, "
        "or set learn_s higher"
    )


def test_a_few_seconds_of_motion_show_the_joints() -> None:
    performer, samples = samples_of("squat", targets=True)
    source = learned(samples[:180])
    found = np.array([source.human(s, 0.0).position for s in samples])
    error = np.linalg.norm(found - performer.truth.position, axis=-1)
    assert np.nanmedian(error) < 0.03
    assert np.nanmax(error) < 0.08


def test_tables_are_checked() -> None:
    with pytest.raises(
        ValidationError, match=r"there is no role 'left_sholder'; did you mean 'left_shoulder'\?"
    ):
        ArtUdpConfig(joints=["pelvis", "left_sholder"])
    with pytest.raises(ValidationError, match="none is called 'hat'"):
        ArtUdpConfig(targets=[*BODY_17[:-1], "hat"])


def test_it_keeps_the_contract_of_a_live_source() -> None:
    testing.check_component(ArtUdp)


@pytest.mark.parametrize("network", [None, Network(loss=0.05, reorder=0.05, duplicate=0.05, jitter_s=0.005)])
def test_over_a_socket(network: Network | None) -> None:
    with heard(ArtUdp, Played("squat", rate_hz=60.0), network) as source:
        assert source.rate_hz == 60.0
        counts: list[int] = []
        while len(counts) < 40:
            arrival = known(source.take(5.0))
            assert known(source.human(arrival.sample, 0.0).target_valid).all()
            counts.append(arrival.sample.counter)
        assert counts == sorted(set(counts))
    assert source.reception.malformed == source.reception.foreign == 0
