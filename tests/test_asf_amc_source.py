"""Acclaim skeletons and motions: small ones of which everything is known, broken ones, and the shared takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asf_amc import bone_ends
from asf_amc import read_amc as read_amc_by_hand
from asf_amc import read_asf as read_asf_by_hand
from captured_people import acclaim_bones, small_acclaim
from imitor import testing
from imitor.errors import SourceError
from imitor.motion.amc_file import find_asf, read_amc
from imitor.motion.asf_file import extrinsic, read_asf
from imitor.motion.kinematics import forward_kinematics
from imitor.plugins.sources.asf_amc import AsfAmc, AsfAmcConfig
from imitor.plugins.sources.bvh import Bvh, BvhConfig
from imitor.types import ROLE_INDEX
from known import known

TAKES = {
    "cmu_asf_amc/02_01.amc": 343, "cmu_asf_amc/02_06.amc": 2235, "cmu_asf_amc/05_13.amc": 1095,
    "cmu_asf_amc/11_01.amc": 597, "cmu_asf_amc/49_18.amc": 1102,
    "hdm05_asf_amc/HDM_bd_squat1Reps_001_120.amc": 140, "hdm05_asf_amc/HDM_bd_depositFloorR_001_120.amc": 301,
    "hdm05_asf_amc/HDM_bd_grabHighR_001_120.amc": 253, "hdm05_asf_amc/HDM_bd_kickLFront1Reps_001_120.amc": 161,
    "hdm05_asf_amc/HDM_bd_rotateArmsBothBackward1Reps_001_120.amc": 92,
}  # fmt: skip


def read(path: str | Path, **options: Any) -> AsfAmc:
    source = AsfAmc(AsfAmcConfig(path=str(path), **options))
    source.start()
    return source


def test_a_small_person_is_read(tmp_path: Path) -> None:
    source = read(small_acclaim(tmp_path)["path"])
    clip = source.recording
    assert (source.rate_hz, len(clip), source.skeleton.name) == (120.0, 40, "acclaim")
    assert len(source.skeleton.roles) == 23
    assert clip.facts["up"] == "y"
    for role, bone in (("knee", "femur"), ("ankle", "tibia"), ("elbow", "humerus"), ("wrist", "radius")):
        above = {"knee": "hip", "ankle": "knee", "elbow": "shoulder", "wrist": "elbow"}[role]
        length = acclaim_bones()[f"l{bone}"][1]
        for side in ("left", "right"):
            limb = (
                clip.position[:, ROLE_INDEX[f"{side}_{role}"]]
                - clip.position[:, ROLE_INDEX[f"{side}_{above}"]]
            )
            np.testing.assert_allclose(np.linalg.norm(limb, axis=1), length, atol=1e-6)
    forward = clip.position[-1, ROLE_INDEX["pelvis"]] - clip.position[0, ROLE_INDEX["pelvis"]]
    np.testing.assert_allclose(forward, [39 * 0.002, 0.0, 0.0], atol=1e-6)
    raised = clip.position[:, ROLE_INDEX["left_elbow"], 2] - clip.position[:, ROLE_INDEX["left_shoulder"], 2]
    # The bone's own axis is turned by 20 degrees about z, as is its rotation: about z it is the same.
    np.testing.assert_allclose(raised, 0.28 * np.sin(np.radians(2.0 * np.arange(1, 41))), atol=1e-6)


def test_the_rate_is_an_option(tmp_path: Path) -> None:
    assert read(small_acclaim(tmp_path)["path"], rate_hz=60.0).rate_hz == 60.0


def test_radians_are_understood(tmp_path: Path) -> None:
    path = Path(small_acclaim(tmp_path)["path"])
    degrees = read(path).recording.position
    lines = path.read_text().replace(":DEGREES", ":RADIANS").split("\n")
    for i, line in enumerate(lines):
        words = line.split()
        if words and words[0] == "lhumerus":
            lines[i] = " ".join([words[0], *(f"{np.radians(float(w)):.12f}" for w in words[1:])])
    path.write_text("\n".join(lines))
    np.testing.assert_allclose(read(path).recording.position, degrees, atol=1e-7)


def test_the_skeleton_is_found_by_name(tmp_path: Path) -> None:
    (tmp_path / "02_01.amc").write_text("")
    with pytest.raises(
        SourceError, match=r"its skeleton is not beside it \(there is no .asf file\); set asf"
    ):
        find_asf(tmp_path / "02_01.amc")
    (tmp_path / "05.asf").write_text("")
    assert find_asf(tmp_path / "02_01.amc").name == "05.asf"
    (tmp_path / "02.asf").write_text("")
    assert find_asf(tmp_path / "02_01.amc").name == "02.asf"
    (tmp_path / "02_01.asf").write_text("")
    assert find_asf(tmp_path / "02_01.amc").name == "02_01.asf"
    with pytest.raises(SourceError, match=r"there are 02.asf, 02_01.asf, 05.asf\); set asf"):
        find_asf(tmp_path / "07_01.amc")
    assert find_asf("a.amc", "b.asf") == Path("b.asf")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("\n2\n", "\n1\n", "frame 1 comes after frame 1"),
        (":DEGREES\n1\n", ":DEGREES\n", "a frame begins with its number, found 'root'"),
        ("root 0", "rot 0", "the skeleton has no bone 'rot' that moves; did you mean 'root'?"),
        ("ltibia 0.000000", "ltibia 0.0 0.0", "'ltibia' has 2 values, the skeleton says 1"),
        ("ltibia 0.000000", "ltibia x", "'ltibia': a value is no number"),
        ("ltibia 0.000000\n", "", "the frame that begins here has no values of 'ltibia'"),
        ("ltibia 0.000000", "ltibia nan", "frame 1: a value is not finite"),
    ],
)
def test_broken_motions_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = Path(small_acclaim(tmp_path)["path"])
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(SourceError) as error:
        read(path)
    assert said in str(error.value)


def test_a_cut_motion_is_refused(tmp_path: Path) -> None:
    path = Path(small_acclaim(tmp_path)["path"])
    lines = path.read_text().split("\n")
    path.write_text("\n".join(lines[:-12]))
    with pytest.raises(SourceError, match=r"has no values of '.*' and .* more bones: it is cut off") as error:
        read(path)
    assert error.value.line == lines.index("40") + 1
    path.write_text(":DEGREES\n")
    with pytest.raises(SourceError, match="the file holds no frame"):
        read(path)
    path.write_text("")
    with pytest.raises(SourceError, match="the file is empty"):
        read(path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (":bonedata", ":bones", "the sections :root, :bonedata, :hierarchy; :bonedata is missing"),
        ("length 1.0", "length 0.0", "the unit of length is 0, not greater than 0"),
        ("angle deg", "angle gon", "angles are in 'gon', legal are deg and rad"),
        ("order TX TY TZ", "order TX TY", "the root's order is 'TX TY RX RY RZ'"),
        ("axis XYZ\n", "axis XYX\n", "the order of axes is 'xyx', not one such as XYZ"),
        ("name lfemur", "name rfemur", "bone 'rfemur' is described twice"),
        ("     name lfemur\n", "", "the bone that ends here has no name"),
        ("dof rx ry rz", "dof rx ry l", "dof 'rx ry l'; legal are rx, ry, rz, each once"),
        (
            "    lhipjoint lfemur",
            "    lhipjoint lfemurr",
            "names the bone 'lfemurr', :bonedata does not; did you mean",
        ),
        ("    lfemur ltibia", "    lfemur ltibia lfoot", "bone 'lfoot' has two parents"),
        ("    lfemur ltibia", "    lfoot ltibia", "'lfoot' is a parent before it is a child"),
        ("    lfemur ltibia", "    spine ltibia", "names the bone 'spine', :bonedata does not"),
        ("direction 0.000000000 1", "direction up 1", "are no numbers"),
        ("direction 0.000000000 1.000000000 0.000000000", "direction 0 1", "3 finite numbers are expected"),
    ],
)
def test_broken_skeletons_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    small_acclaim(tmp_path)
    path = tmp_path / "p.asf"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(SourceError) as error:
        read_asf(path)
    assert said in str(error.value)


def test_a_cut_skeleton_is_refused(tmp_path: Path) -> None:
    small_acclaim(tmp_path)
    text = (tmp_path / "p.asf").read_text()
    (tmp_path / "p.asf").write_text(text[: text.index("name lradius")])
    with pytest.raises(SourceError, match=":hierarchy is missing"):
        read_asf(tmp_path / "p.asf")


@given(st.lists(st.floats(-7.0, 7.0), min_size=3, max_size=3))
def test_turns_about_fixed_axes(angles: list[float]) -> None:
    x, y, z = angles
    turn = extrinsic("xyz", np.array(angles))
    single = [extrinsic(a, np.array(angles)) for a in "xyz"]
    np.testing.assert_allclose(turn, single[2] @ single[1] @ single[0], atol=1e-12)
    np.testing.assert_allclose(
        single[0][1:, 1:], [[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]], atol=1e-12
    )
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert np.isfinite([y, z]).all()


def test_it_keeps_the_contract_of_a_source(tmp_path: Path) -> None:
    testing.check_component(AsfAmc, small_acclaim(tmp_path))


# ---------------------------------------------------------------- shared takes


@pytest.mark.shared
def test_no_take_is_left_out(shared: Path) -> None:
    mocap = shared / "mocap"
    assert {str(p.relative_to(mocap)) for p in mocap.rglob("*") if AsfAmc.recognises(p)} == set(TAKES)


@pytest.mark.shared
@pytest.mark.parametrize("file", sorted(TAKES))
def test_every_bone_ends_where_the_format_puts_it(shared: Path, file: str) -> None:
    path = shared / "mocap" / file
    motion = read_amc(path, find_asf(path), 120.0)
    position = forward_kinematics(motion.nodes, motion.motion).position
    bones, frames = read_asf_by_hand(find_asf(path)), read_amc_by_hand(path)
    assert len(frames) == len(position) == TAKES[file]
    for i in range(0, len(frames), max(1, len(frames) // 15)):
        ends = bone_ends(bones, frames[i])
        for node, place in zip(motion.nodes, position[i], strict=True):
            if node.parent >= 0:
                end = 0.0254 / 0.45 * ends[motion.nodes[node.parent].name]
                np.testing.assert_allclose(place, end, atol=1e-12, err_msg=node.name)


@pytest.mark.shared
@pytest.mark.parametrize("file", sorted(TAKES))
def test_takes_stand_on_the_floor(shared: Path, file: str) -> None:
    source = read(shared / "mocap" / file)
    assert source.skeleton.name == "acclaim"
    assert 1.55 < source.skeleton.height_m < 1.8
    assert source.recording.facts["floor_m"] == 0.0
    low = np.nanmin(source.recording.position[..., 2], axis=1)
    assert -0.03 < np.median(low) < 0.07


@pytest.mark.shared
@pytest.mark.parametrize("take", ["02_01", "02_06", "05_13", "49_18"])
def test_a_take_agrees_with_its_bvh_file(shared: Path, take: str) -> None:
    amc = read(shared / "mocap" / "cmu_asf_amc" / f"{take}.amc")
    bvh = Bvh(BvhConfig(path=str(shared / "mocap" / "cmu_bvh" / f"{take}.bvh")))
    bvh.start()
    frames = min(len(amc.recording), len(bvh.recording))
    assert frames > 300
    for role in ("pelvis", *(f"{s}_{j}" for s in ("left", "right") for j in ("hip", "knee", "ankle", "toe"))):
        i = ROLE_INDEX[role]
        a, b = amc.recording, bvh.recording
        np.testing.assert_allclose(a.position[:frames, i], b.position[:frames, i], atol=2e-5, err_msg=role)
        turn = np.abs(known(a.orientation)[:frames, i] - known(b.orientation)[:frames, i]).max()
        assert turn < 5e-3, role
