"""Simple shapes around parts of robots, pairs found by sampling, and what is kept on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.collision.distances import Distances
from imitor.collision.pairs import SAFE_M, meeting_pairs
from imitor.collision.shapes import TOLERANCE_M, robot_shapes
from imitor.collision.simplify import capsule_around, simple_shape
from imitor.collision.solids import Capsule, Hull, hull_of
from imitor.collision.store import digest, kept
from imitor.metrics.collision import full_configurations, robot_collision_model
from imitor.robot.model import RobotModel


def round_body(seed: int, n: int = 400) -> np.ndarray:
    """Points on an ellipsoid, some of them pushed in, anywhere in space [m]."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    points *= rng.uniform(0.02, 0.1, 3) * rng.uniform(0.8, 1.0, (n, 1))
    turned: np.ndarray = points @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.normal(size=3)
    return turned


def outside(points: np.ndarray, shape: Hull | Capsule) -> float:
    """Return how far points lie outside a shape, from its own formula [m]."""
    if isinstance(shape, Capsule):
        axis = shape.ends[1] - shape.ends[0]
        share = np.clip((points - shape.ends[0]) @ axis / max(axis @ axis, 1e-30), 0.0, 1.0)
        nearest = shape.ends[0] + share[:, None] * axis
        return float(np.linalg.norm(points - nearest, axis=1).max() - shape.radius)
    a, b, c = (shape.corners[shape.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return float((points @ normals.T - np.einsum("ij,ij->i", a, normals)).max())


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_a_simple_shape_holds_the_part_and_stands_out_little(seed: int) -> None:
    points = round_body(seed)
    shape, excess = simple_shape(points, TOLERANCE_M)
    assert outside(points, shape) < 1e-6
    assert excess <= TOLERANCE_M + 1e-6
    assert outside(points, capsule_around(points)) < 1e-6
    if isinstance(shape, Hull):
        assert len(shape.corners) <= len(hull_of(points).corners)
        # what a second formula says: no corner lies farther from all facets of the hull than it is told
        assert outside(shape.corners, hull_of(points)) < TOLERANCE_M + 1e-6


def test_a_round_rod_becomes_a_capsule() -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ends = np.array([[0.1, 0.2, 0.3], [0.2, 0.25, 0.5]])
    points = np.concatenate([end + 0.04 * directions for end in ends])
    shape, excess = simple_shape(points, TOLERANCE_M)
    assert isinstance(shape, Capsule)
    assert excess < TOLERANCE_M
    assert shape.radius == pytest.approx(0.04, abs=1e-3)
    np.testing.assert_allclose(np.sort(shape.ends, axis=0), ends, atol=1e-3)


def test_a_box_stays_exact_and_a_sheet_is_refused() -> None:
    corners = np.array([[x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.2) for z in (0.0, 0.3)])
    shape, excess = simple_shape(corners, TOLERANCE_M)
    assert isinstance(shape, Hull)
    assert excess == 0.0
    assert len(shape.corners) == 8
    with pytest.raises(ValueError, match="it has no volume"):
        hull_of(corners * [1.0, 1.0, 0.0])


@pytest.mark.parametrize("margin_m", [0.005, 0.03])
@pytest.mark.parametrize("name", ["nao_v4", "unitree_g1", "romeo", "talos"])
def test_nothing_is_too_near_as_the_robot_stands(name: str, margin_m: float) -> None:
    robot = RobotModel.load(name)
    shapes = robot_shapes(robot, margin_m)
    pairs, distance, _, _ = Distances(robot, shapes).below(margin_m)
    assert (distance > shapes.margin[pairs]).all()
    assert (shapes.margin > -0.001).all()


def test_pairs_left_out_never_touch_and_pairs_kept_can() -> None:
    # The sampled pairs against random configurations of another seed.
    import pinocchio as pin

    robot = RobotModel.load("unitree_g1")
    found = robot_collision_model(robot)
    keep = meeting_pairs(robot, found, digest(["test"]), 0.005)
    links = [frozenset(p) for p in found.pairs]
    kept_links = {p for p, k in zip(links, keep, strict=True) if k}
    assert frozenset(("left_elbow_link", "left_wrist_pitch_link")) not in kept_links
    assert {frozenset(("left_wrist_yaw_link", "right_wrist_yaw_link")),
            frozenset(("left_wrist_yaw_link", "left_hip_roll_link"))} <= kept_links  # fmt: skip
    # the robot is the same on both sides, and so is what its links can touch
    mirrored = {frozenset(n.replace("left", "@").replace("right", "left").replace("@", "right") for n in p)
                for p in kept_links}  # fmt: skip
    assert len(kept_links ^ mirrored) <= 0.02 * len(kept_links)
    data, results = found.model.createData(), found.geometry.createData()
    rng = np.random.default_rng(1)
    joints = rng.uniform(robot.lower, robot.upper, (300, robot.n))
    q = np.hstack([np.tile(robot.standing[:7], (300, 1)), joints])
    least = np.full(len(keep), np.inf)
    for x in full_configurations(found.model, robot.locked, robot.joint_names, q):
        pin.updateGeometryPlacements(found.model, data, found.geometry, results, x)
        for k in np.flatnonzero(~keep).tolist():
            least[k] = min(least[k], pin.computeDistance(found.geometry, results, k).min_distance)
    assert least[~keep].min() > 0.005
    assert 20 < (~keep).sum() < 0.5 * len(keep)
    assert SAFE_M >= 2.0 * TOLERANCE_M


def test_arrays_are_kept_and_made_anew_when_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path))
    made = []

    def make() -> dict[str, Any]:
        made.append(1)
        return {"a": np.arange(3.0), "b": 2.0}

    for _ in range(2):
        found = kept("thing", make, about="a thing is made")
        np.testing.assert_array_equal(found["a"], np.arange(3.0))
        assert float(found["b"]) == 2.0
    assert len(made) == 1
    for damage in (b"", b"no archive"):
        (tmp_path / "collision" / "thing.npz").write_bytes(damage)
        kept("thing", make, about="a thing is made")
    assert len(made) == 3
    assert digest([1, "a"]) != digest([1, "b"])
