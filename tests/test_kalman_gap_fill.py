"""The filter kalman_gap_fill: what is seen passes, losses are bridged for a while, segments carry their markers."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from captured_people import Person, perform
from imitor import HumanFrame, testing
from imitor.kinds import Context
from imitor.motion.point_tracker import MODELS, PointTracker, TrackerOptions
from imitor.plugins.filters.kalman_gap_fill import KalmanGapFill, KalmanGapFillConfig, companions_of
from imitor.plugins.sources.c3d import C3d, C3dConfig
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.plugins.sources.trc import Trc, TrcConfig
from imitor.types import N_ROLES, ROLE_INDEX, Array, BoolArray, Skeleton
from known import known

DT = 1.0 / 60.0


@pytest.fixture(scope="module")
def walker() -> Person:
    return perform("walk")


def worn() -> Skeleton:
    performer = Performer(PerformerConfig(scenario="stand", markers="41"))
    performer.start()
    return performer.skeleton


def make(skeleton: Skeleton, dt_s: float = DT, **options: Any) -> KalmanGapFill:
    context = Context(testing.make_robot(), skeleton, dt_s)
    gap_fill = KalmanGapFill(KalmanGapFillConfig(**options), context)
    gap_fill.start()
    gap_fill.reset()
    return gap_fill


def played(gap_fill: KalmanGapFill, person: Person, seen: BoolArray) -> tuple[Array, BoolArray]:
    """Let the markers through the filter, some of them lost; return them and which are known."""
    marker = np.where(seen[..., None], person.file.position, np.nan)
    out, valid = [], []
    for i in range(len(seen)):
        frame = HumanFrame(i * DT, person.truth.position[i], np.ones(N_ROLES, dtype=bool))
        frame.marker, frame.marker_valid = marker[i], seen[i]
        result = gap_fill.step(frame)
        out.append(known(result.marker))
        valid.append(known(result.marker_valid))
    return np.array(out), np.array(valid)


def all_seen(person: Person) -> BoolArray:
    return np.ones(person.file.position.shape[:2], dtype=bool)


# ---------------------------------------------------------------- what passes


def test_what_is_seen_passes_unchanged(walker: Person) -> None:
    seen = all_seen(walker)
    seen[100:110, 3] = False
    out, valid = played(make(worn()), walker, seen)
    np.testing.assert_array_equal(out[seen], walker.file.position[seen])
    assert valid.all()


def test_nothing_is_made_of_what_was_never_seen(walker: Person) -> None:
    seen = all_seen(walker)
    seen[:, 5] = False
    seen[:50, 7] = False
    out, valid = played(make(worn()), walker, seen)
    assert not valid[:, 5].any() and np.isnan(out[:, 5]).all()
    assert not valid[:50, 7].any() and valid[50:, 7].all()


@pytest.mark.parametrize("longest", [0.0, 0.1, 0.5])
def test_a_long_loss_is_a_loss_again(walker: Person, longest: float) -> None:
    seen = all_seen(walker)
    seen[100:160, 12] = False
    out, valid = played(make(worn(), max_gap_s=longest), walker, seen)
    bridged = round(longest / DT)
    assert valid[:, 12].tolist() == [True] * (100 + bridged) + [False] * (60 - bridged) + [True] * (
        len(valid) - 160
    )
    assert np.isnan(out[100 + bridged : 160, 12]).all()


def test_it_looks_at_no_later_frame(walker: Person) -> None:
    seen = all_seen(walker)
    seen[100:120, ::4] = False
    whole, _ = played(make(worn()), walker, seen)
    cut = Person(walker.truth, replace(walker.file, position=walker.file.position[:115]))
    part, _ = played(make(worn()), cut, seen[:115])
    np.testing.assert_array_equal(whole[:115], part)
    assert make(worn()).delay_frames == 0


# ---------------------------------------------------------------- how well


@pytest.mark.parametrize("model", MODELS)
def test_a_marker_in_company_is_carried(walker: Person, model: str) -> None:
    # The performer's segments are rigid: only the speed with which the state takes the place over counts.
    seen = all_seen(walker)
    column = walker.file.labels.index("LHEE")
    seen[200:224, column] = False
    out, _ = played(make(worn(), model=model), walker, seen)
    error = np.linalg.norm(out[200:224, column] - walker.file.position[200:224, column], axis=1)
    held = np.linalg.norm(walker.file.position[199, column] - walker.file.position[200:224, column], axis=1)
    assert held.max() > 0.1
    assert error.max() < 0.02
    alone, _ = played(make(worn(), model=model, rigid=False), walker, seen)
    assert np.linalg.norm(alone[223, column] - walker.file.position[223, column]) > error.max()


def test_lost_joints_are_bridged_too() -> None:
    options = {"scenario": "walk", "markers": "41", "rate_hz": 60.0}
    performer = Performer(PerformerConfig(**options))
    performer.start()
    truth = performer.truth.position
    knee = ROLE_INDEX["left_knee"]
    for roles in (True, False):
        gap_fill = make(performer.skeleton, roles=roles)
        frames = []
        for i, frame in enumerate(performer.frames()):
            if 200 <= i < 224:
                valid, position = frame.valid.copy(), frame.position.copy()
                valid[knee], position[knee] = False, np.nan
                frame.valid, frame.position = valid, position
            frames.append(gap_fill.step(frame))
        assert frames[210].valid[knee] == roles
        if roles:
            error = [
                float(np.linalg.norm(frames[i].position[knee] - truth[i, knee])) for i in range(200, 224)
            ]
            assert max(error) < 0.03
            assert not frames[210].position.flags.writeable


def test_a_body_that_moves_evenly_is_followed_exactly() -> None:
    rng = np.random.default_rng(1)
    shape = rng.normal(size=(6, 3))
    tracker = PointTracker(6, DT, [[] for _ in range(6)], TrackerOptions())
    seen = np.ones(6, dtype=bool)
    for i in range(80):
        now = shape + i * DT * np.array([1.2, 0.3, 0.0])
        seen[2] = i < 60
        out, known_points = tracker.update(np.where(seen[:, None], now, np.nan), seen)
        assert known_points.all()
        np.testing.assert_allclose(out, now, atol=1e-9)


@pytest.mark.parametrize("companions", [1, 2, 3, 4])
def test_a_rigid_segment_carries_its_points(companions: int) -> None:
    rng = np.random.default_rng(companions)
    shape = rng.normal(scale=0.1, size=(companions + 1, 3))
    tracker = PointTracker(
        companions + 1, DT, [[[j for j in range(companions + 1) if j != i]] for i in range(companions + 1)],
        TrackerOptions(),
    )  # fmt: skip
    seen = np.ones(companions + 1, dtype=bool)
    error = held = 0.0
    last = np.zeros(3)
    for i in range(90):
        angle = 1.5 * np.sin(2.0 * i * DT)
        R = np.array(
            [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
        )
        now = shape @ R.T + [0.5 * np.sin(3.0 * i * DT), 0.0, 1.0]
        seen[0] = i < 66
        last = now[0] if seen[0] else last
        out, _ = tracker.update(np.where(seen[:, None], now, np.nan), seen)
        error, held = float(np.linalg.norm(out[0] - now[0])), float(np.linalg.norm(last - now[0]))
    assert held > 0.1
    assert error < (0.02 if companions >= 3 else 0.6 * held)


def test_reset_forgets(walker: Person) -> None:
    seen = all_seen(walker)
    seen[50:60, ::3] = False
    gap_fill = make(worn())
    first, _ = played(gap_fill, walker, seen)
    gap_fill.reset()
    again, _ = played(gap_fill, walker, seen)
    np.testing.assert_array_equal(first, again)


def test_companions_are_the_markers_of_the_same_segment() -> None:
    skeleton = worn()
    names = skeleton.marker_names
    companions = [[[names[i] for i in group] for group in groups] for groups in companions_of(skeleton)]
    assert companions[names.index("LKNE")] == [["LTHI"], ["LSHN", "LANK"]]
    assert companions[41 + ROLE_INDEX["left_knee"]] == [["LTHI", "LKNE"], ["LKNE", "LSHN", "LANK"]]
    assert companions[41 + ROLE_INDEX["right_shoulder"]][1] == ["RSHO", "RUPA", "RELB"]
    assert companions[41 + ROLE_INDEX["pelvis"]] == [["LFWT", "RFWT", "LBWT", "RBWT"]]
    assert companions_of(replace(skeleton, marker_names=(), marker_segments={})) == [
        [] for _ in range(N_ROLES)
    ]


# ---------------------------------------------------------------- recordings


WALKS = ("cmu_c3d/02_01.c3d", "c3d_markers/PiG_Motion-FlatFoot-Hole.c3d", "c3d_markers/rehazenter_2014001_C1_01.c3d",
         "trc/walk_opensim_markers.trc")  # fmt: skip


def cut_losses(path: Path) -> dict[str, list[tuple[float, float, float, float]]]:
    """Lose every marker halfway; return filled after 100 and 400 ms, held after both [m], alone and in company."""
    errors: dict[str, list[tuple[float, float, float, float]]] = {"alone": [], "company": []}
    if path.suffix == ".c3d":
        pytest.importorskip("ezc3d")
    source = C3d(C3dConfig(path=str(path))) if path.suffix == ".c3d" else Trc(TrcConfig(path=str(path)))
    source.start()
    marker, dt = known(source.recording.marker), 1.0 / source.rate_hz
    companions = companions_of(source.skeleton)[: marker.shape[1]]
    start, after = len(marker) // 2, [round(0.1 / dt) - 1, round(0.4 / dt) - 1]
    ready = PointTracker(marker.shape[1], dt, companions, TrackerOptions())
    everything = np.ones(marker.shape[1], dtype=bool)
    for k in range(start - round(0.6 / dt), start):
        ready.update(marker[k], everything)
    for i in range(marker.shape[1]):
        for name, lost in (("alone", [i, *(j for g in companions[i] for j in g)]), ("company", [i])):
            if name == "company" and max(map(len, companions[i]), default=0) < 3:
                continue
            seen = everything.copy()
            seen[lost] = False
            tracker = copy.deepcopy(ready)
            out = [tracker.update(marker[start + k], seen)[0][i] for k in range(after[1] + 1)]
            off = [float(np.linalg.norm(out[k] - marker[start + k, i])) for k in after]
            held = [float(np.linalg.norm(marker[start - 1, i] - marker[start + k, i])) for k in after]
            errors[name].append((off[0], off[1], held[0], held[1]))
    return errors


@pytest.mark.shared
@pytest.mark.slow
def test_losses_cut_into_walks_are_bridged(shared: Path) -> None:
    """Mean error in cm after 100 and 400 ms: a marker alone 2 and 12, in company of three or more 1 and 3."""
    found = [cut_losses(shared / "mocap" / file) for file in WALKS]
    for name, most in (("alone", (0.02, 0.12)), ("company", (0.01, 0.03))):
        errors = [e for one in found for e in one[name]]
        off_early, off_late, held_early, held_late = np.mean(errors, axis=0)
        assert len(errors) > 100
        assert off_early < most[0] and off_late < most[1], name
        assert off_early < 0.5 * held_early and off_late < 0.5 * held_late, name


@pytest.mark.shared
@pytest.mark.slow
def test_who_stands_up_is_bridged_better_than_held(shared: Path) -> None:
    for name, errors in cut_losses(shared / "mocap" / "trc/STS1.trc").items():
        off_early, off_late, held_early, held_late = np.mean(errors, axis=0)
        assert off_early < held_early and off_late < held_late, name


@pytest.mark.parametrize(("swinging", "low", "high"), [(True, 0.8, 1.0), (False, 0.0, 0.4)])
def test_a_swing_is_told_from_a_way(swinging: bool, low: float, high: float) -> None:
    dt = 0.01
    tracker = PointTracker(6, dt, [[] for _ in range(6)], TrackerOptions())
    for t in np.arange(0.0, 2.0, dt):
        places = np.array(np.arange(18.0).reshape(6, 3), dtype=np.float64)
        places[:2, 0] += 0.2 * np.sin(4.0 * np.pi * t) if swinging else 0.3 * t
        tracker.update(places, np.ones(6, dtype=bool))
    assert low <= tracker._swings() <= high
