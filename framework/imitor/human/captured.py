"""A performance as a capture system sees it: with markers and targets, noise, skin motion and losses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from imitor.human import degrade
from imitor.human import markers as skin
from imitor.human.body import Body
from imitor.human.performance import Truth
from imitor.types import Array, BoolArray, read_only


@dataclass(frozen=True)
class Degradation:
    """How well the capture works; all zero for the exact truth.

    Attributes:
        noise_std_m: Standard deviation of white noise per coordinate [m].
        orientation_noise_rad: Standard deviation of white noise on orientations per axis [rad].
        skin_motion_m: Standard deviation of the band-limited motion of skin over bone per coordinate [m].
        loss: Probability that a point is lost in a frame [-].
        burst_frames: Mean length of a loss [frames].
        seed: Seed of all of it.
        joint_motion_m: As ``skin_motion_m`` for joint centres; ``None`` for the same.
    """

    noise_std_m: float = 0.0
    orientation_noise_rad: float = 0.0
    skin_motion_m: float = 0.0
    loss: float = 0.0
    burst_frames: float = 1.0
    seed: int = 0
    joint_motion_m: float | None = None


@dataclass(frozen=True)
class Captured:
    """What is captured, frame by frame; NaN where a point is lost. All arrays are read-only."""

    position: Array
    valid: BoolArray
    orientation: Array
    marker: Array | None
    marker_valid: BoolArray | None
    target: Array | None
    target_valid: BoolArray | None


def capture(
    truth: Truth, body: Body, *, markers: bool, targets: bool, degradation: Degradation
) -> tuple[Truth, Captured]:
    """Put markers and targets on the performer and capture it.

    Args:
        truth: The performance.
        body: Who performs.
        markers: Whether the 41 markers are worn.
        targets: Whether the rigid targets are worn.
        degradation: How well it works.

    Returns:
        The truth with the exact markers and targets, and what was captured.
    """
    truth = _dressed(truth, body, markers, targets)
    joints = degradation
    if degradation.joint_motion_m is not None:
        joints = replace(degradation, skin_motion_m=degradation.joint_motion_m)
    roles, on_skin, rigid = (
        _Channel(seed, truth.time_s, kind)
        for seed, kind in zip(
            np.random.SeedSequence(degradation.seed).spawn(3), (joints, degradation, degradation), strict=True
        )
    )
    position, valid = roles.points(truth.position)
    orientation = roles.rotations(truth.orientation, valid)
    marker, marker_valid = on_skin.points(truth.marker) if truth.marker is not None else (None, None)
    target = target_valid = None
    if truth.target is not None:
        target = truth.target.copy()
        target[:, :, :3, 3], target_valid = rigid.points(truth.target[:, :, :3, 3])
        target[:, :, :3, :3] = rigid.rotations(truth.target[:, :, :3, :3], target_valid)
        target[~target_valid] = np.nan
    captured = Captured(position, valid, orientation, marker, marker_valid, target, target_valid)
    for value in vars(captured).values():
        if value is not None:
            read_only(value)
    return truth.frozen(), captured


def _dressed(truth: Truth, body: Body, with_markers: bool, with_targets: bool) -> Truth:
    marker = target = None
    if with_markers:
        marker = skin.markers(body).positions(truth.position, truth.orientation)
    if with_targets:
        target = skin.target_poses(*skin.targets(body), truth.position, truth.orientation)
    return replace(truth, marker=marker, target=target)


class _Channel:
    """One kind of captured thing; its random streams are its own, so asking for one never changes another."""

    def __init__(self, seed: np.random.SeedSequence, time_s: Array, degradation: Degradation) -> None:
        self.noise, self.skin, self.loss, self.turn = (np.random.default_rng(s) for s in seed.spawn(4))
        self.time_s, self.degradation = time_s, degradation

    def points(self, exact: Array) -> tuple[Array, BoolArray]:
        """Return captured points (T, N, 3) and which are seen (T, N)."""
        d = self.degradation
        seen = exact.copy()
        if d.noise_std_m:
            seen += degrade.noise(self.noise, exact.shape, d.noise_std_m)
        if d.skin_motion_m:
            seen += degrade.band_limited(self.skin, self.time_s, exact.shape[1:], d.skin_motion_m)
        valid = ~degrade.lost(self.loss, exact.shape[0], exact.shape[1], d.loss, d.burst_frames)
        seen[~valid] = np.nan
        return seen, valid

    def rotations(self, exact: Array, valid: BoolArray) -> Array:
        """Return captured rotations (T, N, 3, 3), lost together with their points."""
        seen = exact.copy()
        if self.degradation.orientation_noise_rad:
            shape = exact.shape
            n = int(np.prod(shape[:2]))
            turn = degrade.rotation_noise(self.turn, n, self.degradation.orientation_noise_rad)
            seen = exact @ turn.reshape(shape)
        seen[~valid] = np.nan
        return seen
