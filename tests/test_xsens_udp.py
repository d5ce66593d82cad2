"""Xsens MVN's network streaming: bytes by the specification, bodies, the way there and back, and what is wrong."""

from __future__ import annotations

import struct
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imitor import testing
from imitor.errors import ImitorError
from imitor.human.rotations import about_x, about_y, about_z
from imitor.live.quaternions import quaternions, rotations
from imitor.live.receiver import Arrival
from imitor.live.sample import BadDatagram, Foreign, Malformed, Sample
from imitor.live.source import measured_rate
from imitor.live.xsens_null_pose import NullPose, null_pose_payloads, read_null_pose
from imitor.live.xsens_wire import XsensDecoder, header, write_pose
from imitor.motion.mvnx_body import ORIGIN, matrices
from imitor.motion.mvnx_file import SEGMENTS, read_mvnx
from imitor.motion.normalise import handedness
from imitor.plugins.sources.mvnx import Mvnx, MvnxConfig
from imitor.plugins.sources.xsens_udp import XsensUdp, XsensUdpConfig
from imitor.types import ROLE_INDEX, SIDES
from known import known
from live_people import check_over_a_bad_network, heard
from live_streams import datagrams, decoded, performer, received, taken
from test_mvnx_source import t_pose

Array = NDArray[np.float64]
ESTIMATED = [ROLE_INDEX[f"{s}_hand"] for s in SIDES]
"""Knuckles are not told: they are put on the hand's axis."""


def live(**options: Any) -> XsensUdp:
    return XsensUdp(XsensUdpConfig(port=0, **options))


def one(decoder: XsensDecoder, *packets: bytes) -> Sample:
    (sample,) = decoded(decoder, packets)
    return sample


def told(kind: str, counter: int, items: bytes, n: int, *, part: int = 0x80, **changes: int) -> bytes:
    """Return a datagram written by hand: 24 bytes of header, then the items."""
    h = {"time_ms": 0, "character": 0, "segments": 23, "props": 0, "fingers": 0, "size": len(items)} | changes
    return (
        b"MXTP" + kind.encode() + struct.pack(">I", counter) + bytes([part, n]) + struct.pack(">I", h["time_ms"])
        + bytes([h["character"], h["segments"], h["props"], h["fingers"]]) + b"\0\0" + struct.pack(">H", h["size"])
        + items
    )  # fmt: skip


def quaternion_items(position: Array, q: tuple[float, ...] = (1, 0, 0, 0), first: int = 1) -> bytes:
    return b"".join(struct.pack(">i7f", first + i, *p, *q) for i, p in enumerate(position))


# ---------------------------------------------------------------- bytes


def test_a_pose_is_decoded_by_the_specification() -> None:
    q = (np.cos(0.3), 0.0, 0.0, np.sin(0.3))
    packet = told("02", 77, quaternion_items(t_pose(), q), 23, time_ms=123456)
    assert len(packet) == 760
    sample = one(XsensDecoder(), packet)
    assert (sample.counter, sample.time_s) == (77, 123.456)
    np.testing.assert_allclose(sample.body.position, t_pose(), atol=1e-7)
    np.testing.assert_allclose(
        sample.body.rotation, np.tile(about_z(np.array([0.6]))[0], (23, 1, 1)), atol=1e-7
    )


def test_a_pose_is_written_by_the_specification() -> None:
    q = np.tile([1.0, 0.0, 0.0, 0.0], (23, 1))
    (packet,) = write_pose(77, 123.456, t_pose(), q)
    assert packet == told("02", 77, quaternion_items(t_pose()), 23, time_ms=123456)


def test_angles_with_y_up_in_centimetres_are_the_same_pose() -> None:
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.5, 1.5, (23, 3))
    items = b"".join(
        struct.pack(">i6f", i + 1, *(100 * np.array([p[1], p[2], p[0]])), *np.degrees(a))
        for i, (p, a) in enumerate(zip(t_pose(), angles, strict=True))
    )
    packet = told("01", 5, items, 23)
    assert len(packet) == 668
    found = one(XsensDecoder(), packet).body
    np.testing.assert_allclose(found.position, t_pose(), atol=1e-6)
    y_up = about_z(angles[:, 2]) @ about_y(angles[:, 1]) @ about_x(angles[:, 0])
    world = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    np.testing.assert_allclose(found.rotation, world @ y_up @ world.T, atol=1e-6)


def test_where_both_kinds_of_pose_are_sent_quaternions_count() -> None:
    euler = told("01", 2, b"".join(struct.pack(">i6f", i + 1, *np.zeros(6)) for i in range(23)), 23)
    decoder = XsensDecoder()
    assert decoder.decode(euler) is not None
    assert decoder.decode(told("02", 2, quaternion_items(t_pose()), 23)) is not None
    assert decoder.decode(euler) is None


def test_old_senders_leave_counts_and_size_zero() -> None:
    packet = told("02", 1, quaternion_items(t_pose()), 23, segments=0, size=0)
    np.testing.assert_allclose(one(XsensDecoder(), packet).body.position, t_pose(), atol=1e-7)


def test_a_sample_may_be_split_and_its_parts_may_come_in_any_order() -> None:
    place = np.vstack([t_pose(), np.full((40, 3), 9.0)])  # 40 fingers after the body
    parts = [
        told("02", 4, quaternion_items(place[i : i + 21], first=i + 1), 21, part=k | (0x80 if k == 2 else 0))
        for k, i in enumerate((0, 21, 42))
    ]
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0), (0, 0, 2, 1)):
        sample = one(XsensDecoder(), *[parts[i] for i in order])
        np.testing.assert_allclose(sample.body.position, t_pose(), atol=1e-7)


def test_an_incomplete_sample_is_dropped_when_a_newer_one_completes() -> None:
    items = quaternion_items(t_pose())
    decoder = XsensDecoder()
    half = [
        told("02", 4, items[: 32 * 12], 12, part=0),
        told("02", 4, quaternion_items(t_pose()[12:], first=13), 11, part=0x81),
    ]
    assert decoded(decoder, [half[0], told("02", 5, items, 23), half[1]])[0].counter == 5
    assert not decoder._pending.keys() & {(b"MXTP02", 5)}
    again = XsensDecoder()
    for counter in range(500):
        again.decode(told("02", counter, items[: 32 * 12], 12, part=0))
    assert len(again._pending) <= 4
    again.reset()
    assert not again._pending


def test_other_types_and_other_people_are_passed_over() -> None:
    decoder = XsensDecoder()
    clock = struct.pack(">i", 12) + b"10:11:12.345"
    for kind, payload in (
        ("25", clock),
        ("12", struct.pack(">i", 4) + b"name"),
        ("03", b"\0" * 32),
        ("77", b""),
    ):
        assert decoder.decode(told(kind, 1, payload, 1)) is None
    assert decoder.decode(told("02", 1, quaternion_items(t_pose()), 23, character=1)) is None
    assert one(XsensDecoder(1), told("02", 1, quaternion_items(t_pose()), 23, character=1)).counter == 1


def test_segments_are_known_by_their_number_and_those_that_are_not_told_are_lost() -> None:
    items = quaternion_items(t_pose())
    shuffled = b"".join(items[32 * i : 32 * i + 32] for i in (*range(22, 3, -1), 0, 1))
    pose = one(XsensDecoder(), told("02", 1, shuffled, 21)).body
    lost = np.isnan(pose.position).any(axis=1)
    assert np.flatnonzero(lost).tolist() == [2, 3]
    np.testing.assert_allclose(pose.position[~lost], t_pose()[~lost], atol=1e-7)


def test_what_is_no_number_or_no_rotation_is_lost() -> None:
    place = t_pose()
    place[7, 1] = np.nan
    items = bytearray(quaternion_items(place))
    items[32 * 9 + 16 : 32 * 9 + 32] = struct.pack(">4f", 0.5, 0.0, 0.0, 0.0)
    pose = one(XsensDecoder(), told("02", 1, bytes(items), 23)).body
    assert np.flatnonzero(np.isnan(pose.position).any(axis=1)).tolist() == [7]
    assert np.flatnonzero(np.isnan(pose.rotation).any(axis=(1, 2))).tolist() == [9]


GOOD = told("02", 1, quaternion_items(t_pose()), 23)


@pytest.mark.parametrize(
    ("packet", "what"),
    [
        (b"", Foreign),
        (b"/VMC/Ext/OK\0,i\0\0" * 4, Foreign),
        (GOOD[:20], Foreign),
        (GOOD[:200], Malformed),
        (told("02", 1, quaternion_items(t_pose()), 255), Malformed),
        (told("02", 1, quaternion_items(t_pose()), 0), Malformed),
        (told("02", 1, quaternion_items(t_pose(), first=-3), 23), Malformed),
        (told("02", 1, quaternion_items(t_pose()[:1]) * 2, 2), Malformed),
        (told("02", 1, quaternion_items(t_pose(), first=24), 23), Malformed),
        (told("13", 1, struct.pack(">i", 2**31 - 1), 0), Malformed),
        (told("13", 1, struct.pack(">ii", 1, 2**30), 0), Malformed),
    ],
)  # fmt: skip
def test_datagrams_of_no_use_are_refused(packet: bytes, what: type[BadDatagram]) -> None:
    with pytest.raises(what):
        XsensDecoder().decode(packet)


def test_contradicting_parts_are_malformed() -> None:
    items = quaternion_items(t_pose()[:1])
    for parts in ((0x81, 0x02), (0x81, 0x82), (0x03, 0x82)):
        decoder = XsensDecoder()
        decoder.decode(told("02", 1, items, 1, part=parts[0]))
        with pytest.raises(Malformed):
            decoder.decode(told("02", 1, items, 1, part=parts[1]))


def test_what_is_wrong_is_counted() -> None:
    packets = [told("02", i, quaternion_items(t_pose()), 23) for i in range(10)]
    order = [packets[0], packets[1], packets[1], packets[3], packets[2], GOOD[:99], b"junk", packets[6]]
    receiver = taken(XsensDecoder(), order)
    assert receiver.reception.figures() == {
        "datagrams": 8, "malformed": 1, "foreign": 1, "samples": 4, "duplicated": 1, "reordered": 1, "lost": 2,
        "restarts": 0,
    }  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_no_datagram_does_harm(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["01", "02", "13", "25", "xx"]))
    body = data.draw(st.binary(max_size=900) | st.just(GOOD[24:]) | st.just(null_pose_payloads(NULL)[0]))
    n, part, size = (data.draw(st.integers(0, most)) for most in (30, 255, 900))
    size = size if data.draw(st.booleans()) else len(body)
    packet = bytearray(told(kind, data.draw(st.integers(0, 3)), body, n, part=part, size=size))
    for at in data.draw(st.lists(st.integers(0, len(packet) - 1), max_size=5)):
        packet[at] = data.draw(st.integers(0, 255))
    decoder = XsensDecoder()
    receiver = taken(decoder, [bytes(packet), GOOD, bytes(packet[: data.draw(st.integers(0, len(packet)))])])
    r = receiver.reception
    assert r.datagrams == 3
    assert r.malformed + r.foreign <= 2
    assert len(decoder._pending) <= 4
    arrival = receiver.box.take()
    assert arrival is not None
    assert arrival.sample.body.position.shape == (23, 3)


# ---------------------------------------------------------------- the null pose


NULL = NullPose(
    t_pose(),
    {
        ("LeftFoot", "pLeftHeelFoot"): np.array([-0.04, 0.0, -0.095]),
        ("Head", "pTopOfHead"): np.array([0.0, 0.0, 0.17]),
    },
)


def test_a_null_pose_comes_in_pieces() -> None:
    origins, points = null_pose_payloads(NULL)
    assert origins[:4] == struct.pack(">i", 23)
    assert origins[4:14] == struct.pack(">i", 6) + b"Pelvis"
    pose = read_null_pose(origins, None)
    assert pose is not None and not pose.points
    whole = read_null_pose(points, pose)
    assert whole is not None
    np.testing.assert_allclose(whole.origin, NULL.origin, atol=1e-7)
    assert whole.points.keys() == NULL.points.keys()
    np.testing.assert_allclose(whole.points["Head", "pTopOfHead"], [0, 0, 0.17], atol=1e-7)
    assert read_null_pose(points, None) is None
    by_hand = struct.pack(">ii", 0, 1) + struct.pack(">HHi", 7, 5, 1) + b"x" + struct.pack(">I3f", 0, 1, 2, 3)
    more = read_null_pose(by_hand, whole)
    assert more is not None
    np.testing.assert_array_equal(more.points["Head", "x"], [1, 2, 3])


# ---------------------------------------------------------------- there and back


def frames_of(source: Any, n: int | None = None) -> tuple[Array, Array]:
    frames = list(islice(source.frames(), n))
    return np.stack([f.position for f in frames]), np.stack([f.orientation for f in frames])


def check_same(sent: Any, got: list[Any], roles: NDArray[np.int_]) -> None:
    position, orientation = frames_of(sent, len(got))
    np.testing.assert_allclose(np.stack([f.position for f in got])[:, roles], position[:, roles], atol=3e-6)
    there = np.isfinite(orientation).all(axis=(0, 2, 3)) & np.isfinite(
        np.stack([f.orientation for f in got])
    ).all(axis=(0, 2, 3))
    assert there.sum() >= 17
    np.testing.assert_allclose(
        np.stack([f.orientation for f in got])[:, there], orientation[:, there], atol=1e-6
    )


@pytest.mark.shared
@pytest.mark.parametrize("file", ["Meri-020", "test_mocap"])
def test_a_recording_that_is_streamed_is_the_recording(shared: Path, file: str) -> None:
    sent = Mvnx(MvnxConfig(path=str(shared / f"mocap/mvnx/{file}.mvnx"), legs="recorded"))
    sent.start()
    source = live()
    got = received(source, sent)
    assert len(got) == sent.n_frames
    roles = np.delete(np.arange(25), ESTIMATED)
    check_same(sent, got, roles)
    for f, g in zip(sent.frames(), got, strict=True):
        np.testing.assert_allclose(g.position[ESTIMATED], f.position[ESTIMATED], atol=1e-4)
    s, t = sent.skeleton, source.skeleton
    np.testing.assert_allclose(t.rest_position[roles], s.rest_position[roles], atol=1e-6)
    assert t.roles == s.roles
    for name in ("height_m", "ankle_height_m", "toe_height_m"):
        assert getattr(t, name) == pytest.approx(getattr(s, name), abs=1e-6)


@pytest.mark.shared
@pytest.mark.parametrize(("file", "null"), [("Meri-020", "npose"), ("test_mocap", "identity")])
def test_without_a_null_pose_lengths_come_from_the_origins(shared: Path, file: str, null: str) -> None:
    mvnx = read_mvnx(shared / f"mocap/mvnx/{file}.mvnx")
    axes = np.swapaxes(
        matrices(mvnx.rest[null].quaternion), -1, -2
    )  # of the arms in version 3; the stream has none
    q = quaternions(matrices(mvnx.quaternion) @ axes)
    packets = [d for i in range(len(q)) for d in write_pose(i, i / 60, mvnx.position[i], q[i])]
    source = live(floor="sender")
    samples = decoded(source.decoder(), packets)
    source.learn(samples)
    rest, told_by_file = source.skeleton.rest_position, mvnx.rest[null].position
    for name, segment in ORIGIN.items():
        i = ROLE_INDEX[name]
        wanted = told_by_file[SEGMENTS.index(segment)] - told_by_file[SEGMENTS.index("Pelvis")]
        np.testing.assert_allclose(rest[i] - rest[0], wanted, atol=2e-3, err_msg=name)
        np.testing.assert_allclose(
            source.human(samples[0], 0.0).position[i], mvnx.position[0, SEGMENTS.index(segment)], atol=2e-3
        )
    recorded = Mvnx(MvnxConfig(path=str(shared / f"mocap/mvnx/{file}.mvnx"), legs="recorded"))
    recorded.start()
    assert source.skeleton.height_m == pytest.approx(recorded.skeleton.height_m, abs=0.06)
    for point, within in (("left_heel", 0.03), ("left_toe_tip", 0.04), ("right_heel", 0.03)):
        got = rest[ROLE_INDEX[point]] - rest[ROLE_INDEX["left_ankle"]]
        wanted = (recorded.skeleton.rest_position[ROLE_INDEX[r]] for r in (point, "left_ankle"))
        np.testing.assert_allclose(got, np.subtract(*wanted), atol=within)
    assert "no null pose was told" in source.skeleton.notes[1]


def test_the_performer_streamed_is_the_performer() -> None:
    sent = performer()
    source = live()
    got = received(source, sent, 200, learn=60)
    check_same(sent, got, np.delete(np.arange(25), ESTIMATED))
    for i in ESTIMATED:
        assert got[50].position[i] == pytest.approx(frames_of(sent, 51)[0][50, i], abs=0.005)
    assert handedness(source.skeleton.rest_position) > 0.9
    testing.check_frames(XsensUdp, got, source.skeleton, sent.rate_hz)


def test_lost_points_arrive_as_lost() -> None:
    sent = performer(loss=0.1, seed=2)
    got = received(live(), sent, 60)
    for f, g in zip(sent.frames(), got, strict=False):
        assert not g.valid[ROLE_INDEX["left_knee"]] or f.valid[ROLE_INDEX["left_knee"]]
        assert g.valid[ROLE_INDEX["right_elbow"]] == f.valid[ROLE_INDEX["right_elbow"]]


def test_a_person_who_calibrated_facing_elsewhere_and_stands_on_a_table() -> None:
    sent = performer("stand")
    samples = []
    for sample in decoded(XsensDecoder(), datagrams(XsensUdp, sent, 60)):
        pose = sample.body
        pose.position[:, 2] += 0.7
        samples.append(sample)
    source = live()
    source.learn(samples)
    assert source.human(samples[0], 0.0).position == pytest.approx(frames_of(sent, 1)[0][0], abs=0.01)
    kept = live(floor="sender")
    kept.learn(samples)
    assert kept.human(samples[0], 0.0).position[0, 2] == pytest.approx(
        source.human(samples[0], 0.0).position[0, 2] + 0.7, abs=0.01
    )
    assert any(n.startswith("floor: the sender's zero") for n in kept.skeleton.notes)
    given_floor = live(floor=0.7, height_m=1.8)
    given_floor.learn(samples)
    assert given_floor.human(samples[0], 0.0).position == pytest.approx(frames_of(sent, 1)[0][0], abs=1e-5)
    assert given_floor.skeleton.height_m == 1.8


def test_a_stream_of_half_a_body_is_refused() -> None:
    source = live()
    samples = decoded(
        source.decoder(), [told("02", i, quaternion_items(t_pose()[:15]), 15) for i in range(5)]
    )
    with pytest.raises(ImitorError, match=r"no two instants show the whole body: RightUpperLeg, .* missing"):
        source.learn(samples)


def test_a_recording_without_orientations_cannot_be_sent() -> None:
    class Bare(type(performer("stand"))):  # type: ignore[misc]
        gives = frozenset({"markers"})

    with pytest.raises(
        ImitorError, match=r"sends orientations of segments, and this recording .performer. has none"
    ):
        XsensUdp.encoder(Bare(performer("stand").config))


def test_over_a_bad_network() -> None:
    check_over_a_bad_network(XsensUdp, performer(rate_hz=100.0))


def test_over_a_socket() -> None:
    with heard(XsensUdp, performer(rate_hz=100.0), learn_s=0.3) as source:
        assert source.rate_hz == pytest.approx(100.0, rel=0.05)
        frames = [f for f, _ in zip(source.frames(), range(20), strict=False)]
        assert len(frames) == 20
        assert all(f.valid.all() for f in frames)
        lowest = min(f.position[ROLE_INDEX["left_heel"], 2] for f in frames)
        assert lowest == pytest.approx(0.0, abs=0.05)
        assert source.reception.malformed == source.reception.foreign == 0
    assert known(frames[0].orientation).shape == (25, 3, 3)


# ---------------------------------------------------------------- quaternions


@given(st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=3))
def test_quaternions_there_and_back(angles: list[float]) -> None:
    x, y, z = np.array(angles)[:, None]
    R = about_z(z) @ about_y(y) @ about_x(x)
    q = quaternions(R)
    assert np.linalg.norm(q) == pytest.approx(1.0)
    np.testing.assert_allclose(rotations(q), R, atol=1e-12)
    np.testing.assert_allclose(rotations(-q), R, atol=1e-12)


def test_headers_wrap_their_counts() -> None:
    assert header("02", 2**32 + 5, 0x80, 23, 2**32 / 1000 + 1.0, 0, 0)[6:10] == struct.pack(">I", 5)


@pytest.mark.parametrize("rate_hz", [60.0, 120.0, 240.0])
def test_the_rate_is_found_under_a_clock_of_milliseconds(rate_hz: float) -> None:
    ticks = [Sample(i, round(1000 * i / rate_hz) / 1000, None) for i in range(int(rate_hz))]
    ticks += [Sample(s.counter + len(ticks), s.time_s + 3.0, None) for s in ticks]  # after a pause
    assert measured_rate([Arrival(s, 0.0) for s in ticks]) == rate_hz
