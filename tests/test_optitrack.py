"""NatNet: messages read by an independent client, versions, bodies, the handshake, and what is wrong."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imitor import testing
from imitor.errors import ImitorError, SourceError
from imitor.human.rotations import about_x, about_y, about_z
from imitor.live.natnet import CONNECT, FRAME, KEEPALIVE, MODELDEF, REQUEST_MODELDEF, SERVERINFO, message, who
from imitor.live.natnet_decoder import NatNetDecoder, NatNetPose
from imitor.live.natnet_frame import BODY, read_frame, read_marker_sets
from imitor.live.natnet_model import Bone, SkeletonModel, read_model
from imitor.live.natnet_sender import NatNetEncoder
from imitor.live.quaternions import quaternions, rotations
from imitor.live.sample import Foreign, Malformed, Sample
from imitor.plugins.sources.optitrack import Optitrack, OptitrackConfig
from imitor.plugins.sources.performer import Performer
from imitor.types import ROLE_INDEX, HumanFrame
from known import known
from live_people import check_over_a_bad_network, heard
from live_streams import datagrams, decoded, performer, received, taken

Array = NDArray[np.float64]
VERSIONS = [(2, 6), (2, 7), (2, 9), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1)]


def live(**options: Any) -> Optitrack:
    return Optitrack(OptitrackConfig(port=0, **options))


def frame_of(source: Any, i: int = 5) -> HumanFrame:
    frame: HumanFrame = next(islice(source.frames(), i, None))
    return frame


SENT = performer("wave")
INFO, MODEL, GOOD = NatNetEncoder(SENT.skeleton, 60.0).encode(frame_of(SENT), 0)


def ready() -> NatNetDecoder:
    decoder = NatNetDecoder()
    assert decoder.decode(INFO) is decoder.decode(MODEL) is None
    return decoder


# ---------------------------------------------------------------- bytes


@pytest.mark.parametrize("version", VERSIONS)
def test_an_independent_client_reads_the_same(version: tuple[int, int]) -> None:
    pytest.importorskip("natnet")
    from natnet.data_descriptions import DataDescriptions
    from natnet.data_frame import DataFrame
    from natnet.packet_buffer import PacketBuffer
    from natnet.server_info import ServerInfo
    from natnet.version import Version

    info, model, frame = NatNetEncoder(SENT.skeleton, 60.0, version).encode(frame_of(SENT), 0)
    for packet, number in ((info, SERVERINFO), (model, MODELDEF), (frame, FRAME)):
        assert struct.unpack("<HH", packet[:4]) == (number, len(packet) - 4)
    theirs = ServerInfo.read_from_buffer(PacketBuffer(info[4:]), None)
    assert theirs.nat_net_protocol_version == Version(*version)
    buffer = PacketBuffer(model[4:])
    (skeleton,) = DataDescriptions.read_from_buffer(buffer, Version(*version)).skeletons
    assert buffer.pointer == len(model) - 4
    (ours,) = read_model(model[4:], version).skeletons
    assert (skeleton.name, skeleton.id_num) == (ours.name, ours.number)
    bones = [(b.id_num, b.name, b.parent_id) for b in skeleton.rigid_body_descriptions]
    assert sorted(bones) == sorted((b.number, b.name, b.parent) for b in ours.bones)
    assert len(bones) == 21
    buffer = PacketBuffer(frame[4:])
    data = DataFrame.read_from_buffer(buffer, Version(*version))
    assert len(frame) - 4 - buffer.pointer == (
        4 if version < (4, 1) else 12
    )  # it leaves the end, and precision time
    got = read_frame(frame[4:], version)
    assert (got.number, got.time_s) == (data.prefix.frame_number, data.suffix.timestamp)
    assert got.time_s == pytest.approx(5 / 60, abs=1e-6)
    assert data.skeletons[0].id_num == 1
    for a, b in zip(data.skeletons[0].rigid_bodies, got.skeletons[1], strict=True):
        assert (a.id_num, a.tracking_valid) == (b["id"], b["params"] & 1)
        assert (a.pos, a.rot) == (tuple(b["position"]), tuple(b["quaternion"]))


def section(version: tuple[int, int], n: int, content: bytes) -> bytes:
    return struct.pack("<i", n) + (struct.pack("<I", len(content)) if version >= (4, 1) else b"") + content


def everything(version: tuple[int, int]) -> bytes:
    """Return a frame written by hand in which every section holds something."""

    def body(number: int) -> bytes:
        out = struct.pack("<i3f4f", number, 1, 2, 3, 0, 0, 0, 1)
        if version < (3, 0):
            out += (
                struct.pack("<i", 2)
                + struct.pack("<6f", *range(6))
                + struct.pack("<2i", 7, 8)
                + struct.pack("<2f", 0.1, 0.2)
            )
        out += struct.pack("<f", 0.001)
        return out + (struct.pack("<h", 1) if version >= (2, 6) else b"")

    def marker(number: int) -> bytes:
        out = struct.pack("<i3ff", number, 4, 5, 6, 0.01)
        out += struct.pack("<h", 2) if version >= (2, 6) else b""
        return out + (struct.pack("<f", 0.002) if version >= (3, 0) else b"")

    device = struct.pack("<ii", 1, 2) + struct.pack("<i2f", 2, 0.1, 0.2) + struct.pack("<if", 1, 0.3)
    out = struct.pack("<i", 42)
    out += section(version, 1, b"all\0" + struct.pack("<i", 2) + struct.pack("<6f", *range(6)))
    out += section(version, 1, struct.pack("<3f", 7, 8, 9))
    out += section(version, 2, body(1) + body(2))
    if version >= (2, 1):
        out += section(version, 1, struct.pack("<ii", 3, 2) + body(3 << 16 | 1) + body(3 << 16 | 2))
    if version >= (4, 1):
        out += section(version, 1, b"an asset of some kind")
    if version >= (2, 3):
        out += section(version, 2, marker(1 << 16 | 1) + marker(1 << 16 | 2))
    for since in ((2, 9), (2, 11)):
        if version >= since:
            out += section(version, 1, device)
    out += struct.pack("<II", 0, 0) + struct.pack("<d" if version >= (2, 7) else "<f", 1.5)
    out += struct.pack("<QQQ", 1, 2, 3) if version >= (3, 0) else b""
    out += struct.pack("<II", 4, 5) if version >= (4, 1) else b""
    return out + struct.pack("<hi", 2, 0)


@pytest.mark.parametrize("version", [(2, 0), (2, 1), (2, 3), *VERSIONS])
def test_every_section_is_stepped_over(version: tuple[int, int]) -> None:
    raw = everything(version)
    frame = read_frame(raw, version)
    assert (frame.number, frame.time_s, frame.models_changed) == (42, 1.5, True)
    if version >= (2, 1):
        assert frame.skeletons[3]["id"].tolist() == [3 << 16 | 1, 3 << 16 | 2]
        np.testing.assert_array_equal(frame.skeletons[3]["position"], [[1, 2, 3]] * 2)
        assert frame.skeletons[3]["params"].tolist() == [1, 1]
    if version >= (2, 3):
        np.testing.assert_array_equal(frame.markers["position"], [[4, 5, 6]] * 2)
    for cut in range(0, len(raw) - 4, 3):  # the last four bytes are the end
        with pytest.raises((Malformed, struct.error)):
            read_frame(raw[:cut], version)


def test_descriptions_of_other_things_are_stepped_over() -> None:
    v = (3, 1)
    markers = struct.pack("<i", 1) + struct.pack("<3fi", 1, 2, 3, 0)
    sets = struct.pack("<i", 0) + b"walker\0" + struct.pack("<i", 2) + b"LASI\0RASI\0"
    rigid = struct.pack("<i", 1) + b"box\0" + struct.pack("<ii3f", 5, -1, 0, 0, 0) + markers
    child = b"Ab\0" + struct.pack("<ii3f", 2, 1, 0, 0, 0) + markers
    root = b"Hip\0" + struct.pack("<ii3f", 1, 0, 0, 0, 0) + markers
    skeleton = struct.pack("<i", 2) + b"A\0" + struct.pack("<ii", 9, 2) + child + root
    plate = struct.pack("<i", 3) + b"of whatever form"
    model = read_model(struct.pack("<i", 4) + sets + rigid + skeleton + plate, v)
    assert model.marker_sets == {"walker": ("LASI", "RASI")}
    assert model.skeletons == (SkeletonModel(9, "A", (Bone(1, "Hip", 0), Bone(2, "Ab", 1))),)


CIRCLE = struct.pack("<ii", 1, 2) + b"A\0" + struct.pack("<ii", 1, 2)
CIRCLE += b"".join(b"x\0" + struct.pack("<ii3fi", i, 3 - i, 0, 0, 0, 0) for i in (1, 2))
TWINS = struct.pack("<ii", 1, 2) + b"A\0" + struct.pack("<ii", 1, 2)
TWINS += b"".join(b"x\0" + struct.pack("<ii3fi", 1, 0, 0, 0, 0, 0) for _ in range(2))


@pytest.mark.parametrize(
    ("packet", "what"),
    [
        (b"", Foreign),
        (b"abc", Foreign),
        (b"MXTP02" + b"\0" * 30, Foreign),
        (GOOD[:99], Malformed),
        (message(FRAME, b"\0" * 6), struct.error),
        (message(FRAME, struct.pack("<iii", 1, 2**30, 0)), Malformed),
        (message(FRAME, struct.pack("<iii", 1, -1, 0)), Malformed),
        (message(SERVERINFO, b"x" * 100), Malformed),
        (message(SERVERINFO, who("x", (9, 0))), Malformed),
        (message(MODELDEF, CIRCLE), Malformed),
        (message(MODELDEF, TWINS), Malformed),
        (message(MODELDEF, struct.pack("<ii", 1, 0) + b"a" * 300), Malformed),
    ],
)  # fmt: skip
def test_datagrams_of_no_use_are_refused(packet: bytes, what: type[Exception]) -> None:
    with pytest.raises(what):
        ready().decode(packet)


def test_what_is_wrong_is_counted() -> None:
    encoder = NatNetEncoder(SENT.skeleton, 60.0)
    packets = [encoder.encode(frame_of(SENT), i)[-1] for i in range(10)]
    order = [packets[0], packets[1], packets[1], packets[3], packets[2], GOOD[:99], b"junk", packets[6]]
    assert taken(ready(), order).reception.figures() == {
        "datagrams": 8, "malformed": 1, "foreign": 1, "samples": 4, "duplicated": 1, "reordered": 1, "lost": 2,
        "restarts": 0,
    }  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_no_datagram_does_harm(data: st.DataObject) -> None:
    version = data.draw(st.sampled_from([(2, 6), (3, 1), (4, 1)]))
    good = NatNetEncoder(SENT.skeleton, 60.0, version).encode(frame_of(SENT), 0)
    packet = bytearray(
        data.draw(st.sampled_from([*good, message(FRAME, everything(version)), message(MODELDEF, CIRCLE)]))
    )
    for at in data.draw(st.lists(st.integers(0, len(packet) - 1), max_size=6)):
        packet[at] = data.draw(st.integers(0, 255))
    cut = bytes(packet[: data.draw(st.integers(0, len(packet)))])
    receiver = taken(NatNetDecoder(), [*good[:2], bytes(packet), cut, *good])
    r = receiver.reception
    assert r.datagrams == 7
    assert r.malformed + r.foreign <= 2
    arrival = receiver.box.take()
    if arrival is not None:
        assert len(arrival.sample.body.bodies) < 1000


# ---------------------------------------------------------------- there and back


def check_same(sent: Any, source: Optitrack, got: list[HumanFrame], within: float = 1e-6) -> None:
    roles = [ROLE_INDEX[r] for r in source.skeleton.roles]
    assert len(roles) == 18
    frames = list(islice(sent.frames(), len(got)))
    for f, g in zip(frames, got, strict=True):
        np.testing.assert_allclose(g.position[roles], f.position[roles], atol=within)
        np.testing.assert_allclose(known(g.orientation)[roles], known(f.orientation)[roles], atol=within)


def test_the_performer_streamed_is_the_performer() -> None:
    sent = performer()
    source = live()
    got = received(source, sent, 200, learn=60)
    assert len(got) == 200
    check_same(sent, source, got)
    roles = [ROLE_INDEX[r] for r in source.skeleton.roles]
    np.testing.assert_allclose(
        source.skeleton.rest_position[roles], sent.skeleton.rest_position[roles], atol=5e-3
    )
    assert source.skeleton.height_m == pytest.approx(1.75, abs=0.02)
    assert source.skeleton.name == "motive"
    testing.check_frames(Optitrack, got, source.skeleton, sent.rate_hz)


def samples_of(sent: Any, n: int) -> list[Sample]:
    return decoded(NatNetDecoder(), datagrams(Optitrack, sent, n))


def changed(sample: Sample, position: Array, turn: Array) -> Sample:
    pose = sample.body
    bodies = pose.bodies.copy()
    q = quaternions(turn)
    bodies["position"], bodies["quaternion"] = position, q[:, [1, 2, 3, 0]]
    return Sample(sample.counter, sample.time_s, NatNetPose(pose.model, bodies))


def poses_of(sample: Sample) -> tuple[Array, Array]:
    bodies = sample.body.bodies
    return bodies["position"].astype(float), rotations(bodies["quaternion"].astype(float)[:, [3, 0, 1, 2]])


def learned(source: Optitrack, samples: list[Sample]) -> Optitrack:
    source.rate_hz = 60.0
    source.learn(samples)
    return source


def test_bones_in_their_parents_are_the_same_person() -> None:
    sent = performer()
    samples = samples_of(sent, 60)
    numbers = (samples[0].body.bodies["id"] & 0xFFFF).tolist()
    parent = {b.number: b.parent for b in samples[0].body.model.bones}
    row = [numbers.index(parent[n]) if parent[n] in numbers else -1 for n in numbers]
    local = []
    for s in samples:
        place, turn = poses_of(s)
        above = np.where(np.array(row)[:, None, None] < 0, np.eye(3), np.swapaxes(turn[row], -1, -2))
        origin = np.where(np.array(row)[:, None] < 0, 0.0, place[row])
        local.append(changed(s, (above @ (place - origin)[..., None])[..., 0], above @ turn))
    source = learned(live(coordinates="local"), local)
    check_same(sent, source, [source.human(s, 0.0) for s in local], within=3e-6)


def test_z_up_is_the_same_person_but_for_the_heading() -> None:
    sent = performer()
    tilt = about_x(np.array([np.pi / 2]))[0]  # Motive: (x, y, z) with y up becomes (x, -z, y)
    samples = []
    for s in samples_of(sent, 60):
        place, turn = poses_of(s)
        samples.append(changed(s, place @ tilt.T, tilt @ turn @ tilt.T))
    source = learned(live(up="z"), samples)
    heading = about_z(np.array([np.pi / 2]))[0]
    roles = [ROLE_INDEX[r] for r in source.skeleton.roles]
    for s, f in zip(samples, sent.frames(), strict=False):
        frame = source.human(s, 0.0)
        np.testing.assert_allclose(frame.position[roles] @ heading.T, f.position[roles], atol=1e-6)
        np.testing.assert_allclose(
            heading @ known(frame.orientation)[roles], known(f.orientation)[roles], atol=1e-6
        )


def test_bones_that_are_turned_at_rest_need_a_t_pose() -> None:
    x, y, z = np.random.default_rng(0).uniform(-2, 2, (3, 21))
    own = about_z(z) @ about_y(y) @ about_x(x)
    still, moving = performer("t_pose"), performer("wave")

    def turned(sent: Any, n: int) -> list[Sample]:
        return [changed(s, p, R @ own) for s in samples_of(sent, n) for p, R in (poses_of(s),)]

    with pytest.raises(
        ImitorError, match="where no bone is turned, the bones are no upright human: set rest: t_pose"
    ):
        learned(live(), turned(still, 30))
    source = learned(live(rest="t_pose"), turned(still, 30)[20:])
    got = [source.human(s, 0.0) for s in turned(moving, 60)]
    check_same(moving, source, got, within=0.03)


def test_bones_that_are_not_tracked_are_lost() -> None:
    sent = performer(loss=0.1, seed=2)
    source = live()
    got = received(source, sent, 60)
    for f, g in zip(sent.frames(), got, strict=False):
        for role in ("left_knee", "right_elbow", "head"):
            assert g.valid[ROLE_INDEX[role]] == f.valid[ROLE_INDEX[role]]
    assert not all(g.valid[ROLE_INDEX["left_knee"]] for g in got)


def test_names_of_other_conventions_are_found() -> None:
    fbx = {
        "Hip": "Hips", "Ab": "Spine", "Chest": "Spine1", "Neck": "Neck", "Head": "Head",
        **{
            s[0] + a: s + b for s in ("Left", "Right")
            for a, b in (("Shoulder", "Shoulder"), ("UArm", "Arm"), ("FArm", "ForeArm"), ("Hand", "Hand"),
                         ("Thigh", "UpLeg"), ("Shin", "Leg"), ("Foot", "Foot"), ("Toe", "ToeBase"))
        },
    }  # fmt: skip
    sent = performer()
    samples = []
    for s in samples_of(sent, 60):
        m = s.body.model
        named = SkeletonModel(
            m.number, m.name, tuple(Bone(b.number, f"Anna:{fbx[b.name]}", b.parent) for b in m.bones)
        )
        samples.append(Sample(s.counter, s.time_s, NatNetPose(named, s.body.bodies)))
    source = learned(live(), samples)
    assert source.skeleton.name == "mixamo"
    check_same(sent, source, [source.human(s, 0.0) for s in samples])
    with pytest.raises(SourceError, match="skeleton 'performer': skeleton 'motive' does not fit"):
        learned(live(skeleton="motive"), samples)


# ---------------------------------------------------------------- markers


def marked(**options: Any) -> Any:
    return performer("wave", markers="41", **options)


@pytest.mark.parametrize("version", VERSIONS)
def test_an_independent_client_reads_the_same_markers(version: tuple[int, int]) -> None:
    pytest.importorskip("natnet")
    from natnet.data_descriptions import DataDescriptions
    from natnet.data_frame import DataFrame
    from natnet.packet_buffer import PacketBuffer
    from natnet.version import Version

    sent = marked()
    f = frame_of(sent)
    _, model, frame = NatNetEncoder(sent.skeleton, 60.0, version).encode(f, 0)
    described = DataDescriptions.read_from_buffer(PacketBuffer(model[4:]), Version(*version))
    assert described.marker_sets[0].marker_names == tuple(sent.skeleton.marker_names)
    assert [s.name for s in described.skeletons] == ["performer"]
    (theirs,) = DataFrame.read_from_buffer(PacketBuffer(frame[4:]), Version(*version)).marker_sets
    assert theirs.model_name == "performer"
    np.testing.assert_allclose(np.array(theirs.marker_pos_list)[:, [2, 0, 1]], known(f.marker), atol=1e-6)
    ours = read_marker_sets(frame[4:], version)["performer"]
    np.testing.assert_array_equal(ours, np.array(theirs.marker_pos_list, np.float32))


class MarkersAlone(Performer):
    """A performer of whom nothing but markers is known."""

    gives = frozenset({"markers"})


@pytest.mark.parametrize("kind", [Performer, MarkersAlone])
def test_markers_streamed_are_the_markers(kind: type[Performer]) -> None:
    sent = kind(marked(loss=0.05, seed=3).config)
    sent.start()
    source = live(body="markers")
    got = received(source, sent, 120, learn=60)
    assert len(got) == 120
    assert source.skeleton.name == "cmu_41"
    order = [list(sent.skeleton.marker_names).index(n) for n in source.skeleton.marker_names]
    for f, g in zip(sent.frames(), got, strict=False):
        np.testing.assert_allclose(known(g.marker), known(f.marker)[order], atol=1e-6)
        np.testing.assert_array_equal(g.marker_valid, known(f.marker_valid)[order])
    truth = sent.truth.position
    for role in ("left_knee", "right_elbow", "pelvis", "left_hip"):
        found = np.array([g.position[ROLE_INDEX[role]] for g in got])
        assert np.nanmedian(np.linalg.norm(found - truth[:120, ROLE_INDEX[role]], axis=1)) < 0.02


def test_markers_keep_the_contract_of_a_live_source() -> None:
    testing.check_component(Optitrack, {"body": "markers"})


def test_a_marker_set_that_is_not_there_is_told() -> None:
    decoder = NatNetDecoder("Anna", markers=True)
    for packet in NatNetEncoder(marked().skeleton, 60.0).encode(frame_of(marked()), 0):
        assert decoder.decode(packet) is None
    assert decoder.lacking() == (
        "1 frames came, but without markers of a set that is described ('performer'): tick Labeled Markers in Motive, "
        "or set asset"
    )


# ---------------------------------------------------------------- the handshake


def test_frames_wait_for_version_and_model() -> None:
    decoder = NatNetDecoder()
    assert decoder.decode(GOOD) is None
    assert "did not tell its version" in decoder.lacking()
    assert [p[:2] for p in decoder.requests()] == [struct.pack("<H", CONNECT)]
    assert len(decoder.requests()[0]) == 4 + 264
    assert decoder.decode(MODEL) is None and decoder.model is None
    decoder.decode(INFO)
    assert [p[:2] for p in decoder.requests()] == [
        struct.pack("<H", n) for n in (KEEPALIVE, REQUEST_MODELDEF)
    ]
    assert decoder.decode(GOOD) is None
    assert "did not describe its skeletons" in decoder.lacking()
    decoder.decode(MODEL)
    assert [p[:2] for p in decoder.requests()] == [struct.pack("<H", KEEPALIVE)]
    assert decoder.decode(GOOD) is not None
    decoder.decode(message(FRAME, everything((3, 1))))
    assert len(decoder.requests()) == 2  # the model changed
    other = NatNetDecoder("Anna", (3, 1))
    assert other.decode(MODEL) is other.decode(GOOD) is None
    assert other.lacking() == "1 frames came, but no skeleton is called 'Anna'; there are 'performer'"


@contextlib.contextmanager
def server(sent: Any) -> Iterator[int]:
    """Run a server that answers, and sends frames to whoever asked; yield the port at which it is asked."""
    encoder = NatNetEncoder(sent.skeleton, 10_000.0, (4, 1))
    frames = list(islice(sent.frames(), 100))
    done = threading.Event()

    def run(sock: socket.socket) -> None:
        client, asked = None, set()
        for i in range(1_000_000):
            if done.is_set():
                return
            with contextlib.suppress(TimeoutError):
                datagram, client = sock.recvfrom(65535)
                asked.add(datagram[:2])
                for answer in encoder.answer(datagram):
                    sock.sendto(answer, client)
            if client is not None and i % 10_000:
                f = frames[i % 100]
                told = HumanFrame(i / 100, f.position, f.valid, f.orientation)
                sock.sendto(encoder.encode(told, i)[-1], client)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(0.01)
        thread = threading.Thread(target=run, args=(sock,))
        thread.start()
        try:
            yield sock.getsockname()[1]
        finally:
            done.set()
            thread.join()


def test_a_server_is_asked() -> None:
    sent = performer()
    with server(sent) as port:
        source = live(server="127.0.0.1", command_port=port, learn_s=0.5)
        source.start()
        try:
            frames = [f for f, _ in zip(source.frames(), range(20), strict=False)]
            assert len(frames) == 20
            assert source.skeleton.name == "motive"
            assert source.reception.malformed == source.reception.foreign == 0
        finally:
            source.close()
            source.close()


def test_answers_of_the_server_side() -> None:
    encoder = NatNetEncoder(SENT.skeleton, 60.0)
    assert encoder.answer(message(CONNECT, b"Ping\0")) == (INFO,)
    assert encoder.answer(message(REQUEST_MODELDEF)) == (MODEL,)
    assert encoder.answer(message(KEEPALIVE)) == ()
    assert encoder.answer(message(2, b"FrameRate\0")) == (message(100),)
    assert encoder.answer(b"junk") == encoder.answer(message(CONNECT, b"Ping\0")[:6]) == ()


def test_an_independent_client_is_answered() -> None:
    natnet = pytest.importorskip("natnet")
    sent = performer()
    models: list[Any] = []
    frames: list[Any] = []
    with server(sent) as port:
        client = natnet.NatNetClient("127.0.0.1", "127.0.0.1", command_port=port, use_multicast=False)
        client.on_data_description_received_event.handlers.append(models.append)
        client.on_data_frame_received_event.handlers.append(frames.append)
        with client:
            client.request_modeldef()
            for _ in range(500):
                client.update_sync()
                if models and len(frames) > 5:
                    break
                time.sleep(0.01)
            assert client.server_info.application_name == "imitor"
    assert [s.name for s in models[0].skeletons] == ["performer"]
    assert len(frames) > 5
    assert all(len(f.skeletons[0].rigid_bodies) == 21 for f in frames)


def test_frames_of_a_server_that_is_not_asked_say_what_is_missing() -> None:
    source = live(wait_s=0.3)
    told: list[str] = []

    def start() -> None:
        try:
            source.start()
        except ImitorError as error:
            told.append(str(error))

    starting = threading.Thread(target=start)
    starting.start()
    while (receiver := source.receiver) is None:
        time.sleep(0.001)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for _ in range(5):
            sock.sendto(GOOD, ("127.0.0.1", receiver.port))
    starting.join()
    assert told == [
        "5 frames came, but the sender did not tell its version: set server to the address of Motive, or version"
    ]


def test_a_server_that_is_no_machine_is_told() -> None:
    with pytest.raises(
        ImitorError, match=r"no machine is known as server 'nowhere\.invalid'; give its address"
    ):
        live(server="nowhere.invalid").start()


def test_over_a_bad_network() -> None:
    check_over_a_bad_network(Optitrack, performer(rate_hz=100.0))


def test_over_a_socket() -> None:
    with heard(Optitrack, performer(rate_hz=100.0), learn_s=1.2) as source:
        assert source.rate_hz == pytest.approx(100.0, rel=0.05)
        frames = [f for f, _ in zip(source.frames(), range(20), strict=False)]
        assert len(frames) == 20
        assert all(f.valid[[ROLE_INDEX[r] for r in source.skeleton.roles]].all() for f in frames)
        assert source.reception.malformed == source.reception.foreign == 0


def test_over_multicast() -> None:
    group, sent = "239.255.42.99", performer("stand")
    source = live(multicast=group, wait_s=5.0, learn_s=0.3)
    done = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        encoder = Optitrack.encoder(sent)

        def send() -> None:
            for i in range(100_000):
                if done.wait(0.01):
                    return
                f = frame_of(sent)
                told = HumanFrame(i / 100, f.position, f.valid, f.orientation)
                for packet in encoder.encode(told, i) if source.receiver else ():
                    sock.sendto(packet, (group, source.receiver.port))  # type: ignore[union-attr]

        sending = threading.Thread(target=send)
        sending.start()
        try:
            source.start()
            assert source.skeleton.name == "motive"
        finally:
            done.set()
            sending.join()
            source.close()


def test_items_have_the_sizes_of_the_protocol() -> None:
    assert BODY.itemsize == 38
