"""Joint centres from rigid targets on the segments, whose mounting is unknown.

Where two neighbouring targets turn against each other, their motion shows the joint between them: it is the point that
rests in both [ehrig2006]. Where they do not, the centre is kept near a guess from the places of the targets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from imitor.motion.joint_centres import CHEST_SHARE, HAND_SHARE
from imitor.motion.normalise import direction
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array

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


def target_joints(pose: Poses, height_m: float) -> Array:
    """Return role positions, shape (T, R, 3) [m]; NaN where a target that is needed is lost.

    Args:
        pose: The targets ``hip``, ``torso``, ``head`` and of both sides ``shoulder``, ``upper_arm``, ``forearm``,
            ``hand``, ``thigh``, ``shin``, ``foot``.
        height_m: Stature, for the guesses [m].
    """
    at: Callable[[str], Array] = lambda name: pose[name][:, :3, 3]  # noqa: E731
    out = np.full((len(pose["hip"]), N_ROLES, 3), np.nan)

    def put(name: str, a: str, b: str, guess: Array) -> Array:
        place = joint_between(pose[a], pose[b], guess)
        out[:, ROLE_INDEX[name]] = place
        return place

    shoulders = 0.5 * (at("left_shoulder") + at("right_shoulder"))
    trunk = direction(shoulders - at("hip"))
    across = at("left_shoulder") - at("right_shoulder")
    lateral = direction(across - trunk * (across * trunk).sum(-1, keepdims=True))
    H = height_m
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        s = f"{side}_"
        shoulder = put(f"{s}shoulder", "torso", f"{s}upper_arm", at(f"{s}shoulder") - _DROP * H * trunk)
        hand = at(f"{s}hand")
        wrist_guess = hand + _WRIST * H * direction(at(f"{s}forearm") - hand)
        bend = _bend(shoulder, at(f"{s}upper_arm"), wrist_guess, at(f"{s}forearm"))
        elbow = put(f"{s}elbow", f"{s}upper_arm", f"{s}forearm", bend)
        wrist = put(f"{s}wrist", f"{s}forearm", f"{s}hand", wrist_guess)
        out[:, ROLE_INDEX[f"{s}hand"]] = wrist + HAND_SHARE * (wrist - elbow)
        hip = put(
            f"{s}hip", "hip", f"{s}thigh", at("hip") + H * (sign * _HIP_HALF * lateral - _HIP_DOWN * trunk)
        )
        foot = at(f"{s}foot")
        ankle_guess = foot + _ANKLE * H * direction(at(f"{s}shin") - foot)
        knee = _bend(hip, at(f"{s}thigh"), ankle_guess, at(f"{s}shin"))
        put(f"{s}knee", f"{s}thigh", f"{s}shin", knee)
        put(f"{s}ankle", f"{s}shin", f"{s}foot", ankle_guess)
    middle = 0.5 * (out[:, ROLE_INDEX["left_shoulder"]] + out[:, ROLE_INDEX["right_shoulder"]])
    pelvis = 0.5 * (out[:, ROLE_INDEX["left_hip"]] + out[:, ROLE_INDEX["right_hip"]])
    neck = middle + _NECK_UP * H * trunk
    out[:, ROLE_INDEX["pelvis"]], out[:, ROLE_INDEX["neck"]] = pelvis, neck
    out[:, ROLE_INDEX["chest"]] = pelvis + CHEST_SHARE * (middle - pelvis)
    put("head", "torso", "head", neck + _SKULL * (at("head") - neck))
    return out


def joint_between(first: Array, second: Array, guess: Array) -> Array:
    """Return the centre of the joint between two targets over time, shape (T, 3) [m] [ehrig2006].

    A point fixed in each target is sought such that both stay together: of the least mean square distance, and of the
    least distance to the guess by the weight `TRUST`. The result is the middle of both points.

    Args:
        first, second: World from target, shape (T, 4, 4) [m]; NaN where lost.
        guess: The centre roughly, shape (T, 3) [m].
    """
    R_a, t_a, R_b, t_b = first[:, :3, :3], first[:, :3, 3], second[:, :3, :3], second[:, :3, 3]
    known = (
        np.isfinite(first).all(axis=(1, 2))
        & np.isfinite(second).all(axis=(1, 2))
        & np.isfinite(guess).all(axis=1)
    )
    if not known.any():
        return np.full_like(guess, np.nan)
    local = [
        np.median(np.einsum("tji,tj->ti", R[known], guess[known] - t[known]), axis=0)
        for R, t in ((R_a, t_a), (R_b, t_b))
    ]
    n = int(known.sum())
    A = np.concatenate([R_a[known], -R_b[known]], axis=2).reshape(3 * n, 6) / np.sqrt(n)
    b = (t_b[known] - t_a[known]).reshape(3 * n) / np.sqrt(n)
    x0 = np.concatenate(local)
    x = x0 + np.linalg.solve(A.T @ A + TRUST**2 * np.eye(6), A.T @ (b - A @ x0))
    c_a = t_a + np.einsum("tij,j->ti", R_a, x[:3])
    c_b = t_b + np.einsum("tij,j->ti", R_b, x[3:])
    return np.asarray(0.5 * (c_a + c_b))


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
