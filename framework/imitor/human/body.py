"""The proportions of the human body [drillis1966, winter2009] as a parametric rest pose.

The rest pose is a T-pose: straight legs under the hips, feet parallel, arms out to the sides with the palms
down, facing +x, soles on z = 0, ankles at x = 0. Every segment's orientation is the identity there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np

from imitor.errors import ImitorError, did_you_mean
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, Array, Skeleton, read_only

FRACTIONS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "thigh": 0.245,
        "shank": 0.246,
        "torso": 0.288,
        "neck": 0.027,  # mid-shoulder to the C7-T1 joint
        "head": 0.155,  # C7-T1 joint to the vertex: torso, neck and head end at 1.000 H
        "upper_arm": 0.186,
        "forearm": 0.146,
        "hand": 0.050,  # wrist to knuckles; the whole hand is 0.108
        "foot": 0.152,
        "foot_width": 0.055,
        "hip_width": 0.105,  # between the joint centres; the pelvis' breadth is 0.191
        "shoulder_width": 0.220,  # between the joint centres
        "ankle_height": 0.039,
    }
)
"""Lengths as fractions of the stature; the keys are also those of ``segment_ratios``."""

_HEEL_BEHIND_ANKLE: Final = 0.04 / 0.152  # shares of the foot's length
_BALL_BEFORE_ANKLE: Final = 0.072 / 0.152
_TOE_HEIGHT: Final = 0.015 / 0.039  # share of the ankle's height
_CHEST: Final = 0.6  # share of the way from mid-hip to mid-shoulder
_SKULL_BASE: Final = 0.4  # share of the way from the neck joint to the vertex


@dataclass(frozen=True)
class Body:
    """A human body in numbers.

    Attributes:
        height_m: Nominal stature, the one the table's fractions refer to [m].
        sex: ``male`` or ``female``; chooses the mass model.
        mass_kg: Body mass [kg].
        ratios: Factors on single lengths, by the keys of `FRACTIONS` [-].
    """

    height_m: float = 1.75
    sex: str = "male"
    mass_kg: float = 70.0
    ratios: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.ratios:
            check_segment(name)

    def length(self, segment: str) -> float:
        """Return a length of the table for this body [m]."""
        return FRACTIONS[segment] * self.height_m * self.ratios.get(segment, 1.0)

    @cached_property
    def rest(self) -> Array:
        """Role positions in the rest pose, shape (R, 3) [m]."""
        n = self.length
        hip = n("ankle_height") + n("shank") + n("thigh")
        shoulder = hip + n("torso")
        neck = shoulder + n("neck")
        arm = np.cumsum([n("shoulder_width") / 2, n("upper_arm"), n("forearm"), n("hand")])
        half_hip, foot = n("hip_width") / 2, n("foot")
        heel = -_HEEL_BEHIND_ANKLE * foot
        points: dict[str, tuple[float, float, float]] = {
            "pelvis": (0, 0, hip),
            "chest": (0, 0, hip + _CHEST * n("torso")),
            "neck": (0, 0, neck),
            "head": (0, 0, neck + _SKULL_BASE * n("head")),
            "head_top": (0, 0, neck + n("head")),
        }
        for side, sign in (("left", 1.0), ("right", -1.0)):
            y = sign * half_hip
            points |= {
                f"{side}_shoulder": (0, sign * arm[0], shoulder),
                f"{side}_elbow": (0, sign * arm[1], shoulder),
                f"{side}_wrist": (0, sign * arm[2], shoulder),
                f"{side}_hand": (0, sign * arm[3], shoulder),
                f"{side}_hip": (0, y, hip),
                f"{side}_knee": (0, y, n("ankle_height") + n("shank")),
                f"{side}_ankle": (0, y, n("ankle_height")),
                f"{side}_heel": (heel, y, 0),
                f"{side}_toe": (_BALL_BEFORE_ANKLE * foot, y, _TOE_HEIGHT * n("ankle_height")),
                f"{side}_toe_tip": (heel + foot, y, 0),
            }
        rest = np.empty((N_ROLES, 3))
        for role, point in points.items():
            rest[ROLE_INDEX[role]] = point
        read_only(rest)
        return rest

    def offset(self, start: str, end: str) -> Array:
        """Return the vector between two roles in the rest pose, shape (3,) [m]."""
        return np.asarray(self.rest[ROLE_INDEX[end]] - self.rest[ROLE_INDEX[start]])

    @property
    def stature_m(self) -> float:
        """Height of the vertex in the rest pose: ``height_m`` where no ratio changes it [m]."""
        return float(self.rest[ROLE_INDEX["head_top"], 2])

    def skeleton(
        self,
        markers: tuple[str, ...] = (),
        targets: tuple[str, ...] = (),
        marker_segments: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
    ) -> Skeleton:
        """Return the facts that a source publishes."""
        return Skeleton(
            name="performer",
            roles=frozenset(ROLES),
            rest_position=self.rest,
            height_m=self.stature_m,
            ankle_height_m=float(self.rest[ROLE_INDEX["left_ankle"], 2]),
            toe_height_m=float(self.rest[ROLE_INDEX["left_toe"], 2]),
            mass_kg=self.mass_kg,
            sex=self.sex,
            marker_names=markers,
            marker_segments=marker_segments,
            target_names=targets,
            notes=("authored motion with exact ground truth; the rest pose is a T-pose",),
        )


def check_segment(name: str) -> None:
    """Refuse a name that is no length of the table.

    Raises:
        ImitorError: With the legal names.
    """
    if name not in FRACTIONS:
        hint = did_you_mean(name, FRACTIONS)
        raise ImitorError(
            f"segment_ratios: no segment is called '{name}'"
            + (f"; {hint}" if hint else "")
            + f" Legal: {', '.join(FRACTIONS)}."
        )
