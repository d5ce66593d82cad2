"""The shared MVNX recordings of both versions, and one take against its BVH file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imitor import testing
from imitor.cli import main
from imitor.motion.normalise import handedness
from imitor.plugins.sources.bvh import Bvh, BvhConfig
from imitor.plugins.sources.mvnx import Mvnx, MvnxConfig
from imitor.types import ROLE_INDEX, ROLES, SIDES
from known import known

pytestmark = pytest.mark.shared

Array = NDArray[np.float64]
V3, V4 = "mvnx/Meri-020.mvnx", "mvnx/test_mocap.mvnx"


def read(shared: Path, file: str, **options: Any) -> Mvnx:
    source = Mvnx(MvnxConfig(path=str(shared / "mocap" / file), **options))
    source.start()
    return source


def test_no_recording_is_left_out(shared: Path) -> None:
    mocap = shared / "mocap"
    assert {str(p.relative_to(mocap)) for p in mocap.rglob("*") if Mvnx.recognises(p)} == {V3, V4}


@pytest.mark.parametrize(("file", "version", "rate", "frames"), [(V3, "3", 240.0, 4), (V4, "4", 60.0, 112)])
def test_what_is_found_in_a_recording(
    shared: Path, file: str, version: str, rate: float, frames: int
) -> None:
    source = read(shared, file)
    assert (source.recording.facts["version"], source.recording.facts["rest"]) == (version, "tpose")
    assert (source.rate_hz, source.n_frames) == (rate, frames)
    assert len(source.skeleton.roles) == 25
    assert 1.55 < source.skeleton.height_m < 1.75
    assert handedness(source.skeleton.rest_position) > 0.9


def test_a_person_stands_on_the_floor(shared: Path) -> None:
    source = read(shared, V3)
    position, skeleton = source.recording.position, source.skeleton
    for side in SIDES:
        assert position[:, ROLE_INDEX[f"{side}_ankle"], 2] == pytest.approx(skeleton.ankle_height_m, abs=0.01)
        assert position[:, ROLE_INDEX[f"{side}_heel"], 2] == pytest.approx(0.0, abs=0.01)
    assert np.nanmin(position[..., 2]) > -0.01
    assert position[0, ROLE_INDEX["head_top"], 2] == pytest.approx(skeleton.height_m, abs=0.06)
    assert handedness(position) > 0.9


@pytest.mark.parametrize("file", [V3, V4])
def test_positions_follow_from_orientations(shared: Path, file: str) -> None:
    # The rest pose, turned segment by segment, is the frame: so the arm axes of both versions are understood.
    source = read(shared, file, legs="recorded")
    rest, r = source.skeleton.rest_position, source.recording
    for side in SIDES:
        for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "hand"), ("hip", "knee"), ("knee", "ankle"),
                     ("ankle", "toe"), ("ankle", "heel"), ("toe", "toe_tip")):  # fmt: skip
            i, j = ROLE_INDEX[f"{side}_{a}"], ROLE_INDEX[f"{side}_{b}"]
            turned = r.position[:, i] + known(r.orientation)[:, i] @ (rest[j] - rest[i])
            np.testing.assert_allclose(turned, r.position[:, j], atol=2.5e-3)


def test_a_take_agrees_with_its_bvh_file(shared: Path) -> None:
    mvnx = read(shared, V4, legs="recorded")
    bvh = Bvh(BvhConfig(path=str(shared / "mocap/bvh_xsens/test_mocap.bvh")))
    bvh.start()
    # A BVH point is a segment's origin only for joints; frame 1 of the BVH file is an added T-pose.
    joints = [
        ROLE_INDEX[r] for r in ROLES
        if bvh.skeleton.has(r) and r.removeprefix("left_").removeprefix("right_")
        in {"chest", "neck", "head", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe"}
    ]  # fmt: skip
    assert len(joints) == 17
    a, b = mvnx.recording.position[1:, joints], bvh.recording.position[:, joints]
    assert a.shape == b.shape == (111, 17, 3)
    mean_a, mean_b = a.mean(axis=(0, 1)), b.mean(axis=(0, 1))
    u, _, vt = np.linalg.svd(np.einsum("tri,trj->ij", a - mean_a, b - mean_b))
    rotation = (u @ vt).T
    error = np.linalg.norm((a - mean_a) @ rotation.T - (b - mean_b), axis=-1)
    assert np.linalg.det(rotation) > 0
    assert np.arccos((np.trace(rotation) - 1) / 2) < 2e-3
    assert error.mean() < 0.7e-3
    assert error.max() < 1.5e-3
    for role in ("chest", "left_shoulder", "right_shoulder", "left_wrist", "right_wrist"):
        i = ROLE_INDEX[role]
        turn = (
            rotation
            @ known(mvnx.recording.orientation)[1:, i]
            @ rotation.T
            @ np.swapaxes(known(bvh.recording.orientation)[:, i], 1, 2)
        )
        angle = np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1) / 2, -1, 1))
        assert angle.max() < np.radians(0.3), role


def test_the_version_4_file_has_contacts_and_both_a_com(shared: Path) -> None:
    full = read(shared, V4, legs="recorded").recording
    assert full.support is not None and full.support.all()
    assert full.com is not None
    first = read(shared, V3).recording
    assert first.support is None
    assert first.com is not None
    assert 0.5 < first.com[0, 2] / read(shared, V3).skeleton.height_m < 0.62


@pytest.mark.parametrize("file", [V3, V4])
def test_a_robot_follows(shared: Path, tmp_path: Path, file: str) -> None:
    out = tmp_path / "run"
    assert (
        main(
            ["run", "retarget", "--input", str(shared / "mocap" / file), "--out", str(out), "--frames", "40"]
        )
        == 0
    )
    motion = np.load(out / "motion.npz")
    joints, robot = motion["joint_position_rad"], testing.make_robot()
    assert np.isfinite(joints).all()
    assert (joints >= robot.lower - 1e-9).all() and (joints <= robot.upper + 1e-9).all()
    assert (motion["status"] == "ok").all()
    assert motion["contact"].all()
