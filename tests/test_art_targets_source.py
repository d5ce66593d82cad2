"""Tables of rigid targets: a known person, joints from motion, broken files, and the shared recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from captured_people import perform_with_targets, small_targets, target_table
from imitor import testing
from imitor.errors import SourceError
from imitor.human.rotations import about_x, about_y, about_z
from imitor.motion.art_file import BODY_17, is_target_table
from imitor.motion.sitting import sitting
from imitor.motion.target_joints import joint_between
from imitor.plugins.sources.art_targets import ArtTargets, ArtTargetsConfig
from imitor.plugins.sources.kinect import Kinect, KinectConfig
from imitor.types import ROLE_INDEX, Array
from known import known


def read(path: Path, **options: Any) -> ArtTargets:
    source = ArtTargets(ArtTargetsConfig(path=str(path), **options))
    source.start()
    return source


def written(folder: Path, text: str) -> Path:
    (folder / "a.txt").write_text(text)
    return folder / "a.txt"


def posed(R: Array, t: Array) -> Array:
    pose = np.tile(np.eye(4), (len(R), 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = R, t
    return pose


def test_two_targets_that_turn_show_their_joint() -> None:
    rng = np.random.default_rng(3)
    n = 200
    a, b = np.cumsum(rng.normal(scale=0.05, size=(2, n, 3)), axis=1)
    R_a, R_b = (about_z(v[:, 0]) @ about_y(v[:, 1]) @ about_x(v[:, 2]) for v in (a, b))
    joint = rng.normal(size=(n, 3))
    at_a, at_b = np.array([0.05, -0.02, 0.2]), np.array([0.0, 0.04, -0.15])
    first = posed(R_a, joint - np.einsum("tij,j->ti", R_a, at_a))
    second = posed(R_b, joint - np.einsum("tij,j->ti", R_b, at_b))
    found = joint_between(first, second, joint + np.array([0.05, 0.05, 0.0]))
    assert np.linalg.norm(found - joint, axis=1).max() < 0.01
    # At rest there is nothing to tell: the guess stays.
    still = joint_between(
        np.repeat(first[:1], 50, 0), np.repeat(second[:1], 50, 0), np.repeat(joint[:1] + 0.05, 50, 0)
    )
    np.testing.assert_allclose(still, np.repeat(joint[:1] + 0.05, 50, 0), atol=1e-9)
    first[10:20] = np.nan
    assert np.isnan(joint_between(first, second, joint)[10:20]).all()


def test_the_targets_are_those_of_the_person(tmp_path: Path) -> None:
    truth = perform_with_targets("squat")
    source = read(written(tmp_path, target_table(truth)))
    clip = source.recording
    assert source.skeleton.target_names == BODY_17
    assert known(clip.target).shape == (len(truth.time_s), 17, 4, 4)
    shift = source.recording.facts["floor_m"]
    from imitor.human.markers import TARGETS

    true = np.asarray(truth.target)[:, [TARGETS.index(n) for n in BODY_17]]
    np.testing.assert_allclose(known(clip.target)[..., :3, :3], true[..., :3, :3], atol=1e-5)
    np.testing.assert_allclose(
        known(clip.target)[..., :3, 3], true[..., :3, 3] - [0.0, 0.0, float(shift)], atol=1e-6
    )


def test_joints_that_bend_are_found(tmp_path: Path) -> None:
    truth = perform_with_targets("squat")
    source = read(written(tmp_path, target_table(truth)), floor="file", height_m=1.75)
    for role, most in (("hip", 0.02), ("knee", 0.015), ("wrist", 0.04), ("shoulder", 0.05), ("elbow", 0.08)):
        i = ROLE_INDEX[f"left_{role}"]
        error = np.linalg.norm(source.recording.position[:, i] - truth.position[:, i], axis=1)
        assert error.mean() < most, role


def test_lost_targets_are_lost(tmp_path: Path) -> None:
    lines = target_table(perform_with_targets("squat")).split("\r\n")
    for i in range(20, 30):
        words = lines[i].split()
        k = 7 * BODY_17.index("left_forearm")
        lines[i] = " ".join([*words[:k], *["0"] * 7, *words[k + 7 :]])
    source = read(written(tmp_path, "\r\n".join(lines)))
    column = BODY_17.index("left_forearm")
    assert np.flatnonzero(~known(source.recording.target_valid)[:, column]).tolist() == list(range(20, 30))
    lost = {"left_elbow", "left_wrist", "left_hand"}
    for role in source.skeleton.roles:
        assert bool(source.recording.valid[25, ROLE_INDEX[role]]) == (role not in lost), role
    assert (
        "17 targets, 1 gaps in 1 of them, 10 target-frames lost, the longest gap 10 frames"
        in source.skeleton.notes
    )


@pytest.mark.parametrize(
    ("damage", "line", "said"),
    [
        (lambda t: "", None, "the file is empty"),
        (lambda t: t[: len(t) // 2], 0, "17 targets have 119: the file is cut off"),
        (lambda t: t.replace(" ", " 1 ", 1), 1, "120 values, 17 targets have 119"),
        (lambda t: t.replace(t.split()[4], "x", 1), 1, "a value is no number"),
        (lambda t: t.replace(t.split()[0], "inf", 1), 1, "a value is not finite"),
        (lambda t: t.replace(t.split()[3], "5.0", 1), 1, "the quaternion of target 1 has length"),
    ],
)
def test_broken_tables_are_refused(tmp_path: Path, damage: Any, line: int | None, said: str) -> None:
    path = written(tmp_path, damage(target_table(perform_with_targets("squat"))))
    with pytest.raises(SourceError) as error:
        read(path)
    assert said in str(error.value)
    assert line in {0, error.value.line}


def test_the_order_of_targets_is_checked(tmp_path: Path) -> None:
    path = written(tmp_path, target_table(perform_with_targets("squat")))
    with pytest.raises(SourceError, match=r"targets: none is called 'left_shinn'; did you mean 'left_shin'?"):
        read(path, targets=[*BODY_17[:-1], "left_shinn"])
    with pytest.raises(SourceError, match="targets: left_shin missing"):
        read(path, targets=list(BODY_17[:-1]))
    with pytest.raises(SourceError, match="m tall: set unit"):
        read(path, unit="m")


def test_it_keeps_the_contract_of_a_source(tmp_path: Path) -> None:
    testing.check_component(ArtTargets, small_targets(tmp_path))


@pytest.mark.shared
def test_only_target_tables_are_recognised(shared: Path) -> None:
    found = [p for p in (shared / "mocap").rglob("*.txt") if is_target_table(p)]
    assert [p.parent.name for p in found] == ["art_targets_keraal"]
    assert ArtTargets.recognises(found[0]) and not Kinect.recognises(found[0])


@pytest.mark.shared
def test_a_seated_start_is_told(shared: Path) -> None:
    art = read(shared / "mocap" / "art_targets_keraal" / "G3-Vicon-CTK-P1T1-Unknown-C-0.txt")
    assert [n for n in art.skeleton.notes if "sits" in n] == [
        "the person sits at the start (thighs 85 degrees from the vertical): a robot without a seat stands or "
        "crouches, and a calibration pose held standing is not there"
    ]


@pytest.mark.parametrize(
    ("knee", "ankle", "expected"),
    [
        ((0.0, 0.0, -0.4), (0.0, 0.0, -0.8), None),  # stands
        ((0.4, 0.0, 0.0), (0.4, 0.0, -0.4), 90.0),  # sits
        ((0.35, 0.0, -0.1), (0.0, 0.0, -0.3), None),  # squats
        ((0.4, 0.0, 0.0), (0.8, 0.0, 0.0), None),  # lies
        ((np.nan, 0.0, 0.0), (0.4, 0.0, -0.4), None),  # not seen
    ],
)
def test_who_sits(knee: tuple[float, ...], ankle: tuple[float, ...], expected: float | None) -> None:
    position = np.full((50, len(ROLE_INDEX), 3), np.nan)
    for side in ("left", "right"):
        position[:, ROLE_INDEX[f"{side}_hip"]] = 0.0
        position[:, ROLE_INDEX[f"{side}_knee"]] = knee
        position[:, ROLE_INDEX[f"{side}_ankle"]] = ankle
    assert sitting(position, 30.0) == expected


@pytest.mark.shared
def test_the_recording_agrees_with_a_depth_camera(shared: Path) -> None:
    mocap = shared / "mocap"
    art = read(mocap / "art_targets_keraal" / "G3-Vicon-CTK-P1T1-Unknown-C-0.txt")
    path = mocap / "kinect_v2_keraal" / "G3-Kinect-CTK-P1T1-Unknown-C-0.txt"
    kinect = Kinect(KinectConfig(path=str(path)))
    kinect.start()
    assert (len(art.recording), art.rate_hz) == (390, 60.0)
    assert known(art.recording.target_valid).all()

    def length(source: ArtTargets | Kinect, a: str, b: str) -> float:
        p = source.recording.position
        return float(np.nanmedian(np.linalg.norm(p[:, ROLE_INDEX[a]] - p[:, ROLE_INDEX[b]], axis=1)))

    for side in ("left", "right"):
        for a, b, most in (("hip", "knee", 0.06), ("knee", "ankle", 0.06), ("elbow", "wrist", 0.05)):
            ends = f"{side}_{a}", f"{side}_{b}"
            assert length(art, *ends) == pytest.approx(length(kinect, *ends), abs=most), ends
    assert length(art, "pelvis", "neck") == pytest.approx(length(kinect, "pelvis", "neck"), abs=0.05)
