"""Bridge lost markers and joints with Kalman filters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import numpy as np
from pydantic import Field

from imitor import Config, Filter, HumanFrame, hookimpl
from imitor.motion.point_tracker import PointTracker, TrackerOptions
from imitor.types import N_ROLES, ROLES, Skeleton, read_only

ROLE_SEGMENTS: Final[Mapping[str, tuple[str, ...]]] = {
    "pelvis": ("pelvis",), "chest": ("thorax",), "neck": ("thorax",), "head": ("head",), "head_top": ("head",),
    "shoulder": ("thorax", "upper_arm"), "elbow": ("upper_arm", "forearm"), "wrist": ("forearm", "hand"),
    "hand": ("hand",), "hip": ("pelvis",), "knee": ("thigh", "shank"), "ankle": ("shank", "foot"),
    "heel": ("foot",), "toe": ("foot",), "toe_tip": ("foot",),
}  # fmt: skip
"""Segments whose markers move with a joint."""


_DEFAULT: Final = TrackerOptions()


class KalmanGapFillConfig(Config):
    """How losses are bridged."""

    model: Literal["constant_velocity", "constant_acceleration"] = Field(
        "constant_acceleration", description="What a lost point is expected to keep, for a short while [-]."
    )
    max_gap_s: float = Field(
        _DEFAULT.max_gap_s, ge=0.0, le=5.0, description="A longer loss is not bridged to its end [s]."
    )
    rigid: bool = Field(
        True, description="Whether seen markers of the same segment tell where a lost one is [-]."
    )
    roles: bool = Field(True, description="Whether lost joints are bridged too, and not only markers [-].")
    noise_m: float = Field(
        _DEFAULT.noise_m, gt=0.0, le=0.1, description="Standard deviation of a measured coordinate [m]."
    )
    rigid_noise_m: float = Field(
        _DEFAULT.rigid_noise_m,
        gt=0.0,
        le=0.5,
        description="Standard deviation of a place that three or more markers tell [m].",
    )
    acceleration_m_s2: float = Field(
        _DEFAULT.acceleration_m_s2,
        gt=0.0,
        le=1000.0,
        description="Standard deviation of a point's acceleration [m/s^2].",
    )
    fading_s: float = Field(
        _DEFAULT.fading_s,
        gt=0.0,
        le=10.0,
        description="After this time without measurement velocity is down to 1/e [s].",
    )
    acceleration_fading_s: float = Field(
        _DEFAULT.acceleration_fading_s,
        gt=0.0,
        le=10.0,
        description="The same of acceleration, of the model constant_acceleration [s].",
    )
    pull_rad_s: float = Field(
        _DEFAULT.pull_rad_s,
        ge=0.0,
        le=50.0,
        description="How fast a lost point of a body that swings to and fro swings about where it mostly is [rad/s].",
    )


class KalmanGapFill(Filter[KalmanGapFillConfig]):
    """Bridge lost markers and joints: a Kalman filter a point, helped by the seen markers of its segment.

    What is seen passes unchanged and without delay. A lost point is predicted in axes that move with the body; where
    markers of its segment are seen, it is also measured through their rigid shape. Roles are points like markers. A
    loss longer than ``max_gap_s`` is a loss again from there on.
    """

    name = "kalman_gap_fill"

    def start(self) -> None:
        """Look up which points move together."""
        c = self.config
        self._markers = len(self.skeleton.marker_names)
        options = TrackerOptions(
            model=c.model,
            acceleration_m_s2=c.acceleration_m_s2,
            noise_m=c.noise_m,
            fading_s=c.fading_s,
            acceleration_fading_s=c.acceleration_fading_s,
            pull_rad_s=c.pull_rad_s,
            max_gap_s=c.max_gap_s,
            rigid=c.rigid,
            rigid_noise_m=c.rigid_noise_m,
        )
        companions = companions_of(self.skeleton)
        self._tracker = PointTracker(self._markers + N_ROLES, self.dt_s, companions, options)

    def reset(self) -> None:
        """Forget all points."""
        self._tracker.reset()

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Return the frame with losses bridged."""
        m = self._markers
        points = np.full((m + N_ROLES, 3), np.nan)
        seen = np.zeros(m + N_ROLES, dtype=np.bool_)
        if frame.marker is not None and frame.marker_valid is not None:
            points[:m], seen[:m] = frame.marker, frame.marker_valid
        if self.config.roles:
            points[m:], seen[m:] = frame.position, frame.valid
        filled, known = self._tracker.update(points, seen)
        if frame.marker is not None and not seen[:m].all():
            frame.marker, frame.marker_valid = read_only(filled[:m].copy()), read_only(known[:m].copy())
        if self.config.roles and not frame.valid.all():
            frame.position, frame.valid = read_only(filled[m:].copy()), read_only(known[m:].copy())
        return frame


def companions_of(skeleton: Skeleton) -> list[list[list[int]]]:
    """Return for every marker and then every role, by segment that it belongs to, the other markers of that segment."""
    index = {name: i for i, name in enumerate(skeleton.marker_names)}
    segments = {s: [index[n] for n in names if n in index] for s, names in skeleton.marker_segments.items()}
    found: list[list[list[int]]] = [
        [[j for j in members if j != i] for members in segments.values() if i in members]
        for i in range(len(index))
    ]
    for role in ROLES:
        side, _, bare = role.partition("_")
        sided = side in {"left", "right"}
        names = ROLE_SEGMENTS[bare if sided else role]
        own = [name if name in segments or not sided else f"{side}_{name}" for name in names]
        found.append([segments[name] for name in own if name in segments])
    return found


@hookimpl
def imitor_components() -> list[type[KalmanGapFill]]:
    """Register the filter."""
    return [KalmanGapFill]
