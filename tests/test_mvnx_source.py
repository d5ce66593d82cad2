"""The MVNX source on small files of both versions, of which everything is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imitor import testing
from imitor.errors import SourceError
from imitor.human.rotations import about_x, about_y, about_z
from imitor.motion.mvnx_body import matrices
from imitor.motion.mvnx_file import CONTACTS, SEGMENTS
from imitor.plugins.sources.mvnx import Mvnx, MvnxConfig
from imitor.types import ROLE_INDEX, SIDES
from known import known

Array = NDArray[np.float64]

CENTRE = {"Pelvis": 0.92, "L5": 1.02, "L3": 1.12, "T12": 1.21, "T8": 1.3, "Neck": 1.42, "Head": 1.51}
LEFT = {
    "Shoulder": (0, 0.03, 1.37), "UpperArm": (0, 0.16, 1.37), "ForeArm": (0, 0.44, 1.37), "Hand": (0, 0.67, 1.37),
    "UpperLeg": (0, 0.08, 0.92), "LowerLeg": (0, 0.08, 0.51), "Foot": (0, 0.08, 0.08), "Toe": (0.14, 0.08, 0.0),
}  # fmt: skip
POINTS = {
    ("Head", "pTopOfHead"): (0, 0, 0.17),
    **{(f"{s}Foot", f"p{s}HeelFoot"): (-0.04, 0, -0.095) for s in ("Left", "Right")},
    **{(f"{s}Toe", f"p{s}Toe"): (0.06, 0, -0.015) for s in ("Left", "Right")},
}
ISB = {  # how version 3 turns the axes of the arms
    "RightUpperArm": (0.5**0.5, -(0.5**0.5), 0, 0),
    "RightForeArm": (0.5, -0.5, 0.5, 0.5),
    "RightHand": (0.5, -0.5, 0.5, 0.5),
    "LeftUpperArm": (0.5**0.5, 0.5**0.5, 0, 0),
    "LeftForeArm": (0.5, 0.5, 0.5, -0.5),
    "LeftHand": (0.5, 0.5, 0.5, -0.5),
}
ARM = ("UpperArm", "ForeArm", "Hand")
N_FRAMES = 30


def t_pose() -> Array:
    """Return the segment origins of a T-pose, shape (23, 3) [m]."""
    out = np.zeros((len(SEGMENTS), 3))
    for i, name in enumerate(SEGMENTS):
        if name in CENTRE:
            out[i] = 0.0, 0.0, CENTRE[name]
        else:
            side = "Left" if name.startswith("Left") else "Right"
            out[i] = LEFT[name[len(side) :]] * np.array([1.0, 1.0 if side == "Left" else -1.0, 1.0])
    return out


def quaternion(R: Array) -> Array:
    """Return w x y z of a rotation, shape (4,)."""
    _, v = np.linalg.eigh(
        np.array(
            [
                [np.trace(R), R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
                [R[2, 1] - R[1, 2], R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
                [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1]],
                [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1]],
            ]
        )
    )
    return np.asarray(v[:, -1] * np.where(v[0, -1] < 0.0, -1.0, 1.0))


def posed(heading: float, lowered: float) -> tuple[Array, Array]:
    """Return a person turned about the vertical with the left arm lowered: origins (23, 3) and rotations (23, 3, 3)."""
    turn, lower = about_z(np.array([heading]))[0], about_x(np.array([-lowered]))[0]
    place, rotation = t_pose(), np.tile(np.eye(3), (len(SEGMENTS), 1, 1))
    shoulder = place[SEGMENTS.index("LeftUpperArm")].copy()
    for name in ARM:
        i = SEGMENTS.index(f"Left{name}")
        place[i], rotation[i] = shoulder + lower @ (place[i] - shoulder), lower
    return place @ turn.T, turn @ rotation


def small_mvnx(
    version: str = "4", *, heading: float = 0.0, rest_heading: float = 0.0, lift: float = 0.0,
    indices: list[int] | None = None, points: bool = True, configuration: str = "FullBody", contacts: bool = True,
) -> str:  # fmt: skip
    """Return the text of a person who lowers the left arm from a T-pose by a radian."""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="{version}">',
    ]
    lines.append(
        f'<subject label="a" frameRate="60" segmentCount="23" configuration="{configuration}"><segments>'
    )
    tag = "pos_b" if version == "4" else "pos_s"
    for i, name in enumerate(SEGMENTS, start=1):
        own = [(p, v) for (s, p), v in POINTS.items() if s == name and points]
        inside = "".join(f'<point label="{p}"><{tag}>{v[0]} {v[1]} {v[2]}</{tag}></point>' for p, v in own)
        lines.append(f'<segment label="{name}" id="{i}"><points>{inside}</points></segment>')
    lines.append("</segments>")
    if contacts:
        defined = "".join(f'<contactDefinition label="{c}" index="{i}"/>' for i, c in enumerate(CONTACTS))
        lines.append(f"<footContactDefinition>{defined}</footContactDefinition>")
    lines.append("<frames>")

    def frame(kind: str, index: int, place: Array, rotation: Array) -> None:
        own = {n: matrices(np.array(q, dtype=float)) for n, q in ISB.items()} if version == "3" else {}
        q = [quaternion(R @ own.get(n, np.eye(3))) for n, R in zip(SEGMENTS, rotation, strict=True)]
        lines.append(f'<frame time="{round(index / 60 * 1000)}" index="{index}" type="{kind}">')
        lines.append("<orientation>" + " ".join(f"{v:.9f}" for v in np.concatenate(q)) + "</orientation>")
        lines.append("<position>" + " ".join(f"{v:.9f}" for v in place.ravel()) + "</position>")
        if kind == "normal":
            lines.append(f"<centerOfMass>0.01 0.02 {0.95 + lift}</centerOfMass>")
            lines.append("<footContacts>1 1 0 0</footContacts>" if contacts else "")
        lines.append("</frame>")

    rest_place, rest_rotation = posed(rest_heading, 0.0)
    null = np.tile(np.eye(3), (len(SEGMENTS), 1, 1))
    frame("npose" if version == "3" else "identity", -3, t_pose(), null)
    frame("tpose", -2, rest_place, rest_rotation)
    for k, index in enumerate(indices or range(N_FRAMES)):
        place, rotation = posed(heading, k / (N_FRAMES - 1))
        frame("normal", index, place + np.array([0.0, 0.0, lift + 0.015]), rotation)
    return "\n".join([*lines, "</frames></subject></mvnx>"]) + "\n"


def small_mvnx_options(folder: Path) -> dict[str, Any]:
    """Write the person to a file; return the options that read it."""
    (folder / "person.mvnx").write_text(small_mvnx())
    return {"path": str(folder / "person.mvnx")}


def read(folder: Path, text: str, **options: Any) -> Mvnx:
    (folder / "clip.mvnx").write_text(text)
    source = Mvnx(MvnxConfig(path=str(folder / "clip.mvnx"), **options))
    source.start()
    return source


def roles(source: Mvnx, name: str) -> Array:
    return source.recording.position[:, ROLE_INDEX[name]]


@pytest.mark.parametrize("version", ["3", "4"])
def test_it_keeps_the_contract_of_a_source(tmp_path: Path, version: str) -> None:
    (tmp_path / "clip.mvnx").write_text(small_mvnx(version))
    testing.check_component(Mvnx, {"path": str(tmp_path / "clip.mvnx")})


@pytest.mark.parametrize("rest_heading", [0.0, 2.0])
@pytest.mark.parametrize("version", ["3", "4"])
def test_orientations_are_relative_to_a_t_pose_that_faces_x(
    tmp_path: Path, version: str, rest_heading: float
) -> None:
    source = read(tmp_path, small_mvnx(version, heading=0.7, rest_heading=rest_heading))
    turn = about_z(np.array([0.7]))[0]
    lowered = about_x(-np.linspace(0.0, 1.0, N_FRAMES))
    for name, wanted in (
        ("pelvis", turn), ("head", turn), ("left_ankle", turn), ("right_shoulder", turn), ("right_wrist", turn),
        ("left_shoulder", turn @ lowered), ("left_elbow", turn @ lowered), ("left_wrist", turn @ lowered),
    ):  # fmt: skip
        found = known(source.recording.orientation)[:, ROLE_INDEX[name]]
        np.testing.assert_allclose(found, np.broadcast_to(wanted, found.shape), atol=1e-5)
    rest = source.skeleton.rest_position
    assert rest[ROLE_INDEX["left_wrist"]].tolist() == pytest.approx([0.0, 0.67, 1.37 + 0.015], abs=1e-6)


@pytest.mark.parametrize("version", ["3", "4"])
def test_points_of_segments_turn_with_them(tmp_path: Path, version: str) -> None:
    source = read(tmp_path, small_mvnx(version, heading=0.7))
    turn = about_z(np.array([0.7]))[0]
    ankle, head = roles(source, "right_ankle"), roles(source, "head")
    np.testing.assert_allclose(roles(source, "right_heel"), ankle + turn @ (-0.04, 0, -0.095), atol=1e-6)
    np.testing.assert_allclose(roles(source, "head_top"), head + np.array([0.0, 0.0, 0.17]), atol=1e-6)
    forearm = roles(source, "left_wrist") - roles(source, "left_elbow")
    hand = roles(source, "left_hand") - roles(source, "left_wrist")
    np.testing.assert_allclose(hand, forearm * 0.05 / 0.146, atol=1e-5)


def test_facts_of_the_skeleton(tmp_path: Path) -> None:
    skeleton = read(tmp_path, small_mvnx()).skeleton
    assert skeleton.height_m == pytest.approx(1.51 + 0.17 + 0.015)
    assert skeleton.ankle_height_m == pytest.approx(0.095)
    assert skeleton.toe_height_m == pytest.approx(0.015)
    assert len(skeleton.roles) == 25
    bare = read(tmp_path, small_mvnx(points=False)).skeleton
    assert not bare.has("left_heel")
    assert bare.height_m == pytest.approx(1.7, abs=0.05)
    assert bare.toe_height_m > 0.0


@pytest.mark.parametrize("lift", [0.0, 0.5, -0.9])
def test_the_floor_is_where_the_feet_in_contact_stand(tmp_path: Path, lift: float) -> None:
    source = read(tmp_path, small_mvnx(lift=lift))
    assert source.recording.facts["floor_m"] == pytest.approx(lift, abs=1e-6)
    assert source.recording.com is not None
    np.testing.assert_allclose(source.recording.com, [[0.01, 0.02, 0.95]] * N_FRAMES, atol=1e-6)
    kept = read(tmp_path, small_mvnx(lift=lift), floor="file")
    np.testing.assert_allclose(
        kept.recording.position[..., 2], source.recording.position[..., 2] + lift, atol=1e-6
    )
    assert read(tmp_path, small_mvnx(lift=lift), floor=0.2).recording.facts["floor_m"] == 0.2


def test_contacts_become_support(tmp_path: Path) -> None:
    frame = next(read(tmp_path, small_mvnx()).frames())
    assert frame.support is not None
    assert (frame.support.left, frame.support.right) == (True, False)
    assert next(read(tmp_path, small_mvnx(contacts=False)).frames()).support is None


def test_dropped_frames_are_lost(tmp_path: Path) -> None:
    source = read(tmp_path, small_mvnx(indices=[5, 6, 9, 10]))
    assert source.n_frames == 6
    assert source.recording.valid.any(axis=1).tolist() == [True, True, False, False, True, True]
    frames = list(source.frames())
    assert [f.com is None for f in frames] == [False, False, True, True, False, False]
    assert "2 of 6 frames are missing in the file: lost" in source.skeleton.notes


def test_legs_of_an_upper_body_recording_are_lost(tmp_path: Path) -> None:
    text = small_mvnx(configuration="UpperBody", lift=-0.9)
    source = read(tmp_path, text)
    for side in SIDES:
        assert source.skeleton.has(f"{side}_ankle")
        assert not source.recording.valid[:, ROLE_INDEX[f"{side}_ankle"]].any()
        assert source.recording.valid[:, ROLE_INDEX[f"{side}_hip"]].all()
    assert roles(source, "pelvis")[0, 2] == pytest.approx(0.935)
    frame = next(source.frames())
    assert frame.com is None
    assert frame.support is None
    assert read(tmp_path, text, legs="recorded").recording.valid.all(axis=0).sum() == 25
    assert not read(tmp_path, small_mvnx(), legs="unknown").recording.valid[:, ROLE_INDEX["left_knee"]].any()


def test_a_part_is_read(tmp_path: Path) -> None:
    whole, part = read(tmp_path, small_mvnx()), read(tmp_path, small_mvnx(), start_s=0.1, stop_s=0.2)
    np.testing.assert_array_equal(part.recording.position, whole.recording.position[6:13])


def test_files_are_recognised(tmp_path: Path) -> None:
    for name, text, wanted in (
        ("a.mvnx", "", True),
        ("a.xml", small_mvnx(), True),
        ("b.xml", "<mujoco/>", False),
    ):
        (tmp_path / name).write_text(text)
        assert Mvnx.recognises(tmp_path / name) is wanted
    assert not Mvnx.recognises(tmp_path / "nowhere.xml")


def test_rotations_of_quaternions() -> None:
    for R in (about_x(np.array([0.4]))[0], about_y(np.array([-1.0]))[0] @ about_z(np.array([2.0]))[0]):
        np.testing.assert_allclose(matrices(quaternion(R)), R, atol=1e-12)


GOOD = small_mvnx()
LINES = GOOD.split("\n")
SUBJECT = 3


def line_of(word: str, nth: int = 0) -> int:
    return [i for i, text in enumerate(LINES, start=1) if word in text][nth]


def changed(word: str, old: str, new: str, nth: int = 0) -> str:
    """Return the file with one thing changed in the nth line that holds a word."""
    i = line_of(word, nth) - 1
    assert old in LINES[i]
    return "\n".join([*LINES[:i], LINES[i].replace(old, new, 1), *LINES[i + 1 :]])


BROKEN: dict[str, tuple[str, str]] = {
    "empty": ("\n", ": the file is empty"),
    "binary": ("\0\1" * 50, ": is not a text file, so not MVNX"),
    "no XML": ("HIERARCHY\n", ":1: is no well-formed XML: syntax error"),
    "another XML": ("<mujoco/>", ":1: an MVNX file begins with <mvnx>, this one with <mujoco>"),
    "an unknown version": (
        changed('version="4"', 'version="4"', 'version="2"'),
        ":2: MVNX version '2' is unknown; known are 3 and 4. Export the recording again with a current MVN",
    ),
    "cut off": (
        "\n".join(LINES[: line_of("<position>", 5)]),
        f":{line_of('<position>', 5)}: the file ends inside <frame>: it is cut off; export or copy it again",
    ),
    "cut off in a number": (
        GOOD[: GOOD.index("<position>", 9000) + 50],
        f":{GOOD[: GOOD.index('<position>', 9000) + 50].count(chr(10)) + 1}: the file ends inside <position>: it is "
        "cut off; export or copy it again",
    ),
    "a tag not closed": (
        changed("<position>", "</position>", ""),
        f":{line_of('<position>') + 1}: is no well-formed XML: mismatched tag",
    ),
    "segments missing": (
        "\n".join(t for t in LINES if 'label="LeftToe"' not in t and 'label="T8"' not in t),
        f":{SUBJECT}: the file has no segment T8, LeftToe; a body has the 23 from Pelvis to LeftToe",
    ),
    "no frame rate": (
        changed("frameRate", 'frameRate="60"', 'frameRate="0"'),
        f":{SUBJECT}: frameRate is '0'; frames per second are greater than 0",
    ),
    "too few numbers": (
        changed("<position>", "<position>0.000000000 ", "<position>"),
        f":{line_of('<position>')}: <position> has 68 numbers, 23 segments need 69",
    ),
    "a word": (
        changed("<position>", "<position>0.000000000", "<position>nought"),
        f":{line_of('<position>')}: value 1 of <position> is 'nought', not a finite number",
    ),
    "not finite": (
        changed("<centerOfMass>", "0.02", "nan"),
        f":{line_of('<centerOfMass>')}: value 2 of <centerOfMass> is 'nan', not a finite number",
    ),
    "no orientations": (
        "\n".join(t for t in LINES if "<orientation>" not in t),
        f":{line_of('<frame time')}: this frame of type identity has no <orientation>; export orientations of the "
        "segments, too",
    ),
    "no unit quaternion": (
        changed("<orientation>", "<orientation>1", "<orientation>3", 2),
        f":{line_of('<orientation>', 2)}: quaternion 1 of <orientation> has length 3.000, not 1",
    ),
    "only calibration poses": (
        GOOD.replace('type="normal"', 'type="tpose-isb"'),
        ": holds no frame of a motion (type normal), only: identity, tpose, tpose-isb",
    ),
    "no calibration pose": (
        GOOD.replace('type="tpose"', 'type="other"').replace('type="identity"', 'type="other"'),
        ": holds no calibration pose (a frame of type tpose, identity, npose), which tells how the segments' axes lie; "
        "export again with the calibration poses",
    ),
    "contacts of three": (
        changed("<footContacts>", "1 1 0 0", "1 1 0"),
        f":{line_of('<footContacts>')}: <footContacts> has 3 numbers, 4 are defined",
    ),
    "an entity": (
        '<!DOCTYPE mvnx [<!ENTITY a "b">]>\n' + GOOD.split("\n", 1)[1],
        ":1: declares the entity 'a'; MVNX has none: refused",
    ),
    "two persons": (
        GOOD.replace("</mvnx>", '<subject label="b"/></mvnx>'),
        f":{len(LINES) - 1}: a second subject; write one file a person",
    ),
    "nothing in the part": (GOOD, ": no frame lies between 9 s and its end; the motion lasts 0.483 s"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_said_about_a_broken_file(tmp_path: Path, case: str) -> None:
    text, message = BROKEN[case]
    with pytest.raises(SourceError) as error:
        read(tmp_path, text, **({"start_s": 9.0} if case == "nothing in the part" else {}))
    assert str(error.value) == f"{tmp_path / 'clip.mvnx'}{message}"


def test_what_is_said_about_files_that_are_not_there(tmp_path: Path) -> None:
    for path, message in (
        (tmp_path, "is a folder; give an MVNX file"),
        (tmp_path / "no.mvnx", "there is no such file"),
    ):
        with pytest.raises(SourceError) as error:
            Mvnx(MvnxConfig(path=str(path))).start()
        assert str(error.value) == f"{path}: {message}"


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.binary(min_size=1, max_size=4))
def test_damage_is_read_or_refused_with_a_message(
    tmp_path_factory: pytest.TempPathFactory, at: int, junk: bytes
) -> None:
    data = GOOD.encode()
    k = at % len(data)
    file = tmp_path_factory.getbasetemp() / "damaged.mvnx"
    file.write_bytes(data[:k] + junk + data[k + len(junk) :])
    source = Mvnx(MvnxConfig(path=str(file)))
    try:
        source.start()
    except SourceError as error:
        assert str(error).startswith(str(file))
    else:
        assert np.isfinite(source.recording.position[source.recording.valid]).all()
