"""Markers of a person of whom everything is known: sets, joint centres, units, axes, gaps, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from captured_people import Person, in_unit, perform, with_labels
from imitor.errors import SourceError, SpecError
from imitor.motion.clip import Clip
from imitor.motion.joint_centres import elbow_axis, inwards_of, joint_centres
from imitor.motion.marker_file import MarkerFile, find_gaps
from imitor.motion.marker_recording import MarkerOptions, make_marker_recording
from imitor.motion.marker_sets import (
    BACKS,
    LANDMARKS,
    NEEDED,
    TOPS,
    choose_marker_set,
    load_marker_set,
)
from imitor.motion.normalise import UP_AXES
from imitor.registry import Registry
from imitor.types import ROLE_INDEX, ROLES, Array
from known import known

CARDS = Registry(entry_points=False).cards("markersets")
FAR = {"toe": 0.03, "head": 0.03, "shoulder": 0.02, "neck": 0.025, "hand": 0.025, "wrist": 0.015}
"""How far a centre may lie from the true one [m]; others 1 cm. The toe's marker lies on top of the foot."""


@pytest.fixture(scope="module")
def walker() -> Person:
    return perform("walk")


def recorded(file: MarkerFile, **options: Any) -> Clip:
    fit = choose_marker_set("a.c3d", file.labels, "auto", "", CARDS)
    return make_marker_recording("a.c3d", file, fit, MarkerOptions(**options))


def error_of(clip: Clip, truth: Array, role: str) -> Array:
    return np.asarray(
        np.linalg.norm(clip.position[:, ROLE_INDEX[role]] - truth[:, ROLE_INDEX[role]], axis=-1)
    )


# ---------------------------------------------------------------- centres


@pytest.mark.parametrize("scenario", ["walk", "squat", "two_steps_and_reach", "single_leg_balance"])
def test_joint_centres_are_those_of_the_person(scenario: str) -> None:
    person = perform(scenario)
    clip = recorded(person.file)
    assert len(clip.skeleton.roles) == 22
    for role in sorted(clip.skeleton.roles):
        bare = role.removeprefix("left_").removeprefix("right_")
        assert error_of(clip, person.truth.position, role).max() < FAR.get(bare, 0.010), role
    assert clip.skeleton.height_m == pytest.approx(1.75, abs=0.03)
    assert clip.facts["floor_m"] == 0.0


def test_the_rest_pose_has_every_role(walker: Person) -> None:
    clip = recorded(walker.file)
    rest = clip.skeleton.rest_position
    assert {r for r in ROLES if np.isfinite(rest[ROLE_INDEX[r]]).all()} == clip.skeleton.roles
    for side, y in (("left", 1), ("right", -1)):
        assert rest[ROLE_INDEX[f"{side}_heel"], 2] == 0.0
        assert rest[ROLE_INDEX[f"{side}_heel"], 0] < 0.0 < rest[ROLE_INDEX[f"{side}_toe"], 0]
        assert y * rest[ROLE_INDEX[f"{side}_wrist"], 1] > 0.6


def test_a_joint_lies_at_right_angles_to_its_limb() -> None:
    rng = np.random.default_rng(1)
    above, outer, outwards = rng.normal(size=(3, 50, 3))
    centre = inwards_of(outer, above, outwards, 0.05)
    np.testing.assert_allclose(np.linalg.norm(centre - outer, axis=1), 0.05)
    np.testing.assert_allclose(((above - centre) * (outer - centre)).sum(axis=1), 0.0, atol=1e-12)
    assert (((outer - centre) * outwards).sum(axis=1) > 0.0).mean() > 0.9


def test_the_elbow_of_a_straight_arm_keeps_its_axis() -> None:
    bend = np.array([1.0, 0.5, 0.0, 0.0, 0.5])
    shoulder = np.zeros((5, 3))
    elbow = np.tile([0.0, 0.0, -0.3], (5, 1))
    wrist = elbow + 0.25 * np.stack([np.sin(bend), 0.0 * bend, -np.cos(bend)], axis=1)
    axis = elbow_axis(shoulder, elbow, wrist, None)
    np.testing.assert_allclose(
        known(axis), np.tile([0.0, 1.0, 0.0], (5, 1)), atol=1e-12
    )  # left, arm bent forward
    assert elbow_axis(shoulder, elbow, None, None) is None


# ---------------------------------------------------------------- unit, axes, floor, time


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
@pytest.mark.parametrize("told", [True, False])
def test_any_unit_gives_the_same_person(walker: Person, unit: str, metres: float, told: bool) -> None:
    file = in_unit(walker.file, unit if told else "", metres)
    clip = recorded(file)
    assert clip.facts["unit"] == unit
    np.testing.assert_allclose(clip.position, recorded(walker.file).position, atol=1e-9)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
@pytest.mark.parametrize("told", [True, False])
def test_any_axis_may_point_up(walker: Person, up: str, told: bool) -> None:
    turned = walker.file.position @ np.array(UP_AXES[up], dtype=float)
    clip = recorded(replace(walker.file, position=turned, up=up if told else ""))
    assert clip.facts["up"] == up
    np.testing.assert_allclose(clip.position, recorded(walker.file).position, atol=1e-9)


def test_the_floor_is_found_and_heels_stand_on_it(walker: Person) -> None:
    lifted = replace(walker.file, position=walker.file.position + np.array([0.0, 0.0, 0.4]))
    clip = recorded(lifted)
    assert clip.facts["floor_m"] == pytest.approx(0.4, abs=0.02)
    assert recorded(lifted, floor="file").facts["floor_m"] == 0.0
    for side in ("left", "right"):
        assert np.quantile(clip.position[:, ROLE_INDEX[f"{side}_heel"], 2], 0.3) == pytest.approx(
            0.0, abs=0.015
        )


def test_a_part_is_read(walker: Person) -> None:
    whole, part = recorded(walker.file), recorded(walker.file, start_s=1.0, stop_s=2.0)
    np.testing.assert_array_equal(part.position, whole.position[60:121])
    assert known(part.marker).shape == (61, 41, 3)
    with pytest.raises(SourceError, match="no frame lies between 99 s and its end"):
        recorded(walker.file, start_s=99.0)


def test_markers_come_along_in_our_world(walker: Person) -> None:
    clip = recorded(
        replace(walker.file, position=walker.file.position @ np.array(UP_AXES["y"], dtype=float), up="")
    )
    np.testing.assert_allclose(known(clip.marker), walker.file.position, atol=1e-9)
    assert clip.skeleton.marker_names == walker.file.labels
    segments = clip.skeleton.marker_segments
    assert set(segments["left_foot"]) == {"LANK", "LHEE", "LTOE", "LMT5"}
    assert {m for members in segments.values() for m in members} == set(walker.file.labels)
    frame = next(clip.frames())
    assert frame.marker is not None and not frame.marker.flags.writeable


# ---------------------------------------------------------------- gaps


def test_gaps_are_counted() -> None:
    seen = np.ones((10, 4), dtype=bool)
    seen[2:5, 0] = seen[7, 0] = seen[8:, 1] = False
    seen[:, 3] = False
    gaps = find_gaps(seen)
    assert (gaps.markers, gaps.count, gaps.frames, gaps.longest, gaps.never) == (2, 3, 6, 3, 1)
    assert find_gaps(seen, [2]).count == 0
    assert (
        gaps.told(4)
        == "4 markers, 3 gaps in 2 of them, 6 marker-frames lost, the longest gap 3 frames; 1 never seen"
    )


def test_a_lost_marker_loses_its_joint_alone(walker: Person) -> None:
    position = walker.file.position.copy()
    position[50:70, walker.file.labels.index("LKNE")] = np.nan
    clip = recorded(replace(walker.file, position=position))
    lost = {r for r in clip.skeleton.roles if not clip.valid[:, ROLE_INDEX[r]].all()}
    assert lost == {
        "left_knee",
        "left_ankle",
        "left_heel",
    }  # the ankle's centre needs the knee's, the heel's that
    assert clip.facts["gaps"] == 1 and clip.facts["gap_frames"] == 20
    assert np.isnan(clip.position[50:70, ROLE_INDEX["left_knee"]]).all()


def test_frames_without_a_body_are_left_out(walker: Person) -> None:
    position = walker.file.position.copy()
    position[:30] = np.nan
    position[-15:] = np.nan
    clip = recorded(replace(walker.file, position=position))
    assert len(clip) == len(position) - 45
    assert "30 frames before and 15 after the body is in view are left out" in clip.skeleton.notes
    assert all(clip.valid[0, ROLE_INDEX[r]] for r in ("pelvis", "neck", "left_ankle", "right_ankle"))


def test_a_body_that_is_never_seen_is_refused(walker: Person) -> None:
    position = walker.file.position.copy()
    position[:, walker.file.labels.index("LFWT")] = np.nan
    with pytest.raises(
        SourceError, match="marker set 'cmu_41': these are never seen: left_asis; a body needs them"
    ):
        recorded(replace(walker.file, position=position))
    position = walker.file.position.copy()
    position[::2, walker.file.labels.index("LFWT")] = np.nan
    position[1::2, walker.file.labels.index("RBWT")] = np.nan
    with pytest.raises(SourceError, match="there is no body"):
        recorded(replace(walker.file, position=position))


# ---------------------------------------------------------------- sets


def test_swapped_sides_are_refused(walker: Person) -> None:
    swapped = {
        n: ("R" if n[0] == "L" else "L") + n[1:] for n in walker.file.labels if n[0] in "LR" and n != "RBAC"
    }
    with pytest.raises(SourceError, match="left and right are swapped"):
        recorded(with_labels(walker.file, swapped))


def test_a_wrong_unit_is_refused(walker: Person) -> None:
    with pytest.raises(SourceError, match=r"the body would be 0\.\d+ m tall: set unit"):
        recorded(walker.file, unit="mm")


def test_a_subject_before_the_labels_is_tolerated(walker: Person) -> None:
    named = with_labels(walker.file, {n: f"Anna: {n}" for n in walker.file.labels})
    clip = recorded(named)
    assert clip.skeleton.name == "cmu_41"
    assert clip.skeleton.marker_names == walker.file.labels


def test_of_two_subjects_one_is_taken(walker: Person) -> None:
    labels = tuple(f"{who}:{n}" for who in ("Anna", "Ben") for n in walker.file.labels)
    both = np.concatenate([walker.file.position, walker.file.position + np.array([0.0, 2.0, 0.0])], axis=1)
    file = replace(walker.file, labels=labels, position=both)
    with pytest.raises(SourceError, match="it holds several subjects: Anna, Ben; set subject to one of them"):
        recorded(file)
    fit = choose_marker_set("a.c3d", file.labels, "auto", "ben", CARDS)
    clip = make_marker_recording("a.c3d", file, fit, MarkerOptions())
    assert clip.position[0, ROLE_INDEX["pelvis"], 1] == pytest.approx(2.0, abs=0.02)
    with pytest.raises(SourceError, match="no label belongs to a subject 'Eve'; subjects: Anna, Ben"):
        choose_marker_set("a.c3d", file.labels, "auto", "Eve", CARDS)


def test_an_unknown_set_is_explained(walker: Person, tmp_path: Path) -> None:
    strange = {n: f"M{i}" for i, n in enumerate(walker.file.labels)}
    with pytest.raises(SourceError) as error:
        recorded(with_labels(walker.file, strange))
    text = str(error.value)
    assert "no marker set fits the markers of this file; the nearest is '" in text
    assert "Markers: 'M0', 'M1', " in text and "'M40'" in text
    assert "--set source.marker_set=FILE.yaml" in text
    # The card that it prints is a card once its question marks are filled in.
    card = text[text.index("title:") :]
    cmu = load_marker_set(CARDS["cmu_41"]).expanded()
    for name in LANDMARKS:
        label = cmu.get(name)
        first = label if isinstance(label, str) else "LFHD" if name == "head" else "?"
        card = card.replace(
            f"  {name}: ?\n", f"  {name}: {strange.get(first, '?')}\n" if first != "?" else ""
        )
    card = card.replace(f"  {LANDMARKS[-1]}: ?", f"  right_toe: {strange['RTOE']}")
    card = card.replace("  head: [?]", f"  head: [{', '.join(strange.values())}]").replace("[?]", "[M0]")
    (tmp_path / "mine.yaml").write_text("\n".join(line for line in card.split("\n") if "?" not in line))
    fit = choose_marker_set("a.c3d", tuple(strange.values()), str(tmp_path / "mine.yaml"), "", CARDS)
    assert (fit.name, len(fit.columns)) == ("mine", 41)


def test_a_set_is_named_or_given(walker: Person, tmp_path: Path) -> None:
    fit = choose_marker_set("a.c3d", walker.file.labels, "cmu_41", "", CARDS)
    assert fit.name == "cmu_41"
    with pytest.raises(SourceError, match="no marker set is called 'cmu41'; did you mean 'cmu_41'"):
        choose_marker_set("a.c3d", walker.file.labels, "cmu41", "", CARDS)
    with pytest.raises(
        SourceError, match="marker set 'plug_in_gait' does not fit: the file has no 'LASI', 'RASI'"
    ):
        choose_marker_set("a.c3d", walker.file.labels, "plug_in_gait", "", CARDS)
    with pytest.raises(SpecError, match="the marker set card cannot be read: No such file"):
        choose_marker_set("a.c3d", walker.file.labels, str(tmp_path / "none.yaml"), "", CARDS)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("  c7: C7", "  c77: C7"), "no landmark is called 'c77'; did you mean 'c7'?"),
        (("  c7: C7", "  c7: C8"), "landmarks.c7: 'C8' is in no segment and not virtual"),
        (('  asis: "{side}FWT"\n', ""), "landmarks are missing: left_asis, right_asis"),
        (('  psis: "{side}BWT"\n', ""), "landmarks are missing: sacrum or left_psis"),
        (("title:", "unit: yard\ntitle:"), "no unit is called 'yard'"),
        (("title:", "sides: {left: L}\ntitle:"), "give a word for left and one for right"),
    ],
)
def test_a_wrong_card_is_refused(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    text = CARDS["cmu_41"].read_text()
    assert change[0] in text
    (tmp_path / "card.yaml").write_text(text.replace(*change))
    with pytest.raises(SpecError) as error:
        load_marker_set(tmp_path / "card.yaml")
    assert said in str(error.value)


@pytest.mark.parametrize("name", sorted(CARDS))
def test_a_card_tells_a_body(name: str) -> None:
    card = load_marker_set(CARDS[name])
    landmarks = card.expanded()
    assert set(NEEDED) <= set(landmarks)
    assert set(BACKS) & set(landmarks) and set(TOPS) & set(landmarks)
    assert len(card.labels()) == len(set(card.labels()))
    # A file with just its labels is recognised as it, not as a relative.
    labels = [
        *card.labels(),
        *(w for v in card.virtual for w in (v.replace("{side}", s) for s in card.sides.values())),
    ]
    assert choose_marker_set("a.c3d", labels, "auto", "", CARDS).name == name


def test_sets_without_arms_or_head_have_what_they_have(walker: Person) -> None:
    keep = [
        n
        for n in walker.file.labels
        if n[1:] not in {"SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN", "FHD", "BHD"}
    ]
    columns = [walker.file.labels.index(n) for n in keep]
    clip = recorded(replace(walker.file, labels=tuple(keep), position=walker.file.position[:, columns]))
    assert not clip.skeleton.has("left_shoulder") and not clip.skeleton.has("left_elbow")
    assert clip.skeleton.has("head")
    assert "head: no marker tells it, it is put over the neck" in clip.skeleton.notes
    assert error_of(clip, walker.truth.position, "head").max() < 0.05
    assert clip.skeleton.height_m == pytest.approx(1.75, abs=0.06)


def test_one_of_two_neck_markers_is_enough(walker: Person) -> None:
    for lost in ("C7", "CLAV"):
        position = walker.file.position.copy()
        position[:, walker.file.labels.index(lost)] = np.nan
        clip = recorded(replace(walker.file, position=position))
        assert error_of(clip, walker.truth.position, "neck").max() < 0.07
        assert clip.skeleton.has("neck", "head", "left_shoulder")


def test_centres_turn_with_the_body() -> None:
    person = perform("wave", rate_hz=10.0)
    fit = choose_marker_set("a.c3d", person.file.labels, "auto", "", CARDS)
    points = {n: person.file.position[:, list(c)].mean(axis=1) for n, c in fit.landmarks.items()}
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    turned = joint_centres({n: p @ turn.T + [1.0, 2.0, 3.0] for n, p in points.items()}, 1.75)
    np.testing.assert_allclose(turned, joint_centres(points, 1.75) @ turn.T + [1.0, 2.0, 3.0], atol=1e-9)
