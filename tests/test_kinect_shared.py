"""Every shared depth-camera recording: its points, its rate, a person on the floor, left on the left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imitor import testing
from imitor.cli import main
from imitor.motion.kinect_body import side_evidence
from imitor.motion.kinect_file import read_capture
from imitor.motion.kinect_offsets import PARENTS
from imitor.plugins.sources.kinect import Kinect, KinectConfig
from imitor.types import ROLE_INDEX, SIDES
from known import known

pytestmark = pytest.mark.shared

Array = NDArray[np.float64]

# file: skeleton, unit, frames of the file, frames read, whether the person stands at first
FILES: dict[str, tuple[str, str, int, int, bool]] = {
    "kinect_v1_precog/Seq1_8.csv": ("kinect_v1", "m", 431, 431, True),
    "kinect_v1_precog/Seq5_8.csv": ("kinect_v1", "m", 466, 466, True),
    "kinect_v2_irds/216_18_6_1_1_stand.csv": ("kinect_v2", "m", 189, 194, True),
    "kinect_v2_irds/216_18_6_1_1_stand.txt": ("kinect_v2", "m", 189, 194, True),
    "kinect_v2_irds/216_18_7_3_1_stand.csv": ("kinect_v2", "m", 124, 124, True),
    "kinect_v2_irds/217_18_4_1_1_wheelchair.csv": ("kinect_v2", "m", 172, 171, False),
    "kinect_v2_keraal/G3-Kinect-CTK-P1T1-Unknown-C-0.txt": ("kinect_v2", "m", 197, 197, False),
    "kinect_uiprmd/m01_s01_e01_positions.txt": ("kinect_22", "cm", 73, 73, True),
    "kinect_uiprmd/m02_s01_e01_positions.txt": ("kinect_22", "cm", 62, 62, True),
    "kinect_uiprmd/m07_s01_e01_positions.txt": ("kinect_22", "cm", 63, 63, True),
    "kinect_uiprmd/m01_s01_e01_angles.txt": ("kinect_22", "cm", 73, 73, True),
    "kinect_uiprmd/m02_s01_e01_angles.txt": ("kinect_22", "cm", 62, 62, True),
    "kinect_uiprmd/m07_s01_e01_angles.txt": ("kinect_22", "cm", 63, 63, True),
}


def read(shared: Path, file: str, **options: Any) -> Kinect:
    source = Kinect(KinectConfig(path=str(shared / "mocap" / file), **options))
    source.start()
    return source


def roles(source: Kinect, name: str) -> Array:
    return source.recording.position[:, ROLE_INDEX[name]]


def test_no_recording_is_left_out_and_others_are_not_taken(shared: Path) -> None:
    mocap = shared / "mocap"
    found = {str(p.relative_to(mocap)) for p in mocap.rglob("*") if p.is_file() and Kinect.recognises(p)}
    assert found == set(FILES)


@pytest.mark.parametrize("file", FILES)
def test_what_is_found_in_a_recording(shared: Path, file: str) -> None:
    name, unit, written, frames, _ = FILES[file]
    source = read(shared, file)
    facts = source.recording.facts
    assert (facts["skeleton"], facts["unit"], source.rate_hz) == (name, unit, 30.0)
    assert source.n_frames == frames == sum(1 for _ in source.frames())
    assert read(shared, file, resample=False).n_frames == written


@pytest.mark.parametrize("file", FILES)
def test_a_recording_is_a_human_on_the_floor(shared: Path, file: str) -> None:
    source = read(shared, file)
    stands = FILES[file][4]
    height = source.skeleton.height_m
    assert 1.35 < height < 1.95
    head = roles(source, "head_top" if source.skeleton.has("head_top") else "head")[0, 2]
    if stands:
        # In a squat the sensor sees the segments shorter than when standing.
        assert 0.85 * height < head < 1.07 * height
    else:
        assert 0.6 * height < head < 0.85 * height
    lowest = np.nanmin(source.recording.position[..., 2], axis=1)
    assert -0.05 < np.median(lowest) < 0.04
    assert lowest.min() > -0.1
    for side in SIDES:
        # A noisy sensor sees the same ankle up to 5 cm higher or lower.
        low = np.quantile(roles(source, f"{side}_ankle")[:, 2], 0.3)
        assert low == pytest.approx(source.skeleton.ankle_height_m, abs=0.05)


@pytest.mark.parametrize("file", FILES)
def test_left_is_left_and_the_person_faces_the_sensor(shared: Path, file: str) -> None:
    anatomy, facing = side_evidence(read(shared, file).recording.position)
    assert anatomy > 0.7
    assert facing > 0.7


@pytest.mark.parametrize("file", ["kinect_v1_precog/Seq1_8.csv", "kinect_v1_precog/Seq5_8.csv"])
def test_the_tilt_from_balance_is_that_of_the_floor(shared: Path, file: str) -> None:
    # The person walks about, so the planted feet themselves tell how the floor slopes in the sensor's axes.
    level = read(shared, file, tilt_rad=0.0)
    planted = []
    for side in SIDES:
        foot = roles(level, f"{side}_toe")
        slow = np.linalg.norm(np.gradient(foot, axis=0), axis=1) * level.rate_hz < 0.25
        planted.append(foot[slow & (foot[:, 2] < np.quantile(foot[:, 2], 0.3) + 0.06)])
    points = np.concatenate(planted)
    slope = np.linalg.lstsq(np.c_[points[:, :2], np.ones(len(points))], points[:, 2], rcond=None)[0][0]
    found = float(read(shared, file).recording.facts["tilt_rad"])
    assert found == pytest.approx(-np.arctan(slope), abs=np.radians(1.0))


def test_both_forms_of_a_take_are_the_same(shared: Path) -> None:
    a = read(shared, "kinect_v2_irds/216_18_6_1_1_stand.csv").recording
    b = read(shared, "kinect_v2_irds/216_18_6_1_1_stand.txt").recording
    np.testing.assert_array_equal(a.position, b.position)
    np.testing.assert_array_equal(a.confidence, b.confidence)


def test_inferred_points_can_be_refused(shared: Path) -> None:
    file = "kinect_v2_irds/216_18_6_1_1_stand.csv"
    used = read(shared, file, resample=False).recording
    strict = read(shared, file, resample=False, min_confidence=1.0).recording
    assert used.valid[:, [ROLE_INDEX[r] for r in read(shared, file).skeleton.roles]].all()
    head = ROLE_INDEX["head"]
    assert int((~strict.valid[:, head]).sum()) == int((known(used.confidence)[:, head] == 0.5).sum()) > 0


@pytest.mark.parametrize("file", [f for f in FILES if "uiprmd" not in f])
def test_the_15_points_stand_where_the_others_stand(shared: Path, file: str) -> None:
    given = {"tilt_rad": 0.0, "floor": -0.9}
    full, fifteen = read(shared, file, **given), read(shared, file, points=15, **given)
    for name in ("head", "left_elbow", "right_hand", "left_hip", "right_knee", "left_ankle", "right_ankle"):
        np.testing.assert_array_equal(roles(full, name), roles(fifteen, name))


def test_a_chain_of_offsets_keeps_its_lengths_and_its_feet_planted(shared: Path) -> None:
    path = shared / "mocap/kinect_uiprmd/m01_s01_e01_positions.txt"
    offset = np.loadtxt(path, delimiter=",").reshape(-1, 22, 3)
    joint = read_capture(path).position
    for child, parent in enumerate(PARENTS):
        if parent >= 0:
            length = np.linalg.norm(joint[:, child] - joint[:, parent], axis=1)
            np.testing.assert_allclose(length, np.linalg.norm(offset[:, child], axis=1), atol=1e-9)
    source = read(shared, "kinect_uiprmd/m01_s01_e01_positions.txt")
    assert roles(source, "pelvis")[:, 2].min() < 0.6 * roles(source, "pelvis")[0, 2]  # a deep squat
    for side in SIDES:  # with another order of the rotations they wander by 15 cm and more
        assert np.ptp(roles(source, f"{side}_ankle")[:, :2], axis=0).max() < 0.06


@pytest.mark.parametrize("points", ["all", 15])
@pytest.mark.parametrize(
    "file", ["kinect_v2_irds/216_18_7_3_1_stand.csv", "kinect_v2_irds/217_18_4_1_1_wheelchair.csv"]
)
def test_a_robot_follows(shared: Path, tmp_path: Path, file: str, points: str | int) -> None:
    out = tmp_path / "run"
    status = main(
        ["run", "retarget", "--input", str(shared / "mocap" / file), "--out", str(out), "--frames", "60",
         "--set", f"source.points={points}"]
    )  # fmt: skip
    assert status == 0
    motion = np.load(out / "motion.npz")
    joints, robot = motion["joint_position_rad"], testing.make_robot()
    assert np.isfinite(joints).all()
    assert (joints >= robot.lower - 1e-9).all() and (joints <= robot.upper + 1e-9).all()
    assert (motion["status"] == "ok").all()
