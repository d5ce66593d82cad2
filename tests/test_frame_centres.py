"""Joint centres of one frame are those of the clip, whatever the marker set and whatever is lost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from captured_people import perform
from imitor.human.rotations import about_z
from imitor.motion.frame_centres import FrameCentres, heel_down, inwards_of
from imitor.motion.joint_centres import fit_centres, joint_centres
from imitor.motion.joint_centres import inwards_of as inwards_of_clip
from imitor.motion.marker_recording import MarkerOptions, learn_markers
from imitor.motion.marker_sets import LANDMARKS, NEEDED, choose_marker_set
from imitor.registry import Registry
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array

CARDS = Registry(entry_points=False).cards("markersets")
OPTIONAL = sorted(set(LANDMARKS) - set(NEEDED))


def landmarks_of(scenario: str) -> dict[str, Array]:
    file = perform(scenario).file
    fit = choose_marker_set("a.c3d", file.labels, "auto", "", CARDS)
    return {n: file.position[:, list(c)].mean(axis=1) for n, c in fit.landmarks.items()}


def by_frames(points: dict[str, Array], height_m: float) -> Array:
    centres = FrameCentres(fit_centres(points, height_m), points)
    rows = {n: p.tolist() for n, p in points.items()}
    out = np.full((len(points["left_asis"]), N_ROLES, 3), np.nan)
    for i in range(len(out)):
        for role, place in centres.place({n: r[i] for n, r in rows.items()}).items():
            out[i, ROLE_INDEX[role]] = place
    return out


@pytest.mark.parametrize("scenario", ["walk", "wave", "squat"])
def test_they_are_those_of_a_recording(scenario: str) -> None:
    points = landmarks_of(scenario)
    np.testing.assert_allclose(by_frames(points, 1.75), joint_centres(points, 1.75), atol=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.sets(st.sampled_from(OPTIONAL)), st.integers(0, 2**32 - 1), st.floats(0.0, 0.2))
def test_any_set_and_any_losses(optional: set[str], seed: int, loss: float) -> None:
    rng = np.random.default_rng(seed)
    names = [*NEEDED, *sorted(optional)]
    if "sacrum" not in names:
        names += [f"{s}_psis" for s in SIDES]
    if not {"c7", "clavicle"} & set(names):
        names += [f"{s}_shoulder" for s in SIDES]
    points = {n: rng.normal(size=(12, 3)) for n in dict.fromkeys(names)}
    for p in points.values():
        p[rng.random(12) < loss] = np.nan
    with np.errstate(all="ignore"):
        clip = joint_centres(points, 1.7)
    found = by_frames(points, 1.7)
    # While an arm is straight the clip looks ahead, and the frame does not.
    arms = [ROLE_INDEX[f"{s}_{j}"] for s in SIDES for j in ("elbow", "hand")]
    rest = [i for i in range(N_ROLES) if i not in arms]
    np.testing.assert_allclose(found[:, rest], clip[:, rest], atol=1e-9)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(clip))


def straightening_arm(turn_rad: float) -> tuple[dict[str, Array], Array]:
    """Return landmarks of a body whose hanging arms are bent, then straight while it turns; and the turns."""
    n = 20
    bend = np.where(np.arange(n) < 5, 0.8, 0.0)
    body: dict[str, tuple[float, float, float]] = {}
    for side, y in (("left", 1.0), ("right", -1.0)):
        body |= {
            f"{side}_asis": (0.1, 0.12 * y, 1.0), f"{side}_psis": (-0.1, 0.05 * y, 1.0),
            f"{side}_shoulder": (0.0, 0.2 * y, 1.45), f"{side}_knee_lateral": (0.0, 0.15 * y, 0.5),
            f"{side}_ankle_lateral": (0.0, 0.15 * y, 0.08), f"{side}_elbow_lateral": (0.0, 0.24 * y, 1.1),
        }  # fmt: skip
    body["c7"] = (-0.06, 0.0, 1.5)
    R = about_z(np.where(np.arange(n) < 5, 0.0, np.linspace(0.0, turn_rad, n)))
    points = {name: np.einsum("tij,j->ti", R, p) for name, p in body.items()}
    for side, y in (("left", 1.0), ("right", -1.0)):
        wrist = np.stack([0.25 * np.sin(bend), np.full(n, 0.205 * y), 1.1 - 0.25 * np.cos(bend)], axis=1)
        points[f"{side}_wrist"] = np.einsum("tij,tj->ti", R, wrist)
    return points, R


def test_a_straight_arm_keeps_the_axis_that_it_had_in_the_body() -> None:
    points, R = straightening_arm(np.pi)
    found = by_frames(points, 1.75)[:, ROLE_INDEX["left_elbow"]]
    in_body = np.einsum("tji,tj->ti", R, found)
    assert np.ptp(in_body[5:], axis=0).max() < 1e-9  # it turns with the body
    assert np.abs(in_body[5:, 1] - 0.205).max() < 5e-3  # 35 mm inwards of the marker, as while it was bent


def test_the_memory_can_be_put_back() -> None:
    points, _ = straightening_arm(0.0)
    rows = [{n: p[i].tolist() for n, p in points.items()} for i in range(20)]
    centres = FrameCentres(fit_centres(points, 1.75), points)
    fresh = centres.place(rows[10])
    kept = centres.memory
    centres.place(rows[0])
    bent_before = centres.place(rows[10])
    assert bent_before["left_elbow"] != fresh["left_elbow"]
    centres.memory = kept
    assert centres.place(rows[10]) == fresh


def test_a_joint_lies_where_the_clip_puts_it() -> None:
    rng = np.random.default_rng(4)
    outer, above, outwards = rng.normal(size=(3, 20, 3))
    clip = inwards_of_clip(outer, above, -outwards, 0.05)
    for i in range(20):
        found = inwards_of(outer[i].tolist(), above[i].tolist(), outwards[i].tolist(), -1.0, 0.05)
        np.testing.assert_allclose(found, clip[i], atol=1e-12)
    assert np.isnan(inwards_of([0.0] * 3, [0.0] * 3, [1.0, 0.0, 0.0], 1.0, 0.05)).all()


def test_heels_come_down_as_in_a_recording() -> None:
    file = perform("walk").file
    fit = choose_marker_set("a.c3d", file.labels, "auto", "", CARDS)
    learned = learn_markers("a.c3d", file, fit, MarkerOptions(floor=0.0))
    points = {n: file.position[:, list(c)].mean(axis=1) for n, c in fit.landmarks.items()}
    raw = joint_centres(points, learned.centres.height_m)
    for side, down in zip(SIDES, learned.heels, strict=True):
        assert down is not None
        assert np.linalg.norm(down) > 0.01
        at = [ROLE_INDEX[f"{side}_{n}"] for n in ("heel", "toe", "ankle")]
        for i in range(0, len(raw), 25):
            heel, toe, ankle = (raw[i, k].tolist() for k in at)
            np.testing.assert_allclose(
                heel_down(heel, toe, ankle, down.tolist()), learned.clip.position[i, at[0]], atol=1e-12
            )
