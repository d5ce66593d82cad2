"""What is read out of a BVH file, and what is said about a broken one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imitor.errors import SourceError
from imitor.motion.bvh_file import read_bvh
from imitor.motion.kinematics import forward_kinematics

GOOD = """HIERARCHY
ROOT Hips
{
  OFFSET 0 1 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 0.5 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 0.25 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
0 1 0 0 0 0 0 0 0
0 1 0 90 0 0 0 0 0
"""


def written(tmp_path: Path, data: str | bytes) -> Path:
    path = tmp_path / "clip.bvh"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def test_reads_tree_and_motion(tmp_path: Path) -> None:
    bvh = read_bvh(written(tmp_path, GOOD))
    assert [(n.name, n.parent, n.is_end) for n in bvh.nodes] == [
        ("Hips", -1, False),
        ("Spine", 0, False),
        ("", 1, True),
    ]
    assert bvh.motion.shape == (2, 9)
    assert bvh.frame_time_s == 0.0333333
    # Position channels replace the root's offset, and a turn about z takes the spine to -x.
    np.testing.assert_allclose(
        forward_kinematics(bvh.nodes, bvh.motion).position[:, 2], [[0, 1.75, 0], [-0.75, 1, 0]], atol=1e-12
    )


@pytest.mark.parametrize(
    "spelling",
    [
        pytest.param(GOOD.replace("\n", "\r\n").encode(), id="CRLF"),
        pytest.param(GOOD.replace("\n", "\r").encode(), id="CR"),
        pytest.param(b"\xef\xbb\xbf" + GOOD.encode(), id="byte order mark"),
        pytest.param(GOOD.replace("  ", "\t").replace(": ", ":\t").encode(), id="tabs"),
        pytest.param(GOOD.replace("\n{", " {").replace("\n  {", "{").encode(), id="brace on the same line"),
        pytest.param(
            GOOD.replace("0 1 0 0 0 0 0 0 0", "0 1 0\n0 0 0\n0 0 0\n").encode(), id="wrapped numbers"
        ),
        pytest.param(GOOD.replace("\n0 1", "\n\n  0 1").encode() + b"\n\n \n", id="blank lines"),
        pytest.param(GOOD.replace("0 1 0 90", "0e0 1.0E+00 0 9e+01").encode(), id="exponents"),
        pytest.param(GOOD.replace("End Site", "End site").replace("MOTION", "Motion ").encode(), id="case"),
        pytest.param(
            GOOD.replace("Zrotation", "ZROTATION").replace("Xpos", "xpos").encode(), id="channel case"
        ),
        pytest.param(
            GOOD.replace("Frames: 2", "Frames: 2 ").rstrip().encode(), id="trailing blank, no newline"
        ),
        pytest.param(GOOD.replace("OFFSET 0 1 0", "OFFSET 0 1e0 -0.0").encode(), id="offset exponents"),
    ],
)
def test_spellings_that_occur_mean_the_same(tmp_path: Path, spelling: bytes) -> None:
    plain, other = read_bvh(written(tmp_path, GOOD)), read_bvh(written(tmp_path, spelling))
    assert [(n.name, n.parent, n.channels) for n in other.nodes] == [
        (n.name, n.parent, n.channels) for n in plain.nodes
    ]
    assert np.array_equal(other.motion, plain.motion)
    assert all(np.array_equal(a.offset, b.offset) for a, b in zip(other.nodes, plain.nodes, strict=True))


def test_latin_1_names_blanks_and_duplicates_are_kept(tmp_path: Path) -> None:
    text = GOOD.replace("Hips", "Hüfte links").replace("Spine", "Hüfte links")
    assert [n.name for n in read_bvh(written(tmp_path, text.encode("latin-1"))).nodes] == [
        "Hüfte links"
    ] * 2 + [""]


def test_joints_with_one_channel_none_and_no_end_site(tmp_path: Path) -> None:
    text = GOOD.replace("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 1 Yrotation")
    text = text.replace(
        "    End Site\n    {\n      OFFSET 0 0.25 0\n    }\n", "    JOINT Tip { OFFSET 1 0 0 CHANNELS 0 }\n"
    )
    text = text.replace("0 1 0 0 0 0 0 0 0", "0 1 0 0 0 0 0").replace("0 1 0 90 0 0 0 0 0", "0 1 0 0 0 0 90")
    bvh = read_bvh(written(tmp_path, text))
    assert [n.channels for n in bvh.nodes][1:] == [("Yrotation",), ()]
    np.testing.assert_allclose(
        forward_kinematics(bvh.nodes, bvh.motion).position[:, 2], [[1, 1.5, 0], [0, 1.5, -1]], atol=1e-12
    )


def test_a_single_position_channel_replaces_its_axis_only(tmp_path: Path) -> None:
    text = GOOD.replace(
        "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation", "CHANNELS 1 Zposition"
    )
    text = text.replace("0 1 0 0 0 0 0 0 0", "7 0 0 0").replace("0 1 0 90 0 0 0 0 0", "8 0 0 0")
    bvh = read_bvh(written(tmp_path, text))
    assert forward_kinematics(bvh.nodes, bvh.motion).position[:, 0].tolist() == [[0, 1, 7], [0, 1, 8]]


def cut_after(line: int) -> str:
    return "\n".join(GOOD.split("\n")[:line]) + "\n"


BROKEN: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "{path}: the file is empty"),
    "blank": (" \n\n", "{path}: the file is empty"),
    "binary": (b"\x00\x01\x02BVH\x00", "{path}: is not a text file, so not a BVH file"),
    "another format": (
        "ply\nformat ascii",
        "{path}:1: a BVH file begins with HIERARCHY, this one with 'ply'",
    ),
    "no root": ("HIERARCHY\nMOTION\n", "{path}:1: expected ROOT after HIERARCHY, found ''"),
    "cut in the hierarchy": (
        cut_after(8),
        "{path}:7: the '{{' of 'Spine' is never closed; the file is cut off",
    ),
    "cut in an offset": (
        cut_after(7) + "OFFSET 0 0.5",
        "{path}:8: the hierarchy ends where three numbers after OFFSET of 'Spine' is expected",
    ),
    "no motion": (cut_after(15), "{path}:16: the file ends without a MOTION section"),
    "brace missing": (
        GOOD.replace("    }\n  }\n}\n", "    }\n  }\n"),
        "{path}:3: the '{{' of 'Hips' is never closed",
    ),
    "brace too many": (
        GOOD.replace("}\nMOTION", "}\n}\nMOTION"),
        "{path}:16: a '}}' too many: every block is closed already",
    ),
    "no brace": (GOOD.replace("ROOT Hips\n{", "ROOT Hips\n}"), "{path}:2: expected '{{' after ROOT 'Hips'"),
    "two roots": (
        GOOD.replace("}\nMOTION", "}\nROOT Second { OFFSET 0 0 0 CHANNELS 0 }\nMOTION"),
        "{path}:16: a second ROOT 'Second' after 'Hips': one file is one body here; "
        "write each body into a file of its own",
    ),
    "joint outside": (
        GOOD.replace("}\nMOTION", "}\nJOINT Lost { OFFSET 0 0 0 }\nMOTION"),
        "{path}:16: JOINT 'Lost' stands outside the ROOT's braces",
    ),
    "child of an end site": (
        GOOD.replace("OFFSET 0 0.25 0\n", "OFFSET 0 0.25 0\nJOINT Odd { OFFSET 0 0 0 }\n"),
        "{path}:13: JOINT 'Odd' stands inside an End Site, which can have no children",
    ),
    "unknown word": (
        GOOD.replace("JOINT Spine", "JIONT Spine"),
        "{path}:6: expected JOINT, End Site or '}}', found 'JIONT' (unknown words cannot be skipped)",
    ),
    "offset not a number": (
        GOOD.replace("OFFSET 0 0.5 0", "OFFSET 0 half 0"),
        "{path}:8: expected three numbers after OFFSET of 'Spine', found 'half'",
    ),
    "offset not finite": (
        GOOD.replace("OFFSET 0 0.5 0", "OFFSET 0 nan 0"),
        "{path}:8: expected three numbers after OFFSET of 'Spine', found 'nan': "
        "only finite numbers have a meaning",
    ),
    "unknown channel": (
        GOOD.replace("CHANNELS 3 Zrotation", "CHANNELS 3 Zrotatoin"),
        "{path}:9: channel 1 of 3 of 'Spine' is 'Zrotatoin'; legal are Xposition, Yposition, Zposition, "
        "Xrotation, Yrotation, Zrotation; did you mean 'Zrotation'?",
    ),
    "too few channels": (
        GOOD.replace("CHANNELS 3 ", "CHANNELS 4 "),
        "{path}:9: channel 4 of 4 of 'Spine' is 'End'; legal are Xposition, Yposition, Zposition, "
        "Xrotation, Yrotation, Zrotation",
    ),
    "channels without a number": (
        GOOD.replace("CHANNELS 3 ", "CHANNELS "),
        "{path}:9: expected a number of channels of 'Spine', found 'Zrotation'",
    ),
    "position twice": (
        GOOD.replace("Xposition Yposition", "Xposition Xposition"),
        "{path}:5: 'Hips' has the channel Xposition twice",
    ),
    "no Frames": (
        GOOD.replace("Frames: 2\n", ""),
        "{path}:17: expected 'Frames:' in the MOTION section, found 'Frame'",
    ),
    "no Frame Time": (
        GOOD.replace("Frame Time: 0.0333333\n", ""),
        "{path}:18: expected 'Frame Time:' in the MOTION section, found '0'",
    ),
    "Frames not a number": (
        GOOD.replace("Frames: 2", "Frames: two"),
        "{path}:17: 'Frames:' needs a number, found 'two'",
    ),
    "no frames": (
        GOOD.replace("Frames: 2", "Frames: 0"),
        "{path}:17: 'Frames:' is 0; a motion has one frame at least",
    ),
    "infinitely many frames": (
        GOOD.replace("Frames: 2", "Frames: inf"),
        "{path}:17: 'Frames:' is inf; a motion has one frame at least",
    ),
    "too many frames": (
        GOOD.replace("Frames: 2", "Frames: 99999999999"),
        "{path}:17: 99999999999 frames of 9 channels are more than 100000000 numbers",
    ),
    "frame time zero": (
        GOOD.replace("0.0333333", "0"),
        "{path}:18: 'Frame Time:' is 0; the time between frames is greater than 0 s",
    ),
    "frame time with a comma": (
        GOOD.replace("0.0333333", "0,0333"),
        "{path}:18: 'Frame Time:' needs a number, found '0,0333'",
    ),
    "fewer frames than said": (
        GOOD.replace("Frames: 2", "Frames: 3"),
        "{path}:17: 'Frames:' says 3, but the motion holds 2 frames of 9 numbers",
    ),
    "more frames than said": (
        GOOD.replace("Frames: 2", "Frames: 1"),
        "{path}:17: 'Frames:' says 1, but the motion holds 2 frames of 9 numbers",
    ),
    "cut in the last frame": (
        GOOD.replace("90 0 0 0 0 0\n", "90 0 0"),
        "{path}:20: this line has 6 numbers, the hierarchy has 9 channels "
        "(2 frames of 9 numbers make 18, the motion holds 15)",
    ),
    "wrapped and one missing": (
        GOOD.replace("0 1 0 0 0 0 0 0 0\n0 1 0 90 0 0 0 0 0\n", "0 1 0\n0 0 0\n0 0 0\n0 1 0\n90 0 0\n0 0\n"),
        "{path}:17: 2 frames of 9 numbers make 18, the motion holds 17",
    ),
    "no frames at all": (
        GOOD[: GOOD.index("0 1 0 0 0")],
        "{path}:17: 'Frames:' says 2, but the motion holds 0 frames of 9 numbers",
    ),
    "a word among the numbers": (
        GOOD.replace("0 1 0 90", "0 1 x 90"),
        "{path}:20: value 3 of this line is 'x', not a number",
    ),
    "comma decimals": (
        GOOD.replace("0 1 0 90", "0 1 0,5 90"),
        "{path}:20: value 3 of this line is '0,5', not a number",
    ),
    "nan": (
        GOOD.replace("0 1 0 90", "0 1 NaN 90"),
        "{path}:20: value 3 of this line is 'NaN', not a finite number",
    ),
    "infinity": (
        GOOD.replace("0 1 0 90", "-inf 1 0 90"),
        "{path}:20: value 1 of this line is '-inf', not a finite number",
    ),
    "nothing moves": (
        "HIERARCHY\nROOT a { OFFSET 0 0 0 }\nMOTION\nFrames: 1\nFrame Time: 1\n",
        "{path}:4: no joint has a channel, so nothing moves",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_told_by_line_and_reason(tmp_path: Path, case: str) -> None:
    data, message = BROKEN[case]
    path = written(tmp_path, data)
    with pytest.raises(SourceError) as error:
        read_bvh(path)
    assert str(error.value) == message.format(path=path)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(start=st.integers(0, len(GOOD)), length=st.integers(0, 60), junk=st.binary(max_size=12))
def test_whatever_is_damaged_is_read_or_told(tmp_path: Path, start: int, length: int, junk: bytes) -> None:
    data = GOOD.encode()
    path = written(tmp_path, data[:start] + junk + data[start + length :])
    try:
        bvh = read_bvh(path)
    except SourceError as error:
        assert str(error).startswith(str(path))
    else:
        assert np.isfinite(bvh.motion).all()
        assert bvh.motion.shape[1] == bvh.n_channels > 0


def test_endless_nesting_is_refused(tmp_path: Path) -> None:
    deep = "HIERARCHY\nROOT a { OFFSET 0 0 0 CHANNELS 0\n" + "JOINT a { OFFSET 0 0 0 CHANNELS 0\n" * 300
    with pytest.raises(SourceError, match="more than 4000 joints or 256 levels"):
        read_bvh(written(tmp_path, deep + "MOTION\n"))


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"none\.bvh: there is no such file"):
        read_bvh(tmp_path / "none.bvh")
    with pytest.raises(SourceError, match="is a folder; give a BVH file"):
        read_bvh(tmp_path)


def test_an_unreadable_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, GOOD)

    def refuse(self: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(SourceError) as error:
        read_bvh(path)
    assert str(error.value) == f"{path}: cannot be read: Permission denied"
