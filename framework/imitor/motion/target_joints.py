"""Joint centres from rigid targets on the segments, whose mounting is unknown.

Where a joint lies in its two targets is found once over a clip (`fit_targets`) and holds for every frame
(`place_joints`).

Where two neighbouring targets turn against each other, their motion shows the joint between them: it is the point that
rests in both [ehrig2006]. Where they do not, the centre is kept near a guess from the places of the targets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.human.markers import TARGETS
from imitor.motion.joint_centres import CHEST_SHARE, HAND_SHARE
from imitor.motion.normalise import direction
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, IntArray

Poses = Mapping[str, Array]
"""World from target by name, shape (T, 4, 4) [m]."""

TRUST: Final = 0.12
"""How many metres of residual in the motion a metre away from the guess is worth [-]."""
_DROP, _HIP_HALF, _HIP_DOWN, _WRIST, _ANKLE = 0.035, 0.0525, 0.03, 0.045, 0.04
_NECK_UP, _SKULL = 0.02, 0.45
"""Where joints lie from their targets, as fractions of stature, for the guesses."""
_BENT: Final = 0.85
"""Sine of a bend from which on its lines tell where it is [-]."""
_REACH: Final = (1.2, 3.0)
"""Where the bend lies on a line from the far joint through the target, by the target's distance [-]."""


@dataclass(frozen=True)
class TargetFit:
    """Where the joints lie in the targets of a person.

    Attributes:
        height_m: Stature [m].
        role: The roles that lie between two targets, shape (J,).
        first, second: Their targets, as indices into `TARGETS`, shape (J,).
        in_first, in_second: Where each lies in its targets, shape (J, 3) [m]; NaN where they were never seen together.
    """

    height_m: float
    role: IntArray
    first: IntArray
    second: IntArray
    in_first: Array
    in_second: Array


def target_joints(pose: Poses, height_m: float) -> Array:
    """Return role positions, shape (T, R, 3) [m]; NaN where a target that is needed is lost.

    Args:
        pose: The targets ``hip``, ``torso``, ``head`` and of both sides ``shoulder``, ``upper_arm``, ``forearm``,
            ``hand``, ``thigh``, ``shin``, ``foot``.
        height_m: Stature, for the guesses [m].
    """
    return place_joints(np.stack([pose[name] for name in TARGETS], axis=1), fit_targets(pose, height_m))


def place_joints(pose: Array, fit: TargetFit) -> Array:
    """Return role positions, shape (..., R, 3) [m]; NaN where a target that is needed is lost.

    Args:
        pose: World from target in the order of `TARGETS`, shape (..., K, 4, 4) [m]; NaN where lost.
        fit: Where the joints lie in them.
    """
    R, t = pose[..., :3, :3], pose[..., :3, 3]
    out = np.full((*pose.shape[:-3], N_ROLES, 3), np.nan)
    centres = [
        t[..., at, :] + (R[..., at, :, :] @ place[:, :, None])[..., 0]
        for at, place in ((fit.first, fit.in_first), (fit.second, fit.in_second))
    ]
    out[..., fit.role, :] = 0.5 * (centres[0] + centres[1])
    trunk = _trunk(lambda name: t[..., TARGETS.index(name), :])
    for side in SIDES:
        elbow, wrist = (out[..., ROLE_INDEX[f"{side}_{n}"], :] for n in ("elbow", "wrist"))
        out[..., ROLE_INDEX[f"{side}_hand"], :] = wrist + HAND_SHARE * (wrist - elbow)
    pelvis, middle, neck = _trunk_joints(out, trunk, fit.height_m)
    out[..., ROLE_INDEX["pelvis"], :], out[..., ROLE_INDEX["neck"], :] = pelvis, neck
    out[..., ROLE_INDEX["chest"], :] = pelvis + CHEST_SHARE * (middle - pelvis)
    return out


def _trunk(at: Callable[[str], Array]) -> Array:
    """Return the direction from the target at the hip to the middle of those on the shoulders, shape (..., 3)."""
    return direction(0.5 * (at("left_shoulder") + at("right_shoulder")) - at("hip"))


def _trunk_joints(out: Array, trunk: Array, height_m: float) -> tuple[Array, Array, Array]:
    """Return pelvis, middle of the shoulders and neck, shape (..., 3) [m]."""
    pelvis, middle = (
        0.5 * (out[..., ROLE_INDEX[f"left_{n}"], :] + out[..., ROLE_INDEX[f"right_{n}"], :])
        for n in ("hip", "shoulder")
    )
    return pelvis, middle, middle + _NECK_UP * height_m * trunk


def fit_targets(pose: Poses, height_m: float) -> TargetFit:
    """Find where the joints lie in the targets.

    Args:
        pose: The targets, as for `target_joints`.
        height_m: Stature, for the guesses [m].
    """
    at: Callable[[str], Array] = lambda name: pose[name][:, :3, 3]  # noqa: E731
    out = np.full((len(pose["hip"]), N_ROLES, 3), np.nan)
    found: list[tuple[int, int, int, Array]] = []

    def put(name: str, a: str, b: str, guess: Array) -> Array:
        places = fit_joint(pose[a], pose[b], guess)
        found.append((ROLE_INDEX[name], TARGETS.index(a), TARGETS.index(b), places))
        out[:, ROLE_INDEX[name]] = joint_at(pose[a], pose[b], places)
        return out[:, ROLE_INDEX[name]]

    trunk = _trunk(at)
    across = at("left_shoulder") - at("right_shoulder")
    lateral = direction(across - trunk * (across * trunk).sum(-1, keepdims=True))
    H = height_m
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        s = f"{side}_"
        shoulder = put(f"{s}shoulder", "torso", f"{s}upper_arm", at(f"{s}shoulder") - _DROP * H * trunk)
        hand = at(f"{s}hand")
        wrist_guess = hand + _WRIST * H * direction(at(f"{s}forearm") - hand)
        bend = _bend(shoulder, at(f"{s}upper_arm"), wrist_guess, at(f"{s}forearm"))
        put(f"{s}elbow", f"{s}upper_arm", f"{s}forearm", bend)
        put(f"{s}wrist", f"{s}forearm", f"{s}hand", wrist_guess)
        hip = put(
            f"{s}hip", "hip", f"{s}thigh", at("hip") + H * (sign * _HIP_HALF * lateral - _HIP_DOWN * trunk)
        )
        foot = at(f"{s}foot")
        ankle_guess = foot + _ANKLE * H * direction(at(f"{s}shin") - foot)
        knee = _bend(hip, at(f"{s}thigh"), ankle_guess, at(f"{s}shin"))
        put(f"{s}knee", f"{s}thigh", f"{s}shin", knee)
        put(f"{s}ankle", f"{s}shin", f"{s}foot", ankle_guess)
    _, _, neck = _trunk_joints(out, trunk, H)
    put("head", "torso", "head", neck + _SKULL * (at("head") - neck))
    role, first, second, places = zip(*found, strict=True)
    x = np.array(places)
    return TargetFit(H, np.array(role), np.array(first), np.array(second), x[:, :3], x[:, 3:])


def joint_between(first: Array, second: Array, guess: Array) -> Array:
    """Return the centre of the joint between two targets over time, shape (T, 3) [m]; see `fit_joint`."""
    return joint_at(first, second, fit_joint(first, second, guess))


def joint_at(first: Array, second: Array, places: Array) -> Array:
    """Return the middle of the two places of a joint over time, shape (T, 3) [m].

    Args:
        first, second: World from target, shape (T, 4, 4) [m]; NaN where lost.
        places: Where the joint lies in the first and in the second, shape (6,) [m].
    """
    c_a = first[:, :3, 3] + np.einsum("tij,j->ti", first[:, :3, :3], places[:3])
    c_b = second[:, :3, 3] + np.einsum("tij,j->ti", second[:, :3, :3], places[3:])
    return np.asarray(0.5 * (c_a + c_b))


def fit_joint(first: Array, second: Array, guess: Array) -> Array:
    """Return where the joint between two targets lies in each of them, shape (6,) [m] [ehrig2006].

    A point fixed in each target is sought such that both stay together: of the least mean square distance, and of the
    least distance to the guess by the weight `TRUST`.

    Args:
        first, second: World from target, shape (T, 4, 4) [m]; NaN where lost.
        guess: The centre roughly, shape (T, 3) [m].

    Returns:
        NaN where the targets are never seen together.
    """
    R_a, t_a, R_b, t_b = first[:, :3, :3], first[:, :3, 3], second[:, :3, :3], second[:, :3, 3]
    known = (
        np.isfinite(first).all(axis=(1, 2))
        & np.isfinite(second).all(axis=(1, 2))
        & np.isfinite(guess).all(axis=1)
    )
    if not known.any():
        return np.full(6, np.nan)
    local = [
        np.median(np.einsum("tji,tj->ti", R[known], guess[known] - t[known]), axis=0)
        for R, t in ((R_a, t_a), (R_b, t_b))
    ]
    n = int(known.sum())
    A = np.concatenate([R_a[known], -R_b[known]], axis=2).reshape(3 * n, 6) / np.sqrt(n)
    b = (t_b[known] - t_a[known]).reshape(3 * n) / np.sqrt(n)
    x0 = np.concatenate(local)
    return np.asarray(x0 + np.linalg.solve(A.T @ A + TRUST**2 * np.eye(6), A.T @ (b - A @ x0)))


def _bend(upper: Array, above: Array, lower: Array, below: Array) -> Array:
    """Guess where a limb bends, shape (T, 3) [m]: where the lines of its two segments meet, or midway when straight.

    Args:
        upper, above: The joint above the bend and the target between, shape (T, 3) [m].
        lower, below: The joint below the bend and the target between.
    """
    u, v, w = above - upper, below - lower, lower - upper
    a, b, c, d, e = ((p * q).sum(-1) for p, q in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    det = a * c - b * b  # squared sine of the bend, by squared lengths
    bent = det > _BENT**2 * a * c
    safe = np.where(bent, det, 1.0)
    s, t = ((c * d - b * e) / safe).clip(*_REACH), ((b * d - a * e) / safe).clip(*_REACH)
    meeting = 0.5 * (upper + s[:, None] * u + lower + t[:, None] * v)
    return np.asarray(np.where(bent[:, None], meeting, 0.5 * (above + below)))
