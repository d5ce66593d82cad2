"""The times of steps and commands, on a clock of the test's own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor.live.pace import APART, EARLY, Grid, Steps
from imitor.live.statistics import Durations

RATE_HZ = 100.0
PERIOD_S = 1.0 / RATE_HZ


def leave(grid: Grid, ready: list[float]) -> list[tuple[float, float]]:
    """Send what becomes ready, newest wins; return when each command left and how long it had waited (NaN: again)."""
    out, i = [], 0
    while i < len(ready):
        now = max(grid.earliest_s, 0.0)
        while i + 1 < len(ready) and ready[i + 1] <= now:
            i += 1  # replaced
        if ready[i] <= now and grid.is_old(ready[i]) and i + 1 < len(ready) and ready[i + 1] <= grid.latest_s:
            i += 1
        if ready[i] <= grid.latest_s:
            now = max(now, ready[i])
            out.append((now, now - ready[i]))
            grid.left(now, ready[i])
            i += 1
        else:
            out.append((grid.latest_s, np.nan))
            grid.left(grid.latest_s, None)
    return out


@given(
    st.floats(0.0, PERIOD_S),
    st.floats(0.9995, 1.0005),
    st.integers(0, 1000),
    st.sampled_from([0.0, 0.0002, 0.0005]),
)
def test_commands_follow_what_is_ready(phase: float, drift: float, seed: int, sigma_s: float) -> None:
    n = 1500
    jitter = np.random.default_rng(seed).normal(0.0, sigma_s, n)
    ready = (1.0 + phase + drift * PERIOD_S * np.arange(n) + jitter).tolist()
    left = leave(Grid(RATE_HZ, 1.0), ready)
    at, waited = np.array([a for a, _ in left]), np.array([w for _, w in left])
    intervals = np.diff(at)
    assert intervals.min() >= (APART - EARLY) * PERIOD_S - 1e-9
    assert len(at) == pytest.approx(n, rel=0.03)
    settled = waited[600:]
    assert np.nanmedian(settled) <= 0.05 * PERIOD_S
    assert np.isnan(settled).mean() < 0.02


@given(st.floats(20.0, 95.0))
def test_commands_go_on_between_slow_solutions(solved_hz: float) -> None:
    ready = (1.0 + np.arange(200) / solved_hz).tolist()
    left = leave(Grid(RATE_HZ, 1.0), ready)
    rate = (len(left) - 1) / (left[-1][0] - left[0][0])
    assert 0.75 * RATE_HZ < rate < 1.02 * RATE_HZ


def test_steps_begin_when_something_arrives_and_not_oftener_than_the_rate() -> None:
    steps, begun = Steps(RATE_HZ, 0.0), []
    for arrival in np.arange(0.0, 2.0, 0.001).tolist():  # ten times too fast
        if arrival >= steps.due_s:
            begun.append(arrival)
            steps.begun(arrival, waiting=True)
    assert len(begun) == pytest.approx(2.0 * RATE_HZ, rel=0.03)
    steps, waits = Steps(RATE_HZ, 0.0), []
    for k in range(300):
        arrival = 0.0037 + k * PERIOD_S
        begin = max(steps.due_s, arrival)
        waits.append(begin - arrival)
        steps.begun(begin, waiting=steps.due_s > arrival)
    assert max(waits[5:]) == 0.0


@given(st.lists(st.floats(1e-6, 10.0), min_size=1, max_size=500))
def test_quantiles_in_bounded_memory(seconds: list[float]) -> None:
    durations = Durations()
    for s in seconds:
        durations.add(s)
    for share in (0.5, 0.99):
        true = float(np.quantile(seconds, share, method="inverted_cdf"))
        assert durations.quantile(share) == pytest.approx(true, rel=0.02)
    assert durations.largest_s == max(seconds)
    assert durations.count == len(seconds)
