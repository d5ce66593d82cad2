"""The performer as a source: options, frames, markers and targets, seeded degradation."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from pydantic import ValidationError

from imitor.human.markers import MARKERS_41, TARGETS
from imitor.human.scenarios import SCENARIOS
from imitor.plugins.sources.performer import Performer, PerformerConfig, ScenarioName
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, Array


def performer(**options: Any) -> Performer:
    source = Performer(PerformerConfig(**options))
    source.start()
    return source


def positions(source: Performer) -> Array:
    return np.array([frame.position for frame in source.frames()])


def test_the_option_names_every_scenario() -> None:
    assert set(get_args(ScenarioName)) == set(SCENARIOS)


def test_frames_are_the_truth_and_cannot_be_written() -> None:
    source = performer(scenario="step_forward", markers="41", targets=True)
    truth = source.truth
    frames = list(source.frames())
    assert source.n_frames == len(frames) == len(truth.time_s)
    assert frames[0].time_s == 0.0
    np.testing.assert_allclose([f.time_s for f in frames], np.arange(len(frames)) / source.rate_hz)
    for i in (0, len(frames) // 2, len(frames) - 1):
        frame = frames[i]
        assert frame.position.shape == (N_ROLES, 3)
        assert frame.support is not None
        pairs = [
            (frame.position, truth.position),
            (frame.orientation, truth.orientation),
            (frame.marker, truth.marker),
            (frame.target, truth.target),
            (frame.com, truth.com),
        ]
        for seen, exact in pairs:
            assert seen is not None
            assert exact is not None
            np.testing.assert_array_equal(seen, exact[i])
            assert not seen.flags.writeable
            assert not exact.flags.writeable
        assert [frame.support.left, frame.support.right] == truth.support[i].tolist()
        assert frame.valid.all()
    again = positions(source)
    np.testing.assert_array_equal(again, truth.position)


def test_skeleton_states_the_body() -> None:
    source = performer(
        height_m=1.6, sex="female", mass_kg=55.0, segment_ratios={"thigh": 1.1}, markers=41, targets=True
    )
    skeleton = source.skeleton
    assert skeleton.roles == frozenset(ROLES)
    assert skeleton.height_m == pytest.approx(1.6 * (1 + 0.245 * 0.1))
    assert (skeleton.sex, skeleton.mass_kg) == ("female", 55.0)
    stand = performer(scenario="stand", height_m=1.6)
    frame = next(stand.frames())
    assert frame.position[ROLE_INDEX["left_ankle"], 2] == pytest.approx(
        stand.skeleton.ankle_height_m, abs=1e-12
    )
    assert frame.position[ROLE_INDEX["right_toe"], 2] == pytest.approx(stand.skeleton.toe_height_m, abs=1e-12)
    assert skeleton.marker_names == MARKERS_41
    assert skeleton.target_names == TARGETS
    assert len(MARKERS_41) == 41
    assert len(TARGETS) == 17


def test_without_the_options_there_are_no_markers_and_targets() -> None:
    frame = next(performer(scenario="stand").frames())
    assert [frame.marker, frame.marker_valid, frame.target, frame.target_valid] == [None] * 4


def test_markers_sit_on_the_body() -> None:
    source = performer(scenario="t_pose", markers="41")
    marker = dict(zip(MARKERS_41, source.truth.marker[0], strict=True))  # type: ignore[index]
    rest = {role: source.skeleton.rest_position[i] for role, i in ROLE_INDEX.items()}
    for name, place in marker.items():
        if name[0] in "LR" and name != "RBAC":
            other = marker[{"L": "R", "R": "L"}[name[0]] + name[1:]]
            np.testing.assert_allclose(place, other * [1, -1, 1], atol=1e-12)
            assert (place[1] > 0) == (name[0] == "L")
    for part, joint in (("ANK", "ankle"), ("KNE", "knee"), ("FIN", "hand"), ("ELB", "elbow")):
        assert np.linalg.norm(marker[f"L{part}"] - rest[f"left_{joint}"]) < 0.08
    wrist = 0.5 * (marker["LWRA"] + marker["LWRB"])
    assert np.linalg.norm(wrist - rest["left_wrist"]) < 0.02
    assert marker["LWRA"][0] > marker["LWRB"][0]  # the thumb points forward when the palm is down

    def normal(p0: Array, p1: Array, p2: Array) -> Array:
        return np.asarray(np.cross(p1 - p0, p2 - p0))

    head = normal(0.5 * (marker["LBHD"] + marker["RBHD"]), marker["RFHD"], marker["LFHD"])
    chest = normal(0.5 * (marker["STRN"] + marker["T10"]), marker["LSHO"], marker["RSHO"])
    assert head[2] > 0.9 * np.linalg.norm(head)
    assert chest[0] > 0.9 * np.linalg.norm(chest)


def test_targets_are_rigid_with_their_segments() -> None:
    source = performer(scenario="slow_dance", targets=True, rate_hz=30)
    truth = source.truth
    assert truth.target is not None
    hand, wrist = TARGETS.index("left_hand"), ROLE_INDEX["left_wrist"]
    R = truth.orientation[:, wrist].swapaxes(1, 2)
    turn = R @ truth.target[:, hand, :3, :3]
    offset = (R @ (truth.target[:, hand, :3, 3] - truth.position[:, wrist])[..., None])[..., 0]
    np.testing.assert_allclose(turn, np.broadcast_to(turn[0], turn.shape), atol=1e-12)
    np.testing.assert_allclose(offset, np.broadcast_to(offset[0], offset.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(truth.target[:, :, :3, :3]), 1.0)
    assert any(not np.allclose(truth.target[0, k, :3, :3], np.eye(3), atol=0.5) for k in range(len(TARGETS)))


def test_degradation_is_seeded_and_spares_the_truth() -> None:
    worse = {"noise_std_m": 0.01, "skin_motion_m": 0.005, "loss": 0.1, "orientation_noise_rad": 0.02}
    options: dict[str, Any] = {"scenario": "step_forward", "markers": "41", "targets": True}
    clean, one, same, other = (
        performer(**options),
        performer(**options, **worse, seed=1),
        performer(**options, **worse, seed=1),
        performer(**options, **worse, seed=2),
    )
    np.testing.assert_array_equal(positions(one), positions(same))
    assert not np.array_equal(positions(one), positions(other), equal_nan=True)
    for name in ("position", "orientation", "support", "com", "marker", "target"):
        np.testing.assert_array_equal(getattr(one.truth, name), getattr(clean.truth, name))
    for a, b in zip(one.frames(), clean.frames(), strict=True):
        assert a.support == b.support
        np.testing.assert_array_equal(a.com, b.com)


def test_asking_for_markers_does_not_change_the_noise_of_the_joints() -> None:
    noisy = {"scenario": "stand", "noise_std_m": 0.01, "loss": 0.05, "seed": 3}
    np.testing.assert_array_equal(positions(performer(**noisy)), positions(performer(**noisy, markers="41")))


def test_noise_has_its_standard_deviation() -> None:
    source = performer(scenario="stand", duration_s=20, noise_std_m=0.02, orientation_noise_rad=0.05)
    frames = list(source.frames())
    error = positions(source) - source.truth.position
    assert np.std(error) == pytest.approx(0.02, rel=0.02)
    assert abs(np.mean(error)) < 1e-3
    assert np.std(np.diff(error, axis=0)) == pytest.approx(0.02 * np.sqrt(2), rel=0.02)  # white
    turn = np.array([f.orientation for f in frames]).swapaxes(2, 3) @ source.truth.orientation
    angle = np.arccos(np.clip((np.trace(turn, axis1=2, axis2=3) - 1) / 2, -1, 1))
    assert np.sqrt(np.mean(angle**2)) == pytest.approx(0.05 * np.sqrt(3), rel=0.02)
    np.testing.assert_allclose(turn @ turn.swapaxes(2, 3), np.broadcast_to(np.eye(3), turn.shape), atol=1e-9)


def test_skin_motion_is_slow() -> None:
    source = performer(scenario="stand", duration_s=60, skin_motion_m=0.01, markers="41")
    assert source.truth.marker is not None
    moved = np.array([f.marker for f in source.frames()]) - source.truth.marker
    assert np.std(moved) == pytest.approx(0.01, rel=0.15)
    power = np.abs(np.fft.rfft(moved * np.hanning(len(moved))[:, None, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(moved), 1 / source.rate_hz)
    assert power[(frequency > 0.4) & (frequency < 4.2)].sum() > 0.99 * power.sum()


@pytest.mark.parametrize(("loss", "burst_s"), [(0.05, 0.1), (0.3, 0.5)])
def test_losses_have_their_share_and_length(loss: float, burst_s: float) -> None:
    source = performer(
        scenario="stand", duration_s=120, loss=loss, loss_burst_s=burst_s, markers="41", targets=True
    )
    frames = list(source.frames())
    lost = ~np.array([f.marker_valid for f in frames])
    assert lost.mean() == pytest.approx(loss, rel=0.2)
    begins = (lost[1:] & ~lost[:-1]).sum()
    assert lost.sum() / begins / source.rate_hz == pytest.approx(burst_s, rel=0.2)
    frame = next(
        f for f in frames if not f.valid.all() and f.target_valid is not None and not f.target_valid.all()
    )
    assert frame.orientation is not None
    assert frame.target is not None
    assert frame.target_valid is not None
    np.testing.assert_array_equal(np.isnan(frame.position).all(axis=1), ~frame.valid)
    np.testing.assert_array_equal(np.isnan(frame.orientation).all(axis=(1, 2)), ~frame.valid)
    np.testing.assert_array_equal(np.isnan(frame.target).all(axis=(1, 2)), ~frame.target_valid)
    assert np.isfinite(frame.position[frame.valid]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"scenario": "squat", "duration_s": 10},
            "'squat' has its own length; change its speed, or choose one of",
        ),
        ({"scenario": "wave", "duration_s": 5}, "'wave' at speed 1 needs at least 5.50 s, got 5"),
        ({"scenario": "wave", "step_length_m": 0.2}, "'wave' makes no step; scenarios that do: step_forward"),
        ({"segment_ratios": {"tigh": 1.1}}, "no segment is called 'tigh'; did you mean 'thigh'"),
        ({"scenario": "jump"}, "Input should be 'cut_with_knife'"),
        ({"loss": 1.0}, "less than 1"),
    ],
)
def test_wrong_options_are_refused_with_a_remedy(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as refused:
        PerformerConfig(**options)
    assert message in str(refused.value)
