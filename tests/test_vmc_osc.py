"""The VMC protocol: OSC by hand and by python-osc, Unity's axes, where an instant ends, bodies, and what is wrong."""

from __future__ import annotations

import struct
from itertools import islice
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imitor import testing
from imitor.errors import ImitorError
from imitor.human.rotations import about_x, about_y, about_z
from imitor.live.osc import OscReader, bundles
from imitor.live.quaternions import quaternions
from imitor.live.sample import BadDatagram, Foreign, Malformed, Sample
from imitor.live.vmc import BONES, VmcDecoder, VmcPose
from imitor.live.vmc_body import FROM_UNITY, BoneTree
from imitor.plugins.sources.vmc_osc import VmcOsc, VmcOscConfig
from imitor.types import ROLE_INDEX
from known import known
from live_people import check_over_a_bad_network, heard
from live_streams import datagrams, decoded, performer, received, taken

osc_packet = pytest.importorskip("pythonosc.osc_packet")

Array = NDArray[np.float64]
STILL = (0.0, 0.0, 0.0, 1.0)


def live(**options: Any) -> VmcOsc:
    return VmcOsc(VmcOscConfig(port=0, **options))


def text(value: str) -> bytes:
    raw = value.encode()
    return raw + b"\0" * (4 - len(raw) % 4)


def message(address: str, types: str, *values: Any) -> bytes:
    """Return a message written by hand."""
    out = text(address) + text("," + types)
    for kind, value in zip(types, values, strict=True):
        out += text(value) if kind == "s" else struct.pack(">" + kind, value)
    return out


def bundle(*elements: bytes) -> bytes:
    return b"#bundle\0" + struct.pack(">Q", 1) + b"".join(struct.pack(">i", len(e)) + e for e in elements)


def bone(name: str, place: tuple[float, ...] = (0, 0, 0), q: tuple[float, ...] = STILL) -> bytes:
    return message("/VMC/Ext/Bone/Pos", "sfffffff", name, *place, *q)


def root(*place: float) -> bytes:
    return message("/VMC/Ext/Root/Pos", "sfffffff", "root", *(place or (0, 0, 0)), *STILL)


def clock(seconds: float) -> bytes:
    return message("/VMC/Ext/T", "f", seconds)


STATE = message("/VMC/Ext/OK", "iii", 1, 3, 0)


def bones_told(sample: Sample) -> set[str]:
    return {b for b, there in zip(BONES, np.isfinite(sample.body.bones).all(axis=1), strict=True) if there}


# ---------------------------------------------------------------- OSC


def test_messages_are_found_in_bundles_of_bundles() -> None:
    packet = bundle(clock(1.5), bundle(message("/other", "i", 3), bone("Hips", (1, 2, 3))), STATE)
    reader = OscReader(("/VMC/Ext/T", "/VMC/Ext/Bone/Pos"))
    assert reader.read(packet) == [
        ("/VMC/Ext/T", [1.5]),
        ("/VMC/Ext/Bone/Pos", ["Hips", 1, 2, 3, 0, 0, 0, 1]),
    ]
    assert reader.read(clock(2.0)) == [("/VMC/Ext/T", [2.0])]


def test_messages_of_unknown_types_are_passed_over() -> None:
    reader = OscReader(("/VMC/Ext/T",))
    assert reader.read(text("/VMC/Ext/T") + text(",Q") + b"\0" * 4) == []
    assert reader.read(text("/VMC/Ext/T")) == []
    assert reader.read(text("/VMC/Ext/T") + text("f") + b"\0" * 4) == []
    assert reader.read(message("/VMC/Ext/T", "f" * 300, *[0.0] * 300)) == []


@pytest.mark.parametrize(
    ("packet", "what"),
    [
        (b"", Foreign),
        (b"MXTP02" + b"\0" * 30, Foreign),
        (message("/a/b", "i", 1), Foreign),
        (b"#bundle\0\0\0", Malformed),
        (b"#bundle\0" + b"\0" * 8 + struct.pack(">i", -4), Malformed),
        (b"#bundle\0" + b"\0" * 8 + struct.pack(">i", 0), Malformed),
        (b"#bundle\0" + b"\0" * 8 + struct.pack(">i", 2**31 - 1), Malformed),
        (b"#bundle\0" + b"\0" * 8 + b"\0\0", struct.error),
        (bundle(b"junk"), Malformed),
        (bundle(bundle(bundle(bundle(bundle(bundle(clock(1))))))), Malformed),
        (bundle(*[text("/a")] * 1200), Malformed),
        (b"/VMC/Ext/T", Malformed),
        (clock(1.0)[:-2], Malformed),
        (clock(1.0)[:-4], Malformed),
        (bone("Hips")[:-4], Malformed),
        (text("/VMC/Ext/T") + text(",s") + b"\xff\xfe\xfd\0", Malformed),
    ],
)  # fmt: skip
def test_datagrams_of_no_use_are_refused(packet: bytes, what: type[BadDatagram]) -> None:
    with pytest.raises(what):
        VmcDecoder().decode(packet)


def test_bundles_fit_into_packets_and_python_osc_reads_them() -> None:
    packets = datagrams(VmcOsc, performer(), 1)
    assert len(packets) == 2
    assert max(map(len, packets)) <= 1400
    found = [m.message for p in packets for m in osc_packet.OscPacket(p).messages]
    assert [m.address.rsplit("/", 1)[-1] for m in found[:2]] == ["Pos", "Pos"]
    assert [m.address for m in found[-2:]] == ["/VMC/Ext/OK", "/VMC/Ext/T"]
    assert [m.params[0] for m in found[1:4]] == ["Hips", "Spine", "Chest"]
    assert all(len(m.params) == 8 for m in found[:-2])
    ours = OscReader(("/VMC/Ext/Root/Pos", "/VMC/Ext/Bone/Pos", "/VMC/Ext/OK", "/VMC/Ext/T"))
    assert [(m.address, m.params) for m in found] == [m for p in packets for m in ours.read(p)]


# ---------------------------------------------------------------- where an instant ends


def test_a_clock_ends_an_instant_that_spans_datagrams() -> None:
    packets = []
    for i in range(3):
        packets += [
            bundle(root(), bone("Hips"), bone("Spine")),
            bundle(bone("Head")),
            bundle(STATE, clock(10 + i / 64)),
        ]
    samples = decoded(VmcDecoder(), packets)
    assert [s.counter for s in samples] == [1, 2, 3]
    assert [s.time_s for s in samples] == [10 + i / 64 for i in range(3)]
    assert all(bones_told(s) == {"Hips", "Spine", "Head"} for s in samples)


def test_the_state_alone_ends_an_instant() -> None:
    samples = decoded(VmcDecoder(), [bone("Hips"), bone("Head"), STATE, bone("Hips"), STATE])
    assert [bones_told(s) for s in samples] == [{"Hips", "Head"}, {"Hips"}]
    assert np.isnan(samples[0].time_s)


def test_a_clock_before_the_bones_does_not_delay_them() -> None:
    packets = []
    for i in range(4):
        packets += [bundle(STATE, clock(10 + i / 64), root(i, 0, 0), bone("Hips")), bundle(bone("Head"))]
    decoder = VmcDecoder()
    samples = [decoder.decode(p) for p in packets]
    assert [s is not None for s in samples] == [False, False, True, True, False, True, False, True]
    told = [s for s in samples if s is not None]
    assert [s.time_s for s in told] == [10 + i / 64 for i in range(4)]
    assert [s.body.root[0] for s in told] == [0, 1, 2, 3]
    assert all(bones_told(s) == {"Hips", "Head"} for s in told)
    assert decoder.decode(packets[-1]) is None


def test_of_a_sender_without_a_clock_the_next_root_or_the_last_bone_ends_an_instant() -> None:
    one, two = bundle(root(), bone("Hips")), bundle(bone("Head"))
    decoder = VmcDecoder()
    told = [decoder.decode(p) is not None for p in (one, two, one, two, one, one, two, two)]
    assert told == [False, False, True, True, False, True, True, False]
    alone = VmcDecoder()
    samples = [alone.decode(p) for p in (bone("Hips"), bone("Head")) * 3]
    assert [s is not None for s in samples] == [False, False, True, True, False, True]


def test_repeated_datagrams_change_nothing() -> None:
    packets = [bundle(root(), bone("Hips")), bundle(bone("Head")), bundle(clock(1.0))]
    packets += [packets[1], bundle(root(), bone("Hips")), bundle(bone("Head")), bundle(clock(1.02))]
    samples = decoded(VmcDecoder(), [STATE, packets[0], packets[0], *packets[1:]])
    assert [bones_told(s) for s in samples] == [{"Hips", "Head"}] * 2


def test_late_and_repeated_instants_are_counted() -> None:
    def instant(time_s: float) -> bytes:
        return bundle(root(), bone("Hips"), clock(time_s))

    order = [instant(t) for t in (5.00, 5.01, 5.01, 5.03, 5.02, 5.04)] + [
        b"junk",
        clock(1.0)[:-1],
        instant(0.5),
    ]
    figures = taken(VmcDecoder(), order).reception.figures()
    assert figures["samples"] == 5
    assert (figures["duplicated"], figures["reordered"]) == (1, 1)
    assert (figures["malformed"], figures["foreign"]) == (1, 1)


def test_messages_as_seen_in_the_wild() -> None:
    nameless = message("/VMC/Ext/Root/Pos", "fffffff", 1, 2, 3, *STILL)
    longer = message("/VMC/Ext/Bone/Pos", "sfffffffffs", "Head", 0, 1, 0, *STILL, 9, 9, "more")
    whole = message("/VMC/Ext/Bone/Pos", "siiiffff", "Neck", 0, 1, 0, *STILL)
    wrong = [
        bone("-"), bone("LeftEye"), message("/VMC/Ext/Bone/Pos", "sfff", "Spine", 0, 0, 0),
        message("/VMC/Ext/Bone/Pos", "ffffffff", *[0.0] * 8), message("/VMC/Ext/T", "s", "now"),
        message("/VMC/Ext/T", ""),
        message("/VMC/Ext/Blend/Val", "sf", "Joy", 1.0),
    ]  # fmt: skip
    (sample,) = decoded(VmcDecoder(), [bundle(nameless, bone("Hips"), longer, whole, *wrong), STATE])
    assert bones_told(sample) <= {"Hips", "Head", "Neck"}
    np.testing.assert_array_equal(sample.body.root, [1, 2, 3, *STILL])


def test_a_reset_forgets_what_has_not_ended() -> None:
    decoder = VmcDecoder()
    decoder.decode(bone("Hips"))
    decoder.reset()
    assert decoder.decode(STATE) is None


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_no_datagram_does_harm(data: st.DataObject) -> None:
    parts = [root(), bone("Hips"), bone("Head", (np.nan, 1e38, 0)), clock(1.0), STATE, b"/x", b"#bundle\0"]
    packet = bytearray(
        bundle(*data.draw(st.lists(st.sampled_from(parts) | st.binary(max_size=80), max_size=8)))
    )
    for at in data.draw(st.lists(st.integers(0, len(packet) - 1), max_size=6)):
        packet[at] = data.draw(st.integers(0, 255))
    good = bundle(root(), bone("Hips"), clock(7.0), STATE)
    cut = bytes(packet[: data.draw(st.integers(0, len(packet)))])
    receiver = taken(VmcDecoder(), [bytes(packet), cut, good])
    assert receiver.reception.datagrams == 3
    arrival = receiver.box.take()
    assert arrival is not None
    assert arrival.sample.body.bones.shape == (24, 7)
    assert np.isfinite(arrival.sample.body.bones[0]).all()


# ---------------------------------------------------------------- Unity's axes


def test_unity_axes_become_ours() -> None:
    # x right, y up, z forward
    np.testing.assert_array_equal(FROM_UNITY @ [1, 0, 0], [0, -1, 0])
    np.testing.assert_array_equal(FROM_UNITY @ [0, 1, 0], [0, 0, 1])
    np.testing.assert_array_equal(FROM_UNITY @ [0, 0, 1], [1, 0, 0])
    s = np.sqrt(0.5)
    pose = np.full((24, 7), np.nan)
    pose[BONES.index("Hips")] = (
        0,
        1,
        0,
        0,
        s,
        0,
        s,
    )  # in Unity a positive quarter turn about y turns forward to right
    pose[BONES.index("Spine")] = (0, 0.1, 0.2, *STILL)
    pose[BONES.index("LeftUpperArm")] = (
        -0.2,
        0.4,
        0,
        0,
        0,
        s,
        s,
    )  # about z: x goes to y, so the left arm points down
    pose[BONES.index("LeftLowerArm")] = (-0.3, 0, 0, *STILL)
    told = VmcPose(pose, np.array([1.0, 0.0, 2.0, *STILL]))
    tree = BoneTree([told])
    place, _ = tree.poses(told)
    at = {n.name: p for n, p in zip(tree.nodes, place, strict=True)}
    np.testing.assert_allclose(at["Hips"], [2, -1, 1], atol=1e-12)
    np.testing.assert_allclose(at["Spine"], [2, -1.2, 1.1], atol=1e-12)  # ahead is now to the right
    shoulder, elbow = at["LeftUpperArm"], at["LeftLowerArm"]
    np.testing.assert_allclose(shoulder - at["Spine"], [0.2, 0, 0.4], atol=1e-12)  # left is now ahead
    np.testing.assert_allclose(elbow - shoulder, [0, 0, -0.3], atol=1e-12)
    parent = {n.name: n.parent for n in tree.nodes}
    assert parent["LeftUpperArm"] == [n.name for n in tree.nodes].index("Spine")  # the nearest that is told


# ---------------------------------------------------------------- there and back


def frames_of(source: Any, n: int) -> tuple[Array, Array]:
    frames = list(islice(source.frames(), n))
    return np.stack([f.position for f in frames]), np.stack([known(f.orientation) for f in frames])


def test_the_performer_streamed_is_the_performer() -> None:
    sent = performer()
    source = live()
    got = received(source, sent, 200, learn=60)
    assert len(got) == 200
    roles = [ROLE_INDEX[r] for r in source.skeleton.roles]
    assert len(roles) == 20
    position, orientation = frames_of(sent, 200)
    np.testing.assert_allclose(np.stack([f.position for f in got])[:, roles], position[:, roles], atol=1e-6)
    np.testing.assert_allclose(
        np.stack([known(f.orientation) for f in got])[:, roles], orientation[:, roles], atol=1e-6
    )
    rest, wanted = source.skeleton.rest_position, sent.skeleton.rest_position
    np.testing.assert_allclose(rest[roles], wanted[roles], atol=5e-3)
    assert source.skeleton.height_m == pytest.approx(1.75, abs=0.02)
    testing.check_frames(VmcOsc, got, source.skeleton, sent.rate_hz)


def test_an_avatar_of_another_size_is_scaled() -> None:
    sent = performer("squat", height_m=1.2)
    source = live(height_m=1.8)
    got = received(source, sent, 100)
    assert source.skeleton.height_m == 1.8
    knee, ankle = (np.stack([f.position[ROLE_INDEX[r]] for f in got]) for r in ("left_knee", "left_ankle"))
    np.testing.assert_allclose(np.linalg.norm(knee - ankle, axis=1), 0.246 * 1.8, rtol=0.01)
    assert got[0].position[ROLE_INDEX["left_ankle"], 2] == pytest.approx(
        source.skeleton.ankle_height_m, abs=0.005
    )
    assert "scaled by 1.4" in source.skeleton.notes[2] or "scaled by 1.5" in source.skeleton.notes[2]


def turned_at_rest(pose: VmcPose, tree: BoneTree) -> VmcPose:
    """Return the pose with every bone's axes turned, as an avatar's that was not normalised."""
    rng = np.random.default_rng(0)
    x, y, z = rng.uniform(-2, 2, (3, 24))
    own = {n.name: R for n, R in zip(tree.nodes, about_z(z) @ about_y(y) @ about_x(x), strict=False)}
    bones = pose.bones.copy()
    for n in tree.nodes:
        i = BONES.index(n.name)
        parent = own[tree.nodes[n.parent].name] if n.parent >= 0 else np.eye(3)
        place, q = bones[i, :3], bones[i, 3:]
        u, w = q[:3], q[3]
        cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
        R = np.eye(3) + 2 * w * cross + 2 * cross @ cross
        turned = quaternions(parent.T @ R @ own[n.name])
        bones[i] = *(parent.T @ place), *turned[1:], turned[0]
    return VmcPose(bones, pose.root)


def test_bones_that_are_turned_at_rest_need_a_t_pose() -> None:
    still, moving = performer("t_pose"), performer("wave")
    n = 30
    samples = decoded(VmcDecoder(), datagrams(VmcOsc, still, n) + datagrams(VmcOsc, moving, 90))
    tree = BoneTree([s.body for s in samples])
    samples = [Sample(s.counter, s.time_s, turned_at_rest(s.body, tree)) for s in samples]
    source = live(rest="t_pose")
    source.rate_hz = 60.0
    with pytest.raises(
        ImitorError, match="where no bone is turned, the bones are no upright human: set rest: t_pose"
    ):
        wrong = live()
        wrong.rate_hz = 60.0
        wrong.learn(samples)
    with pytest.raises(ImitorError, match="none of 20 instants at the start is a T-pose; stand upright"):
        source.learn(samples[-40:-20])
    source.learn(samples[20:n])  # from when the arms are out
    position, orientation = frames_of(moving, 90)
    got = [source.human(s, 0.0) for s in samples[n:]]
    roles = [ROLE_INDEX[r] for r in source.skeleton.roles]
    assert len(got) <= 90
    last = len(got)
    np.testing.assert_allclose(
        np.stack([f.position for f in got])[:, roles], position[:last, roles], atol=1e-6
    )
    np.testing.assert_allclose(
        np.stack([known(f.orientation) for f in got])[:, roles], orientation[:last, roles], atol=0.03
    )


def test_lost_bones_are_lost_with_what_hangs_on_them() -> None:
    sent = performer("stand")
    samples = decoded(VmcDecoder(), datagrams(VmcOsc, sent, 40))
    source = live()
    source.rate_hz = 60.0
    source.learn(samples)
    body = samples[0].body
    bones = body.bones.copy()
    bones[BONES.index("LeftUpperArm")] = np.nan
    bones[BONES.index("RightLowerLeg"), 3:] = 0.0
    frame = source.human(Sample(0, 0.0, VmcPose(bones, body.root)), 0.0)
    lost = {r for r in source.skeleton.roles if not frame.valid[ROLE_INDEX[r]]}
    assert lost == {"left_shoulder", "left_elbow", "left_wrist", "left_hand", "right_ankle", "right_toe"}


def test_a_stream_without_a_body_is_refused() -> None:
    source = live()
    source.rate_hz = 60.0
    with pytest.raises(ImitorError, match="no bone 'Hips' was told: does the sender send an avatar's bones"):
        source.learn(decoded(VmcDecoder(), [bone("Head"), STATE] * 5))
    with pytest.raises(ImitorError, match=r"the avatar has no bone LeftUpperArm, .*; a body needs them"):
        source.learn(decoded(VmcDecoder(), [bone("Hips"), STATE] * 5))


def test_over_a_bad_network() -> None:
    check_over_a_bad_network(VmcOsc, performer(rate_hz=100.0))


def test_over_a_socket() -> None:
    with heard(VmcOsc, performer(rate_hz=100.0), learn_s=0.4) as source:
        assert source.rate_hz == pytest.approx(100.0, rel=0.1)
        frames = [f for f, _ in zip(source.frames(), range(20), strict=False)]
        assert len(frames) == 20
        assert all(f.valid[[ROLE_INDEX[r] for r in source.skeleton.roles]].all() for f in frames)
        assert source.reception.malformed == source.reception.foreign == 0


def test_messages_that_are_too_many_for_a_packet_are_divided() -> None:
    packets = bundles([text("/" + "a" * 300)] * 10)
    assert [len(p) for p in packets] == [16 + 4 * 308, 16 + 4 * 308, 16 + 2 * 308]
