"""Where the camera stands: three-quarter front view, both figures in the picture in every frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.types import Array
from imitor.visual.clip import Clip, rotation_matrices
from imitor.visual.geometry import Part
from imitor.visual.stick import HEAD_RADIUS

FIELD_OF_VIEW: Final = math.radians(32.0)
"""Vertical opening angle: narrow, so that what stands beside keeps its size [rad]."""
TURN: Final = math.radians(28.0)
"""How far the camera stands beside the robot's first heading [rad]."""
ELEVATION: Final = math.radians(-11.0)
"""The camera looks down a little [rad]."""
FOLLOW_S: Final = 0.5
"""Standard deviation of the Gaussian that smooths the camera's way [s]."""
BORDER: Final = 0.05
"""Share of the picture that stays free on each side [-]."""


@dataclass(frozen=True)
class View:
    """The camera of every frame.

    Attributes:
        azimuth, elevation: Direction of view in MuJoCo's sense [rad].
        distance: From the point looked at [m].
        target: The point looked at, shape (T, 3) [m].
        reach: Largest distance on the floor of anything shown from the point looked at [m].
    """

    azimuth: float
    elevation: float
    distance: float
    target: Array
    reach: float


@dataclass(frozen=True)
class Layout:
    """Camera axes on the floor and where the human is shown.

    Attributes:
        azimuth: Direction of view [rad].
        right: The picture's right on the floor, unit vector, shape (3,).
        shift: What is added to the human's points, shape (3,) [m].
    """

    azimuth: float
    right: Array
    shift: Array


def heading(clip: Clip) -> float:
    """Return the direction of the robot's x axis on the floor in the first frame [rad]."""
    x_axis = rotation_matrices(clip.joint_quaternion[0, 1])[:, 0]
    return math.atan2(x_axis[1], x_axis[0])


def robot_corners(clip: Clip, parts: Sequence[Part]) -> Array:
    """Return the corners of the boxes around the robot's parts, shape (T, N, 3) [m]."""
    joints = [p.joint for p in parts]
    low = np.array([p.surface.vertices.min(axis=0) for p in parts])
    high = np.array([p.surface.vertices.max(axis=0) for p in parts])
    pick = np.array([[(c >> k) & 1 for k in range(3)] for c in range(8)], dtype=bool)
    corners = np.where(pick[None], high[:, None], low[:, None]).astype(float)
    R = rotation_matrices(clip.joint_quaternion[:, joints])
    world = np.einsum("tjab,jcb->tjca", R, corners) + clip.joint_position[:, joints, None]
    return np.asarray(world.reshape(len(clip), -1, 3))


def human_corners(clip: Clip) -> Array:
    """Return points around the human's, shape (T, N, 3) [m]; NaN where not known."""
    about = HEAD_RADIUS * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0, 1)], dtype=float)
    return np.asarray((clip.human[:, :, None] + about).reshape(len(clip), -1, 3))


def surrounding(centre: Array, radius_m: float) -> Array:
    """Return points on a circle at a constant distance around a moving point, shape (T, 16, 3) [m].

    Args:
        centre: shape (T, 3) [m].
        radius_m: Of the circle, which lies level [m].
    """
    angle = np.arange(16) * math.tau / 16
    circle = radius_m * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(16)])
    return np.asarray(centre[:, None] + circle)


def arrange(clip: Clip, robot: Array, human: Array, *, beside: bool, gap_m: float = 0.25) -> Layout:
    """Choose the direction of view and place the human: in the picture left of the robot, or over it.

    Beside means: at the same distance from the camera on average, so that sizes can be compared, and so far
    to the left that the two never overlap.

    Args:
        clip: The frames.
        robot, human: Points that enclose them, shape (T, N, 3) [m].
        beside: Whether the human stands beside the robot; over it otherwise.
        gap_m: Free space between the two [m].
    """
    azimuth = heading(clip) + math.pi + TURN
    forward = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    right = np.array([forward[1], -forward[0], 0.0])
    between = clip.joint_position[:, 1] - clip.human_centre
    between[:, 2] = 0.0
    mean = between.mean(axis=0)
    if not beside or not np.isfinite(human).any():
        return Layout(azimuth, right, mean)
    rows = np.isfinite(human).any(axis=(1, 2))
    room = (robot[rows] @ right).min(axis=1) - np.nanmax(human[rows] @ right, axis=1)
    return Layout(azimuth, right, (mean @ forward) * forward + (room.min() - gap_m) * right)


def frame_all(clip: Clip, robot: Array, human: Array, layout: Layout, aspect: float) -> View:
    """Return the camera that follows the middle of both figures, just far enough away to see all of both.

    A point at ``p`` from the point looked at is seen where ``|p . r| <= tan(half angle) (d + p . f)``
    with the camera's right (or up) ``r`` and forward ``f``; the distance ``d`` is the least that meets all.

    Args:
        clip: The frames.
        robot, human: Points that enclose them, shape (T, N, 3) [m]; the human's already shifted.
        layout: From `arrange`.
        aspect: Width by height of the picture [-].
    """
    points = np.concatenate([robot, human], axis=1)
    middle = 0.5 * (clip.joint_position[:, 1] + clip.human_centre + layout.shift)
    target = _smooth(middle, clip.time_s)
    target[:, 2] = 0.5 * (np.nanmin(points[..., 2]) + np.nanmax(points[..., 2]))
    ca, sa, ce, se = *_cos_sin(layout.azimuth), *_cos_sin(ELEVATION)
    forward = np.array([ce * ca, ce * sa, se])
    up = np.cross(layout.right, forward)
    away = points - target[:, None]
    half = math.tan(0.5 * FIELD_OF_VIEW) * (1.0 - 2.0 * BORDER)
    opening = ((layout.right, half * aspect), (up, half))
    for _ in range(4):  # centring changes the distance, which changes the perspective; this settles at once
        depth = away @ forward
        distance = max(float(np.nanmax(np.abs(away @ axis) / t - depth)) for axis, t in opening)
        for axis, _t in opening:
            seen = away @ axis / (distance + depth)
            offset = 0.5 * distance * (np.nanmin(seen) + np.nanmax(seen)) * axis
            target, away = target + offset, away - offset
    distance = max(float(np.nanmax(np.abs(away @ axis) / t - away @ forward)) for axis, t in opening)
    reach = float(np.sqrt(np.nanmax(away[..., 0] ** 2 + away[..., 1] ** 2)))
    return View(layout.azimuth, ELEVATION, distance, target, reach)


def _cos_sin(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


def _smooth(path: Array, time_s: Array) -> Array:
    """Return the path (T, 3) smoothed over `FOLLOW_S`, without delay, ends held."""
    if len(path) < 3:
        return path.copy()
    step = float(np.median(np.diff(time_s)))
    reach = min(int(3.0 * FOLLOW_S / step) + 1, 10_000)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step / FOLLOW_S) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(path, ((reach, reach), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(padded[:, k], kernel, mode="valid") for k in range(path.shape[1])])
