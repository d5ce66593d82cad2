"""Frames at another rate: instants, interpolation, flags, and how many there are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.clock import at_rate
from imitor.types import N_ROLES, HumanFrame, Support

VELOCITY = np.linspace(-1.0, 2.0, 3 * N_ROLES).reshape(N_ROLES, 3)


def linear(n: int, rate_hz: float, start_s: float = 0.0) -> Iterator[HumanFrame]:
    """Points that move at constant speed; support and orientation say which frame it was."""
    for i in range(n):
        time_s = start_s + i / rate_hz
        yield HumanFrame(
            time_s, VELOCITY * time_s, np.ones(N_ROLES, dtype=bool), np.full((N_ROLES, 3, 3), float(i)),
            com=VELOCITY[0] * time_s, support=Support(i % 2 == 0, True), marker=VELOCITY[:4] * time_s,
            marker_valid=np.ones(4, dtype=bool),
        )  # fmt: skip


def expected_count(n: int, source_hz: float, rate_hz: float) -> int:
    """Instants within the recording: what the builder promises to progress bars and sinks."""
    return int((n - 1) * rate_hz / source_hz + 1e-9) + 1


@given(
    n=st.integers(1, 60), source_hz=st.sampled_from([24.0, 30.0, 59.94, 60.0, 100.0, 119.88, 120.0, 240.0]),
    rate_hz=st.sampled_from([10.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 500.0]), start_s=st.floats(0, 1e3),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_instants_and_points_are_exact(n: int, source_hz: float, rate_hz: float, start_s: float) -> None:
    out = list(at_rate(linear(n, source_hz, start_s), source_hz, rate_hz))
    for k, frame in enumerate(out):
        assert frame.time_s == pytest.approx(start_s + k / rate_hz, abs=1e-9)
        if frame.time_s <= start_s + (n - 1) / source_hz:
            np.testing.assert_allclose(frame.position, VELOCITY * frame.time_s, atol=1e-6)
            assert frame.com is not None and frame.marker is not None
            np.testing.assert_allclose(frame.com, VELOCITY[0] * frame.time_s, atol=1e-6)
            np.testing.assert_allclose(frame.marker, VELOCITY[:4] * frame.time_s, atol=1e-6)


@given(
    n=st.integers(1, 60), source_hz=st.sampled_from([24.0, 30.0, 60.0, 100.0, 120.0]),
    rate_hz=st.sampled_from([10.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 500.0]),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_there_are_as_many_as_the_recording_is_long(n: int, source_hz: float, rate_hz: float) -> None:
    assert len(list(at_rate(linear(n, source_hz), source_hz, rate_hz))) == expected_count(
        n, source_hz, rate_hz
    )


def test_the_same_rate_passes_the_frames_on() -> None:
    frames = list(linear(5, 30.0))
    assert all(a is b for a, b in zip(at_rate(iter(frames), 30.0, 30.0), frames, strict=True))


def test_nothing_gives_nothing() -> None:
    assert list(at_rate(iter(()), 30.0, 60.0)) == []


def test_what_is_no_point_comes_from_the_nearer_frame() -> None:
    out = list(at_rate(linear(3, 10.0), 10.0, 40.0))
    first = [float(f.orientation[0, 0, 0]) for f in out if f.orientation is not None]
    assert first[:5] in ([0.0, 0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0, 1.0])
    assert [f.support.left for f in out if f.support is not None][0::4] == [True, False, True]


def test_a_point_is_valid_when_it_is_in_both_frames() -> None:
    frames = list(linear(3, 10.0))
    for frame, lost in zip(frames, ([], [2], []), strict=True):
        frame.valid[lost] = False
        frame.position = np.where(frame.valid[:, None], frame.position, np.nan)
    out = list(at_rate(iter(frames), 10.0, 20.0))[:5]
    assert [bool(f.valid[2]) for f in out] == [True, False, False, False, True]
    for frame in out:
        assert (np.isnan(frame.position).any(axis=1) == ~frame.valid).all()


def test_uneven_times_are_followed() -> None:
    times = [0.0, 0.02, 0.09, 0.1, 0.2]
    frames = [HumanFrame(t, VELOCITY * t, np.ones(N_ROLES, dtype=bool)) for t in times]
    out = list(at_rate(iter(frames), 20.0, 50.0))[:11]
    np.testing.assert_allclose([f.time_s for f in out], np.arange(11) / 50.0, atol=1e-12)
    for frame in out:
        np.testing.assert_allclose(frame.position, VELOCITY * frame.time_s, atol=1e-9)


def test_the_input_is_not_written() -> None:
    frames = list(linear(4, 10.0))
    for frame in frames:
        frame.position.flags.writeable = frame.valid.flags.writeable = False
    before = [f.position.copy() for f in frames]
    list(at_rate(iter(frames), 10.0, 35.0))
    for frame, position in zip(frames, before, strict=True):
        np.testing.assert_array_equal(frame.position, position)
