"""The performer's motions: exact bodies, exact contacts, balance, human ranges, smoothness."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imitor.errors import ImitorError
from imitor.human import masses
from imitor.human.body import FRACTIONS, Body
from imitor.human.performance import Truth, mirrored
from imitor.human.scenarios import SCENARIOS, play
from imitor.human.scenarios.scenario import Options
from imitor.types import ROLE_INDEX, SEGMENTS, SIDES, Array

RATE_HZ = 120.0
BODY = Body()
MOVING = sorted(set(SCENARIOS) - {"t_pose"})
QUASI_STATIC = sorted(name for name, s in SCENARIOS.items() if s.quasi_static)

SINGLE_SUPPORTS = {
    "step_forward": (1, 2.0),
    "two_steps_and_reach": (2, 1.0),
    "weight_shift_foot_lift": (1, 4.0),
    "single_leg_balance": (1, 5.0),
    "walk_in_place": (4, 1.0),
    "walk": (6, 0.4),
}
"""How many single supports a scenario has, and how long each lasts at least [s]."""


@cache
def performed(name: str, side: str | None = None) -> Truth:
    return play(name, BODY, Options(side=side), RATE_HZ)


def at(truth: Truth, role: str) -> Array:
    if role in ROLE_INDEX:
        return truth.position[:, ROLE_INDEX[role]]
    part = role.removeprefix("mid_")
    return 0.5 * (at(truth, f"left_{part}") + at(truth, f"right_{part}"))


def foot_corners(truth: Truth, body: Body, side: str) -> Array:
    """Corners of a foot's sole rectangle (T, 4, 2) [m]."""
    heel, tip = at(truth, f"{side}_heel")[:, :2], at(truth, f"{side}_toe_tip")[:, :2]
    along = tip - heel
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    half = 0.5 * body.length("foot_width") * np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([heel + half, heel - half, tip - half, tip + half], axis=1)


def balance_margin(truth: Truth, body: Body) -> Array:
    """Distance of the CoM to the edge of the polygon of the feet in contact (T,) [m]; negative outside."""
    angles = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    normals = np.stack([np.cos(angles), np.sin(angles)])
    extent = np.full((len(truth.time_s), angles.size), -np.inf)
    for i, side in enumerate(SIDES):
        reach = (foot_corners(truth, body, side) @ normals).max(axis=1)
        extent[truth.support[:, i]] = np.maximum(extent, reach)[truth.support[:, i]]
    return np.asarray((extent - truth.com[:, :2] @ normals).min(axis=1))


def runs(mask: NDArray[np.bool_]) -> list[int]:
    """Lengths of the runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [b - a for a, b in pairwise(edges)][::2]


def check_body(truth: Truth, body: Body) -> None:
    """Check that the bones keep their lengths and that orientations are rotations that carry them."""
    for name, (start, end) in SEGMENTS.items():
        length = np.linalg.norm(at(truth, end) - at(truth, start), axis=1)
        part = name.removeprefix("left_").removeprefix("right_")
        np.testing.assert_allclose(length, body.length(part), rtol=0, atol=1e-9)
    R = truth.orientation
    np.testing.assert_allclose(R @ R.swapaxes(2, 3), np.broadcast_to(np.eye(3), R.shape), atol=1e-9)
    assert np.linalg.det(R[:: len(R) // 5]).min() > 0.999
    for child, parent in BONES:
        moved = truth.orientation[:, ROLE_INDEX[parent]] @ body.offset(parent, child)
        np.testing.assert_allclose(at(truth, child) - at(truth, parent), moved, atol=1e-9)


BONES = [
    ("neck", "chest"),
    ("head", "neck"),
    ("head_top", "head"),
    *((f"{s}_shoulder", "chest") for s in SIDES),
    *((f"{s}_hip", "pelvis") for s in SIDES),
    *(
        (f"{s}_{child}", f"{s}_{parent}")
        for s in SIDES
        for parent, child in (
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
            ("wrist", "hand"),
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "heel"),
            ("ankle", "toe"),
            ("toe", "toe_tip"),
        )
    ),
]
"""Child and parent: the parent's orientation carries the child. The chest alone hangs on the thorax' own."""


def check_feet(truth: Truth) -> None:
    """Check that feet in contact stand still and flat on the floor, and that none is below it."""
    for i, side in enumerate(SIDES):
        sole = np.stack([at(truth, f"{side}_{p}") for p in ("heel", "toe_tip")], axis=1)
        assert sole[:, :, 2].min() > -1e-9
        assert at(truth, f"{side}_toe")[:, 2].min() > 0
        contact = truth.support[:, i]
        np.testing.assert_allclose(sole[contact][:, :, 2], 0, atol=1e-12)
        both = contact[1:] & contact[:-1]
        foot = [ROLE_INDEX[f"{side}_{p}"] for p in ("ankle", "heel", "toe", "toe_tip")]
        np.testing.assert_array_equal(np.diff(truth.position[:, foot], axis=0)[both], 0)
        np.testing.assert_array_equal(np.diff(truth.orientation[:, foot], axis=0)[both], 0)
        if not contact.all():
            lifted = at(truth, f"{side}_ankle")[:, 2]
            assert lifted[~contact].max() > lifted[contact].max() + 0.02


def check_ranges(truth: Truth) -> None:
    """Check that every joint stays where a human's can be."""
    degrees = {name: np.degrees(angle) for name, angle in truth.joint_angle.items()}
    ranges = {
        "knee": (-1e-6, 150),
        "elbow": (-1e-6, 150),
        "hip_flexion": (-30, 125),
        "hip_abduction": (-30, 45),
        "ankle_dorsiflexion": (-55, 47),
        "shoulder_elevation": (0, 180),
    }
    for part, (low, high) in ranges.items():
        for side in SIDES:
            angle = degrees[f"{side}_{part}"]
            assert angle.min() >= low, (side, part)
            assert angle.max() <= high, (side, part)
    for axis, most in (("yaw", 45), ("pitch", 45), ("roll", 30)):
        assert np.abs(degrees[f"trunk_{axis}"]).max() <= most


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_body_is_exact(name: str) -> None:
    truth = performed(name)
    assert np.isfinite(truth.position).all()
    check_body(truth, BODY)


@pytest.mark.parametrize("name", SCENARIOS)
def test_feet_in_contact_stand_still_on_the_floor(name: str) -> None:
    check_feet(performed(name))


@pytest.mark.parametrize("name", SCENARIOS)
def test_joints_stay_in_human_ranges(name: str) -> None:
    check_ranges(performed(name))


@pytest.mark.parametrize("name", QUASI_STATIC)
def test_the_com_stays_over_the_feet(name: str) -> None:
    assert balance_margin(performed(name), BODY).min() > 0.03


@pytest.mark.parametrize("name", SCENARIOS)
def test_single_supports(name: str) -> None:
    support = performed(name).support
    assert support.any(axis=1).all()
    single = [n / RATE_HZ for i in (0, 1) for n in runs(support[:, i] & ~support[:, 1 - i])]
    count, least = SINGLE_SUPPORTS.get(name, (0, 0.0))
    assert len(single) == count
    assert min(single, default=least) >= least


@pytest.mark.parametrize("name", MOVING)
def test_the_motion_is_smooth(name: str) -> None:
    position = performed(name).position
    acceleration = np.linalg.norm(np.diff(position, 2, axis=0), axis=2) * RATE_HZ**2
    jerk = np.linalg.norm(np.diff(position, 3, axis=0), axis=2) * RATE_HZ**3
    brisk = name == "walk"
    assert acceleration.max() < (40 if brisk else 12)
    assert acceleration[:, ROLE_INDEX["pelvis"]].max() < (6 if brisk else 3)
    # a jump in the acceleration itself would show as a jerk of its size times the rate
    assert jerk.max() < (1500 if brisk else 300)


@pytest.mark.parametrize("name", MOVING)
def test_it_moves_and_starts_and_ends_standing_at_rest(name: str) -> None:
    truth = performed(name)
    assert 4.0 <= truth.time_s[-1] <= 15.0
    speed = np.linalg.norm(np.diff(truth.position, axis=0), axis=2).max(axis=1) * RATE_HZ
    assert speed.max() > 0.01
    for frame in (0, -1):
        assert speed[frame] < 0.01
        assert truth.support[frame].all()
        np.testing.assert_allclose(truth.orientation[frame, ROLE_INDEX["pelvis"], :, 0], [1, 0, 0], atol=0.06)
        middle = 0.5 * (at(truth, "left_ankle") + at(truth, "right_ankle"))[frame, :2]
        np.testing.assert_allclose(truth.com[frame, :2], middle, atol=0.06)
        assert np.degrees(max(truth.joint_angle[f"{s}_knee"][frame] for s in SIDES)) < 25


def test_the_t_pose_is_the_rest_pose() -> None:
    truth = performed("t_pose")
    np.testing.assert_array_equal(truth.position, np.broadcast_to(BODY.rest, truth.position.shape))
    np.testing.assert_array_equal(truth.orientation, np.broadcast_to(np.eye(3), truth.orientation.shape))
    np.testing.assert_allclose([a.max() for a in truth.joint_angle.values() if a.max() < 1], 0, atol=1e-12)
    np.testing.assert_allclose(truth.joint_angle["left_shoulder_elevation"], np.pi / 2)


def test_lengths_are_those_of_the_table() -> None:
    rest = {role: BODY.rest[i] / BODY.height_m for role, i in ROLE_INDEX.items()}
    assert rest["left_ankle"][2] == pytest.approx(0.039)
    assert rest["left_knee"][2] == pytest.approx(0.285)
    assert rest["left_hip"][2] == pytest.approx(0.530)
    assert rest["left_shoulder"][2] == pytest.approx(0.818)
    assert rest["head_top"][2] == pytest.approx(1.0)
    assert rest["left_wrist"][1] - rest["left_shoulder"][1] == pytest.approx(0.186 + 0.146)
    assert rest["left_toe_tip"][0] - rest["left_heel"][0] == pytest.approx(0.152)


@pytest.mark.parametrize(("sex", "expected"), [("male", 0.566), ("female", 0.569)])
def test_com_height_of_a_standing_person(sex: str, expected: float) -> None:
    body = Body(sex=sex)
    truth = play("stand", body, Options(), RATE_HZ)
    np.testing.assert_allclose(truth.com[:, 2] / body.height_m, expected, rtol=0.01)


@pytest.mark.parametrize("sex", ["male", "female"])
def test_masses_sum_to_one(sex: str) -> None:
    assert sum(s.mass for s in masses.deleva(sex)) == pytest.approx(1.0, abs=2e-4)
    assert sum(s.mass for s in masses.winter()) == pytest.approx(1.0, abs=1e-9)
    assert masses.full_weights(sex).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_other_side_is_the_mirror_image(name: str) -> None:
    left, right = performed(name, "left"), performed(name, "right")
    for role in ROLE_INDEX:
        other = role.replace("left", "x").replace("right", "left").replace("x", "right")
        np.testing.assert_allclose(at(right, role), at(left, other) * [1, -1, 1], atol=1e-12)
    np.testing.assert_array_equal(right.support, left.support[:, ::-1])
    check_body(right, BODY)
    twice = mirrored(mirrored(left))
    np.testing.assert_allclose(twice.orientation, left.orientation, atol=1e-12)


@pytest.mark.parametrize("name", ["squat", "open_close_drawer"])
def test_symmetric_motions_are_symmetric(name: str) -> None:
    truth = performed(name)
    for part in ("elbow", "wrist", "hand", "knee", "ankle", "toe_tip"):
        np.testing.assert_allclose(
            at(truth, f"right_{part}"), at(truth, f"left_{part}") * [1, -1, 1], atol=1e-9
        )
    np.testing.assert_allclose(truth.com[:, 1], 0, atol=1e-9)


def test_single_leg_balance_stretches_the_leg_back_and_raises_the_arms() -> None:
    truth = performed("single_leg_balance")
    middle = len(truth.time_s) // 2
    assert truth.support[middle].tolist() == [True, False]
    assert at(truth, "right_ankle")[middle, 0] < at(truth, "pelvis")[middle, 0] - 0.6
    assert np.degrees(truth.joint_angle["right_knee"][middle]) < 40
    for side in SIDES:
        assert np.degrees(truth.joint_angle[f"{side}_shoulder_elevation"][middle]) > 75
        assert at(truth, f"{side}_wrist")[middle, 2] > at(truth, "chest")[middle, 2]


@pytest.mark.parametrize("hand_speed", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("pace", [1.0, 1.5])
def test_hand_updown_reaches_its_speed(hand_speed: float, pace: float) -> None:
    truth = play("hand_updown", BODY, Options(speed=pace, hand_speed_m_s=hand_speed), 240.0)
    hand = at(truth, "right_hand")
    speed = np.linalg.norm(np.diff(hand, axis=0), axis=1) * 240.0
    steady = slice(int(4.0 / pace * 240), int(8.0 / pace * 240))
    assert speed[steady].max() == pytest.approx(hand_speed, rel=0.01)
    assert np.ptp(hand[steady, :2], axis=0).max() < 1e-9
    assert np.ptp(hand[steady, 2]) > 0.3


def test_hands_hold_the_drawers_handle() -> None:
    truth = performed("open_close_drawer")
    assert truth.handle is not None
    assert truth.grasped is not None
    held = truth.grasped
    handle = truth.handle[:, :3, 3]
    assert 0.2 <= np.ptp(handle[held, 0]) <= 0.3
    np.testing.assert_array_equal(handle[~held], np.broadcast_to(handle[0], handle[~held].shape))
    for side in SIDES:
        grip = (at(truth, f"{side}_hand") - handle)[held]
        np.testing.assert_allclose(grip, np.broadcast_to(grip[0], grip.shape), atol=1e-9)
        assert np.abs(grip[0, [0, 2]]).max() < 1e-9


@pytest.mark.parametrize("name", ["step_forward", "two_steps_and_reach", "walk"])
def test_step_length(name: str) -> None:
    truth = play(name, BODY, Options(step_length_m=0.25), RATE_HZ)
    standing = at(truth, "left_ankle")[truth.support[:, 0], 0]
    places = np.unique(standing.round(6))
    first = places[1] - places[0]
    assert first == pytest.approx(0.25)
    assert places[-1] == pytest.approx(0.25 * (1 if name != "walk" else 5))


@pytest.mark.parametrize("name", sorted(n for n, s in SCENARIOS.items() if s.stretchable))
def test_duration(name: str) -> None:
    truth = play(name, BODY, Options(duration_s=20.0), 60.0)
    assert truth.time_s[-1] == pytest.approx(20.0)
    check_feet(truth)
    check_ranges(truth)


def test_speed_only_scales_time() -> None:
    slow, fast = (play("squat", BODY, Options(speed=s), RATE_HZ * s) for s in (0.5, 2.0))
    np.testing.assert_allclose(fast.time_s[-1], slow.time_s[-1] / 4)
    np.testing.assert_allclose(fast.position, slow.position, atol=1e-9)


def test_the_rate_only_samples() -> None:
    coarse, fine = (play("two_steps_and_reach", BODY, Options(), rate) for rate in (60.0, 240.0))
    np.testing.assert_allclose(coarse.position, fine.position[::4], atol=8e-3)
    np.testing.assert_allclose(coarse.com[:, :2], fine.com[::4, :2], atol=1e-5)
    for role in ("left_ankle", "right_toe_tip"):
        np.testing.assert_allclose(at(coarse, role), at(fine, role)[::4], atol=1e-9)
    np.testing.assert_array_equal(coarse.support, fine.support[::4])


def test_an_impossible_step_is_refused() -> None:
    small = Body(height_m=0.6)
    with pytest.raises(ImitorError, match=r"left foot would be .* shorter steps \(step_length_m\)"):
        play("step_forward", small, Options(step_length_m=0.8), RATE_HZ)


def test_an_arm_that_cannot_fold_is_refused() -> None:
    odd = Body(ratios={"upper_arm": 2.0, "forearm": 0.5})
    with pytest.raises(ImitorError, match="cannot fold that far; make them more alike"):
        play("hand_updown", odd, Options(), RATE_HZ)


def test_an_unknown_segment_is_refused() -> None:
    with pytest.raises(ImitorError, match="no segment is called 'thig'; did you mean 'thigh'"):
        Body(ratios={"thig": 1.1})


bodies = st.builds(
    Body,
    height_m=st.floats(0.9, 2.2),
    sex=st.sampled_from(["male", "female"]),
    ratios=st.dictionaries(st.sampled_from(sorted(FRACTIONS)), st.floats(0.85, 1.15), max_size=4),
)


@settings(max_examples=60, deadline=None)
@given(
    name=st.sampled_from(sorted(SCENARIOS)),
    body=bodies,
    speed=st.floats(0.5, 2.0),
    side=st.sampled_from([None, "left", "right"]),
)
def test_any_body_performs_any_scenario(name: str, body: Body, speed: float, side: str | None) -> None:
    truth = play(name, body, Options(side=side, speed=speed), 60.0)
    check_body(truth, body)
    check_feet(truth)
    check_ranges(truth)
    if SCENARIOS[name].quasi_static:
        assert balance_margin(truth, body).min() > 0.01 * body.height_m
