"""The prioritised step against the textbook recursion, and its properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.ik.clamping import clamped_step
from imitor.ik.hierarchy import prioritised_step


def recursion(levels: list[tuple[np.ndarray, np.ndarray]], g: np.ndarray) -> np.ndarray:
    """[pennapoubel2014] eqs. 4-6 literally, with SVD pseudo-inverses."""
    n = g.shape[0]
    dq, P, augmented = np.zeros(n), np.eye(n), np.zeros((0, n))
    for J, e in levels:
        dq = dq + np.linalg.pinv(J @ P, rcond=1e-9) @ (e - J @ dq)
        augmented = np.vstack([augmented, J])
        P = np.eye(n) - np.linalg.pinv(augmented, rcond=1e-9) @ augmented
    return np.asarray(dq + P @ g)


def problem(seed: int, sizes: list[int], n: int) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    rng = np.random.default_rng(seed)
    return [(rng.normal(size=(m, n)), rng.normal(size=m)) for m in sizes], rng.normal(size=n)


def starts_of(levels: list[tuple[np.ndarray, np.ndarray]]) -> list[int]:
    return [int(k) for k in np.cumsum([0, *[len(e) for _, e in levels]])[:-1]]


def stacked(levels: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return np.vstack([J for J, _ in levels]), np.concatenate([e for _, e in levels])


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    sizes=st.lists(st.integers(1, 6), min_size=1, max_size=4),
    extra=st.integers(0, 10),
)
def test_equals_the_recursion_while_the_tasks_are_independent(
    seed: int, sizes: list[int], extra: int
) -> None:
    levels, g = problem(seed, sizes, sum(sizes) + 1 + extra)
    J, e = stacked(levels)
    if np.linalg.cond(J) > 1e3:
        return
    step = prioritised_step(J, e, g, starts_of(levels), [0.0] * len(levels), 1e-14)
    np.testing.assert_allclose(step, recursion(levels, g), atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), m=st.integers(1, 5), lower=st.integers(1, 12))
def test_a_lower_level_never_disturbs_a_higher_one(seed: int, m: int, lower: int) -> None:
    n = 8
    levels, g = problem(seed, [m, lower], n)
    (J1, e1), _ = levels
    if np.linalg.cond(J1) > 50:
        return
    J, e = stacked(levels)
    step = prioritised_step(J, e, g, starts_of(levels), [0.0, float(e[m:] @ e[m:])], 1e-10)
    np.testing.assert_allclose(J1 @ step, e1, atol=1e-5)


def test_conflicting_levels_meet_the_first_and_do_their_best_for_the_second() -> None:
    J = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    step = prioritised_step(J, np.array([1.0, -5.0, 2.0]), np.zeros(2), [0, 1], [0.0, 29.0], 1e-10)
    np.testing.assert_allclose(step, [1.0, 2.0 / 30.0], atol=1e-4)


def test_the_step_stays_bounded_at_a_singularity() -> None:
    J = np.array([[1e-9, 0.0]])
    for error in (1e-3, 1.0, 100.0):
        step = prioritised_step(J, np.array([error]), np.zeros(2), [0], [error**2], 1e-4)
        assert np.abs(step).max() <= 0.5


def test_a_persistent_conflict_does_not_leak_upward() -> None:
    """Two levels want opposite things of the same joint for good: the first keeps its target to lambda_0^2."""
    J, q, step = np.array([[1.0, 0.0], [1.0, 0.3]]), np.zeros(2), np.zeros(2)
    for _ in range(200):
        e = np.array([0.0, 0.5]) - J @ q
        q += prioritised_step(J, e, step, [0, 1], [float(e[0] ** 2), float(e[1] ** 2)], 1e-4)
    assert abs(q[0]) < 1e-3


def test_no_error_and_no_gradient_give_no_step() -> None:
    ((J, _),) = problem(1, [4], 7)[0]
    np.testing.assert_array_equal(
        prioritised_step(J, np.zeros(4), np.zeros(7), [0], [0.0], 1e-6), np.zeros(7)
    )


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**31), first=st.sampled_from([0, 6]), width=st.floats(0.0, 1.0))
def test_clamped_steps_hold_their_bounds(seed: int, first: int, width: float) -> None:
    n = 12 + first
    levels, g = problem(seed, [4, 5], n)
    J, e = stacked(levels)
    rng = np.random.default_rng(seed)
    limits = (-width * rng.random(12), width * rng.random(12))
    speeds = (-rng.random(12), rng.random(12))
    step, fixed = clamped_step(J, e, g, [0, 4], [1e-4, 1e-4], 1e-4, limits, speeds, first, 0.5)
    for lowest, highest in (limits, speeds):
        assert (step[first:] >= lowest - 1e-12).all() and (step[first:] <= highest + 1e-12).all()
    assert 0 <= fixed <= 12


def test_clamping_solves_again_with_fewer_joints() -> None:
    """Joint 0 may move 0.1 only; joint 1 has to do the rest of x = q0 + q1."""
    J, e = np.array([[1.0, 1.0]]), np.array([1.0])
    limits, far = (np.array([-1, -1.0]), np.array([0.1, 1.0])), (np.full(2, -9.0), np.full(2, 9.0))
    for position, speed in (
        (limits, far),
        (far, limits),
    ):  # a speed limit is helped by the other joint just the same
        step, fixed = clamped_step(J, e, np.zeros(2), [0], [0.0], 1e-12, position, speed, 0, 9.0)
        assert fixed == 1
        np.testing.assert_allclose(step, [0.1, 0.9], atol=1e-6)


def test_too_fast_for_all_joints_slows_the_whole_step() -> None:
    """Both joints are too slow for the lower task; the higher one, already met, stays met."""
    J = np.array([[1.0, -1.0], [1.0, 1.0]])
    far, slow = (np.full(2, -9.0), np.full(2, 9.0)), (np.full(2, -0.05), np.full(2, 0.05))
    step, _ = clamped_step(J, np.array([0.0, 1.0]), np.zeros(2), [0, 1], [0.0, 0.0], 1e-12, far, slow, 0, 9.0)
    np.testing.assert_allclose(step, [0.05, 0.05], atol=1e-6)


def test_bounds_that_exclude_zero_move_the_joint_back_inside() -> None:
    step, _ = clamped_step(
        np.array([[1.0, 0.0]]), np.zeros(1), np.zeros(2), [0], [0.0], 1e-12,
        (np.array([0.2, -1]), np.array([0.5, 1])), (np.full(2, -9.0), np.full(2, 9.0)), 0, 9.0,
    )  # fmt: skip
    assert step[0] == pytest.approx(0.2)
