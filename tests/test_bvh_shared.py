"""Every shared BVH recording: recognised, upright, of human size, on the floor, left on the left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imitor.motion.skeletons import MAIN_ROLES
from imitor.plugins.sources.bvh import Bvh, BvhConfig
from imitor.types import ROLE_INDEX
from known import known

pytestmark = pytest.mark.shared

Array = NDArray[np.float64]

# file: skeleton, unit, up axis, rate [Hz], frames, whether an added T-pose was dropped.
# A scale of its own ("scaled") is what SOURCES.md calls an unknown unit.
FILES: dict[str, tuple[str, str, str, float, int, bool]] = {
    "cmu_bvh/02_01.bvh": ("cmu_motionbuilder", "cmu", "y", 120, 343, True),
    "cmu_bvh/02_01_no_tpose.bvh": ("cmu_motionbuilder", "cmu", "y", 120, 343, False),
    "cmu_bvh/02_06.bvh": ("cmu_motionbuilder", "cmu", "y", 120, 2235, True),
    "cmu_bvh/05_13.bvh": ("cmu_motionbuilder", "cmu", "y", 120, 1095, True),
    "cmu_bvh/49_18.bvh": ("cmu_motionbuilder", "cmu", "y", 120, 1102, True),
    "cmu_bvh/07_04.bvh": ("cmu_motionbuilder", "cmu", "y", 120, 449, True),
    "cmu_bvh/131_01.bvh": ("cmu_3dsmax", "cmu", "y", 120, 994, False),
    "cmu_bvh/131_01_metres.bvh": ("cmu_3dsmax", "m", "y", 120, 995, False),
    "cmu_bvh/11_01_daz.bvh": ("cmu_daz", "cm", "y", 120, 597, True),
    "cmu_bvh/martial_04_daz.bvh": ("cmu_daz", "cm", "y", 120, 1316, True),
    "bvh_other/AV_8Walk_Meredith_HVHA_Rep1.bvh": ("hvha", "inch", "y", 120, 1064, False),
    "bvh_other/Male1_B3_Walk.bvh": ("accad", "cm", "y", 30, 183, False),
    "bvh_other/fair1_wave_hello.bvh": ("fair1", "scaled", "z", 1 / 0.008342, 839, False),
    "bvh_other/fair1_dab.bvh": ("fair1", "scaled", "z", 30, 339, False),
    "bvh_other/bvh_mixed_orders.bvh": ("pybvh", "inch", "z", 30, 75, False),
    "bvh_other/tpose_one_frame.bvh": ("poser", "dm", "y", 4, 1, False),
    "bvh_perception_neuron/milad.bvh": ("perception_neuron", "cm", "y", 125, 422, False),
    "bvh_rokoko/jesse_dance.bvh": ("rokoko", "cm", "y", 100, 1007, False),
    "bvh_xsens/xsens_walk.bvh": ("xsens", "cm", "y", 1 / 0.004184, 2487, False),
    "bvh_xsens/test_mocap.bvh": ("xsens", "cm", "y", 60, 111, True),
}
NOT_ALWAYS_UPRIGHT = {
    "cmu_bvh/02_06.bvh",
    "cmu_bvh/05_13.bvh",
    "cmu_bvh/martial_04_daz.bvh",
    "cmu_bvh/131_01.bvh",
}


DISPLACED = {"bvh_perception_neuron/milad.bvh"}
"""Every joint has position channels that change over time."""


def read(shared: Path, file: str, **options: Any) -> Bvh:
    source = Bvh(BvhConfig(path=str(shared / "mocap" / file), **options))
    source.start()
    return source


def roles(source: Bvh, name: str) -> Array:
    return source.recording.position[:, ROLE_INDEX[name]]


def test_no_recording_is_left_out(shared: Path) -> None:
    found = {str(p.relative_to(shared / "mocap")) for p in (shared / "mocap").rglob("*.bvh")}
    assert found == set(FILES)


@pytest.mark.parametrize("file", FILES)
def test_what_is_found_in_a_recording(shared: Path, file: str) -> None:
    source = read(shared, file)
    name, unit, up, rate, frames, dropped = FILES[file]
    facts = source.recording.facts
    assert (facts["skeleton"], facts["unit"], facts["up"], facts["dropped_tpose"]) == (
        name,
        unit,
        up,
        dropped,
    )
    assert source.rate_hz == pytest.approx(rate)
    assert source.n_frames == frames == sum(1 for _ in source.frames())


@pytest.mark.parametrize("file", FILES)
def test_a_recording_is_a_human_on_the_floor(shared: Path, file: str) -> None:
    source = read(shared, file)
    skeleton, position = source.skeleton, source.recording.position
    height = skeleton.height_m
    assert 1.4 <= height <= 2.1
    main = [ROLE_INDEX[r] for r in MAIN_ROLES]
    assert np.isfinite(position[:, main]).all()
    assert np.isfinite(known(source.recording.orientation)[:, main]).all()
    assert skeleton.has(*MAIN_ROLES)

    # Lengths of the segments are human (fractions of stature, with room for short trunks of conversions).
    for side in ("left", "right"):
        for a, b, low, high in (
            ("hip", "knee", 0.20, 0.30),
            ("knee", "ankle", 0.20, 0.31),
            ("shoulder", "elbow", 0.13, 0.22),
            ("elbow", "wrist", 0.09, 0.18),
        ):
            length = np.linalg.norm(roles(source, f"{side}_{a}") - roles(source, f"{side}_{b}"), axis=1)
            assert np.ptp(length) < (0.03 if file in DISPLACED else 0.001) * height
            assert low < length.mean() / height < high, (side, a, length.mean() / height)

    # The lower foot stands on the floor: what is lowest of ankle and toe, less flesh and sole.
    lowest, speed = [], []
    for side in ("left", "right"):
        ankle = roles(source, f"{side}_ankle")
        points = [ankle[:, 2] - 0.07]
        if skeleton.has(f"{side}_toe"):
            points.append(roles(source, f"{side}_toe")[:, 2] - 0.02)
        if skeleton.has(f"{side}_toe_tip"):
            points.append(roles(source, f"{side}_toe_tip")[:, 2] - 0.01)
        lowest.append(np.min(points, axis=0))
        moved = np.gradient(ankle, axis=0) if len(ankle) > 1 else np.zeros_like(ankle)
        speed.append(np.linalg.norm(moved, axis=1) * source.rate_hz)
    lower = np.argmin(lowest, axis=0)
    pick = np.arange(len(lower))
    standing = np.array(lowest)[lower, pick][np.array(speed)[lower, pick] < 0.15]
    assert len(standing) > 0.05 * len(lower)
    assert abs(np.median(standing)) < 0.03

    assert 0.03 < skeleton.ankle_height_m < 0.12
    assert 0.0 <= skeleton.toe_height_m < 0.08
    assert roles(source, "head")[:, 2].max() < 2.3
    if file not in NOT_ALWAYS_UPRIGHT:
        pelvis = np.median(roles(source, "pelvis")[:, 2]) / height
        assert 0.45 < pelvis < 0.64


@pytest.mark.parametrize("file", FILES)
def test_left_is_left_and_the_rest_pose_is_a_t_pose(shared: Path, file: str) -> None:
    source = read(shared, file)
    rest = source.skeleton.rest_position
    at = {r: rest[ROLE_INDEX[r]] for r in source.skeleton.roles}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for a, b in (("shoulder", "elbow"), ("elbow", "wrist")):
            arm = at[f"{side}_{b}"] - at[f"{side}_{a}"]
            np.testing.assert_allclose(arm / np.linalg.norm(arm), [0, sign, 0], atol=1e-6)
        for a, b in (("hip", "knee"), ("knee", "ankle")):
            leg = at[f"{side}_{b}"] - at[f"{side}_{a}"]
            np.testing.assert_allclose(leg / np.linalg.norm(leg), [0, 0, -1], atol=1e-6)
        assert sign * at[f"{side}_hip"][1] > 0.03
        assert sign * at[f"{side}_shoulder"][1] > 0.1
        if source.skeleton.has(f"{side}_toe"):
            ahead = at[f"{side}_toe"] - at[f"{side}_ankle"]
            assert ahead[0] > 0.08
            assert abs(ahead[1]) < 0.02
    assert abs(at["head"][0]) < 0.12 and abs(at["head"][1]) < 0.03
    assert at["head"][2] > at["neck"][2] > at["chest"][2] > at["pelvis"][2]

    # In the motion: feet (or bent knees) point forward, and up x forward is left.
    ahead = np.zeros((len(source.recording.position), 3))
    for side in ("left", "right"):
        if source.skeleton.has(f"{side}_toe"):
            ahead += roles(source, f"{side}_toe") - roles(source, f"{side}_ankle")
        else:
            ahead += (
                2 * roles(source, f"{side}_knee")
                - roles(source, f"{side}_hip")
                - roles(source, f"{side}_ankle")
            )
    left = np.cross([0.0, 0.0, 1.0], ahead)
    line = roles(source, "left_shoulder") - roles(source, "right_shoulder")
    assert np.mean((left * line).sum(axis=1) > 0.0) > 0.8


@pytest.mark.parametrize("file", FILES)
def test_orientations_carry_the_limbs_from_the_rest_pose(shared: Path, file: str) -> None:
    source = read(shared, file)
    rest = source.skeleton.rest_position
    for side in ("left", "right"):
        for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
            i, j = ROLE_INDEX[f"{side}_{a}"], ROLE_INDEX[f"{side}_{b}"]
            carried = known(source.recording.orientation)[:, i] @ (rest[j] - rest[i])
            actual = source.recording.position[:, j] - source.recording.position[:, i]
            np.testing.assert_allclose(carried, actual, atol=0.15 if file in DISPLACED else 1e-6)
    orientation = known(source.recording.orientation)[:, ROLE_INDEX["head"]]
    np.testing.assert_allclose(
        orientation @ np.swapaxes(orientation, 1, 2), np.eye(3)[None].repeat(len(orientation), 0), atol=1e-9
    )
    assert np.linalg.det(orientation) == pytest.approx(1.0)


def test_a_foot_that_stands_flat_is_level(shared: Path) -> None:
    for file in ("cmu_bvh/02_01.bvh", "cmu_bvh/02_01_no_tpose.bvh", "bvh_xsens/xsens_walk.bvh"):
        source = read(shared, file)
        for side in ("left", "right"):
            ankle, toe = roles(source, f"{side}_ankle"), roles(source, f"{side}_toe")
            speed = np.linalg.norm(np.gradient(ankle, axis=0), axis=1) * source.rate_hz
            flat = (speed < 0.1) & (toe[:, 2] < np.quantile(toe[:, 2], 0.05) + 0.02)
            flat &= ankle[:, 2] < np.quantile(ankle[:, 2], 0.05) + 0.02
            assert flat.sum() > 5
            up = known(source.recording.orientation)[flat, ROLE_INDEX[f"{side}_ankle"]][:, 2, 2]
            assert np.degrees(np.arccos(np.clip(up, -1, 1))).max() < 10.0


def test_with_and_without_the_t_pose_frame_the_take_is_the_same(shared: Path) -> None:
    a, b = read(shared, "cmu_bvh/02_01.bvh"), read(shared, "cmu_bvh/02_01_no_tpose.bvh")
    np.testing.assert_allclose(a.recording.position, b.recording.position, atol=1e-9, equal_nan=True)
    np.testing.assert_allclose(a.skeleton.rest_position, b.skeleton.rest_position, atol=1e-3)
    relative = known(a.recording.orientation) @ np.swapaxes(known(b.recording.orientation), 2, 3)
    turn = relative[:, a.recording.valid[0]]
    angle = np.arccos(np.clip((np.trace(turn, axis1=2, axis2=3) - 1.0) / 2.0, -1.0, 1.0))
    trunk = ("pelvis", "chest", "head", "left_ankle", "right_ankle", "left_hip", "left_shoulder")
    order = [r for r in ROLE_INDEX if a.recording.valid[0, ROLE_INDEX[r]]]
    assert np.degrees(angle[:, [order.index(r) for r in trunk]]).max() < 0.5


def test_the_take_in_metres_equals_the_take_in_cmu_units(shared: Path) -> None:
    units, metres = read(shared, "cmu_bvh/131_01.bvh"), read(shared, "cmu_bvh/131_01_metres.bvh")
    a, b = units.recording.position, metres.recording.position[: len(units.recording.position)]
    np.testing.assert_allclose(a, b, atol=5e-4, equal_nan=True)
    assert units.skeleton.height_m == pytest.approx(metres.skeleton.height_m, abs=1e-3)


def test_joints_that_are_displaced_are_told(shared: Path) -> None:
    assert any("displaced in their parents" in n for n in read(shared, *DISPLACED).skeleton.notes)
    assert not any("displaced" in n for n in read(shared, "cmu_bvh/02_01.bvh").skeleton.notes)


def test_the_xsens_bvh_stands_where_its_first_frame_does_not(shared: Path) -> None:
    source = read(shared, "bvh_xsens/test_mocap.bvh")
    assert source.recording.facts["floor_m"] == pytest.approx(-0.82, abs=0.04)
    assert np.median(roles(source, "pelvis")[:, 2]) == pytest.approx(0.83, abs=0.05)
