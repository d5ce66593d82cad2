"""The state machine of tracking, the person who is followed, and points that jump."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.human.rotations import about_z, logarithm
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.run import run
from imitor.safety.following import Following
from imitor.safety.teleport import Teleport
from imitor.safety.tracking import Request, State, Tracking, TrackingOptions
from imitor.spec import load_pipeline
from imitor.types import N_ROLES, ROLE_INDEX, HumanFrame

DT = 0.01
REGISTRY = Registry(entry_points=False)


def states(seen: str, requests: dict[int, Request] | None = None, **options: Any) -> list[State]:
    """Run the machine over a text of ``+`` (seen) and ``-`` (lost), a frame of 10 ms each."""
    machine = Tracking(TrackingOptions(**options))
    out = []
    for i, mark in enumerate(seen):
        out.append(machine.step(i * DT, mark == "+", (requests or {}).get(i, Request.NONE), "left_knee"))
        machine.returned()
    return out


def letters(found: list[State]) -> str:
    return "".join(s.value[0] if s is not State.PAUSED else "z" for s in found)


def test_short_loss_is_predicted_then_the_person_returns() -> None:
    assert letters(states("++---++")) == "ttppprt"


def test_longer_loss_holds_and_needs_a_stable_person() -> None:
    found = letters(states("+" + "-" * 12 + "+" * 23, predict_s=0.05, stable_s=0.2))
    assert found == "t" + "p" * 5 + "h" * 7 + "h" * 20 + "r" + "tt"


def test_long_loss_stops_and_goes_on_by_itself_only_when_told_so() -> None:
    text = "+" + "-" * 30 + "+" * 30
    by_itself = letters(states(text, stop_s=0.2, stable_s=0.1))
    assert by_itself == "t" + "p" * 10 + "h" * 10 + "s" * 10 + "s" * 10 + "r" + "t" * 19
    waits = letters(states(text, stop_s=0.2, stable_s=0.1, resume="request"))
    assert waits.endswith("s" * 40)


def test_resume_that_comes_too_early_counts_once_the_person_is_stable() -> None:
    text = "+" + "-" * 30 + "+" * 30
    found = letters(states(text, {25: Request.RESUME}, stop_s=0.2, stable_s=0.1, resume="request"))
    assert found[31:41] == "s" * 10
    assert found[41:43] == "rt"


def test_operators_stop_and_pause_wait_for_the_operator() -> None:
    found = letters(states("+" * 80, {10: Request.STOP, 40: Request.RESUME}, stable_s=0.1))
    assert found == "t" * 10 + "s" * 30 + "r" + "t" * 39
    found = letters(states("+" * 80, {10: Request.PAUSE, 40: Request.RESUME}, stable_s=0.1))
    assert found == "t" * 10 + "z" * 30 + "r" + "t" * 39


def test_a_pause_while_stopped_or_waiting_is_heeded_too() -> None:
    text = "+" + "-" * 30 + "+" * 30
    found = letters(states(text, {25: Request.PAUSE, 50: Request.RESUME}, stop_s=0.2, stable_s=0.1))
    assert found[21:51] == "s" * 29 + "r"
    found = letters(states("-" * 5 + "+" * 40, {2: Request.PAUSE, 30: Request.RESUME}, stable_s=0.1))
    assert found == "ww" + "z" * 28 + "r" + "t" * 14


def test_what_the_operator_stops_is_no_loss() -> None:
    machine = Tracking(TrackingOptions())
    machine.step(0.0, True)
    machine.step(DT, True, Request.STOP)
    assert (machine.report.stops, machine.report.losses) == (1, 0)


def test_without_times_a_loss_is_a_stop_at_once() -> None:
    machine = Tracking(TrackingOptions(predict_s=0.0, stop_s=0.0, resume="request"))
    assert machine.step(0.0, True) is State.TRACKING
    assert machine.step(0.01, False, why="left_knee") is State.STOPPED
    assert machine.stopped_at_s == 0.01
    assert "left_knee" in machine.why


requests = st.sampled_from([Request.NONE] * 12 + [Request.PAUSE, Request.RESUME, Request.STOP])


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.booleans(), requests), min_size=1, max_size=300),
    st.sampled_from([0.0, 0.03, 0.1]),
    st.sampled_from([0.0, 0.05, 0.3]),
    st.sampled_from(["automatic", "request"]),
)
def test_the_robot_follows_nobody_who_is_not_seen(
    steps: list[tuple[bool, Request]], predict_s: float, stop_s: float, resume: Any
) -> None:
    machine = Tracking(TrackingOptions(predict_s=predict_s, stop_s=stop_s, resume=resume, stable_s=0.05))
    lost = 0
    ever = False
    for i, (seen, request) in enumerate(steps):
        before = machine.state
        state = machine.step(i * DT, seen, request)
        lost, ever = (0, True) if seen else (lost + 1, ever)
        if state in (State.TRACKING, State.RETURNING):
            assert seen
        if not ever:
            assert state in (State.WAITING, State.STOPPED, State.PAUSED)
        elif lost * DT > stop_s + 1e-6:
            assert state in (State.STOPPED, State.PAUSED)
        if state is State.PREDICTING:
            assert lost * DT <= predict_s + 1e-6
        if state is State.RETURNING and before in (State.HOLDING, State.STOPPED, State.PAUSED):
            assert all(s for s, _ in steps[i - 5 : i + 1])
        if before is State.STOPPED and state is not State.STOPPED and resume == "request":
            assert any(r is Request.RESUME for _, r in steps[: i + 1])


# ---------------------------------------------------------------- the person who is followed


def person(time_s: float, at: float = 0.0, turned: float = 0.0) -> HumanFrame:
    position = np.zeros((N_ROLES, 3))
    position[:, 2] = np.linspace(0.0, 1.7, N_ROLES)
    position[:, 0] += at
    orientation = np.tile(about_z(np.array([turned])), (N_ROLES, 1, 1))
    return HumanFrame(
        time_s, position, np.ones(N_ROLES, dtype=bool), orientation, com=np.array([at, 0.0, 0.9])
    )


def nobody(time_s: float) -> HumanFrame:
    return HumanFrame(time_s, np.full((N_ROLES, 3), np.nan), np.zeros(N_ROLES, dtype=bool))


def test_a_lost_person_slows_down_and_stands() -> None:
    options = TrackingOptions(predict_s=0.1)
    following = Following(options, DT)
    for k in range(20):
        following.step(person(k * DT, at=0.5 * k * DT), State.TRACKING)
    at = [following.step(nobody((20 + k) * DT), State.PREDICTING).position[0, 0] for k in range(20)]
    speed = np.diff(at) / DT
    assert speed[0] == pytest.approx(0.5, abs=0.1)
    assert (np.diff(speed) <= 1e-9).all()
    assert speed[10:] == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None, max_examples=50)
@given(st.floats(0.0, 2.0), st.floats(-2.5, 2.5), st.floats(0.1, 2.0))
def test_the_way_back_has_no_step(far: float, turned: float, blend_m_s: float) -> None:
    options = TrackingOptions(blend_m_s=blend_m_s, blend_rad_s=1.0)
    following = Following(options, DT)
    past = following.step(person(0.0), State.TRACKING)
    past = following.step(nobody(DT), State.HOLDING)
    for k in range(2, 3100):  # two metres at 0.1 m/s take 30 s along the smooth step
        frame = following.step(person(k * DT, at=far, turned=turned), State.RETURNING)
        moved = np.linalg.norm(frame.position - past.position, axis=1).max()
        assert moved <= blend_m_s * DT * 1.01 + 1e-9
        assert frame.com is not None and past.com is not None and past.orientation is not None
        assert np.linalg.norm(frame.com - past.com) <= blend_m_s * DT * 1.01 + 1e-9
        assert frame.orientation is not None
        turn = logarithm(frame.orientation @ past.orientation.transpose(0, 2, 1))
        assert np.linalg.norm(turn, axis=1).max() <= 1.0 * DT * 1.01 + 1e-9
        past = frame
        if following.returned:
            break
    assert following.returned
    assert past.position[0, 0] == pytest.approx(far)


def test_a_loss_on_the_way_back_goes_on_from_there() -> None:
    following = Following(TrackingOptions(), DT)
    following.step(person(0.0), State.TRACKING)
    following.step(nobody(DT), State.HOLDING)
    for k in range(2, 30):
        frame = following.step(person(k * DT, at=1.0), State.RETURNING)
    on_the_way = frame.position[0, 0]
    assert 0.0 < on_the_way < 1.0
    held = following.step(nobody(30 * DT), State.HOLDING)
    again = following.step(person(31 * DT, at=1.0), State.RETURNING)
    assert held.position[0, 0] == pytest.approx(on_the_way, abs=0.02)
    assert again.position[0, 0] == pytest.approx(held.position[0, 0], abs=0.02)


# ---------------------------------------------------------------- points that jump


def test_a_hand_that_jumps_is_lost_and_comes_back_by_a_blend() -> None:
    gate, following = Teleport(20.0), Following(TrackingOptions(blend_m_s=0.5), DT)
    hand = ROLE_INDEX["left_hand"]
    path, lost = [], 0
    for k in range(300):
        frame = person(k * DT)
        if k >= 50:
            frame.position[hand, 0] += 0.73
        frame = gate.step(frame)
        lost += not frame.valid[hand]
        frame = following.step(frame, State.TRACKING, gate.left)
        path.append(frame.position[hand, 0])
        others = np.delete(frame.position, hand, axis=0)
        assert np.array_equal(others, np.delete(person(0).position, hand, axis=0))
    seen = np.array(path)[np.isfinite(path)]
    assert lost == 3
    assert gate.rejected == 3
    assert np.abs(np.diff(seen)).max() <= 0.5 * DT * 1.01
    assert seen[-1] == pytest.approx(0.73)


def test_a_hand_that_jumps_while_the_other_comes_back_is_blended_too() -> None:
    gate, following = Teleport(20.0), Following(TrackingOptions(blend_m_s=0.5), DT)
    hands = [ROLE_INDEX["left_hand"], ROLE_INDEX["right_hand"]]
    path = []
    for k in range(400):
        frame = person(k * DT)
        frame.position[hands[0], 0] += 0.73 * (k >= 50)
        frame.position[hands[1], 0] += 0.6 * (k >= 100) - 0.5 * (k >= 150)
        path.append(following.step(gate.step(frame), State.TRACKING, gate.left).position[hands, 0])
    for column in np.array(path).T:
        seen = column[np.isfinite(column)]
        assert np.abs(np.diff(seen)).max() <= 0.5 * 5 * DT  # over the frames in which it was taken for lost
    assert path[-1] == pytest.approx([0.73, 0.1])


def test_a_human_who_moves_fast_is_not_refused() -> None:
    gate = Teleport(20.0)
    for k in range(100):
        frame = gate.step(person(k * DT, at=12.0 * k * DT))
        assert frame.valid.all()


# ---------------------------------------------------------------- whole runs


class Lossy:
    """A pipeline's source that loses what it is told to."""

    def __init__(self, pipeline: Pipeline, lose: Any) -> None:
        frames, self._lose = pipeline.source.frames, lose
        pipeline.source.frames = lambda: map(self._frame, frames())  # type: ignore[method-assign]

    def _frame(self, frame: HumanFrame) -> HumanFrame:
        lost = self._lose(frame.time_s)
        if not lost:
            return frame
        rows = np.array([i in lost for i in range(N_ROLES)])
        return replace(
            frame,
            position=np.where(rows[:, None], np.nan, frame.position),
            valid=frame.valid & ~rows,
            marker=None if frame.marker is None else np.full_like(frame.marker, np.nan),
            marker_valid=None if frame.marker_valid is None else np.zeros_like(frame.marker_valid),
        )


def test_a_marker_lost_for_long_is_an_emergency_stop() -> None:
    spec = load_pipeline("montecillo_2010", REGISTRY, sets=["settle_s=0"])
    pipeline = Pipeline(spec, REGISTRY)
    wrist = ROLE_INDEX["left_wrist"]
    Lossy(pipeline, lambda t: {wrist} if 1.0 <= t < 1.3 or 2.0 <= t < 3.0 else set())
    status, q = [], []
    for record in pipeline.records(500):
        status.append(record.state.status)
        q.append(record.state.q.copy())
    pipeline.close()
    assert status[:250] == [0] * 250  # the first loss, and the second up to 0.5 s, are bridged
    assert set(status[251:]) == {2}
    assert np.abs(np.diff(np.array(q)[300:], axis=0)).max() == 0.0
    assert pipeline.tracking.report.stops == 1
    assert "left_wrist" in pipeline.tracking.why


def test_after_a_stop_the_run_goes_on_by_a_blend_when_it_is_told_so() -> None:
    sets = ["settle_s=0", "tracking.resume=automatic", "tracking.stable_s=0.3"]
    pipeline = Pipeline(load_pipeline("montecillo_2010", REGISTRY, sets=sets), REGISTRY)
    wrist = ROLE_INDEX["left_wrist"]
    Lossy(pipeline, lambda t: {wrist} if 1.0 <= t < 2.0 else set())
    status, q = [], []
    for record in pipeline.records(400):
        status.append(record.state.status)
        q.append(record.state.q[7:].copy())
    robot = pipeline.robot
    pipeline.close()
    assert status[151] == 2
    assert set(status[231:]) == {0}
    speed = np.abs(np.diff(np.array(q), axis=0)) / DT
    assert (speed <= robot.speed + 1e-9).all()


def test_a_run_that_stopped_says_so(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = load_pipeline("retarget", REGISTRY, sets=["source.scenario=stand", "tracking.resume=request"])
    start = Pipeline._start_source

    def lossy(stage: Any, registry: Registry) -> Any:
        source = start(stage, registry)
        frames = source.frames
        source.frames = lambda: (nobody(f.time_s) if f.time_s > 0.5 else f for f in frames())  # type: ignore[method-assign]
        return source

    monkeypatch.setattr(Pipeline, "_start_source", staticmethod(lossy))
    result = run(spec, REGISTRY, out_dir=tmp_path / "run", max_frames=240)
    assert result.status == "stopped"
    assert "the whole body" in result.message
    assert "tracking.resume=automatic" in result.message
    assert result.metrics["tracking"]["stops"] == 1
    assert result.metrics["figures"]["held_frames"]["stopped"] > 0
