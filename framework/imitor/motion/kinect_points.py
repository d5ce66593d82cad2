"""The point sets of depth-camera skeletons: their names, and which mix of points is which role.

A side is the person's own. The sensor gives points, not joints: a `hand` is the palm, a `foot` of 20 or 25 points the
middle of the foot, a `foot` of 15 points the ankle.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array

WRIST_SHARE: Final = 0.73
"""Where the wrist lies between elbow and palm, for sets without a wrist: 0.146 H over 0.146 H + half of the hand's
0.108 H [-]."""

Mix = Mapping[str, float]
"""A role as a mix of points: point -> share; the shares sum to 1."""


@dataclass(frozen=True)
class PointSet:
    """One kind of skeleton.

    Attributes:
        name: E.g. ``kinect_v2``; the name of the skeleton.
        title: What a reader calls it.
        points: Canonical names in the order of the sensor's SDK.
        roles: How the roles are made of the points.
        fifteen: For each of the 15 OpenNI points, in their order, the point that stands for it; empty if there is none.
    """

    name: str
    title: str
    points: tuple[str, ...]
    roles: Mapping[str, Mix]
    fifteen: tuple[str, ...] = field(default=())

    def weights(self) -> Array:
        """Return the matrix from points to roles, shape (R, P); rows of roles it does not have are zero."""
        out = np.zeros((N_ROLES, len(self.points)))
        for role, mix in self.roles.items():
            for point, share in mix.items():
                out[ROLE_INDEX[role], self.points.index(point)] = share
        return out


def _sided(*names: str) -> tuple[str, ...]:
    """Return the points of the left and then of the right side."""
    return tuple(f"{side}_{name}" for side in SIDES for name in names)


_ARMS: Final = _sided("shoulder", "elbow", "wrist", "hand")
_LEGS: Final = _sided("hip", "knee", "ankle", "foot")


def _roles(centre: Mapping[str, str], sided: Mapping[str, str]) -> dict[str, Mix]:
    """Return the roles that are one point each, and the pelvis in the middle of the hips."""
    roles: dict[str, Mix] = {"pelvis": {f"{side}_hip": 0.5 for side in SIDES}}
    roles |= {role: {point: 1.0} for role, point in centre.items()}
    roles |= {f"{s}_{role}": {f"{s}_{point}": 1.0} for role, point in sided.items() for s in SIDES}
    return roles


_LIMBS: Final = {j: j for j in ("shoulder", "elbow", "hip", "knee")}
_PAIRS: Final = ("shoulder", "elbow", "hand")

_OPENNI_POINTS: Final = (
    "head", "neck", *(f"{s}_{j}" for j in _PAIRS for s in SIDES), "torso",
    *(f"{s}_{j}" for j in ("hip", "knee", "foot") for s in SIDES),
)  # fmt: skip

OPENNI: Final = PointSet(
    "openni",
    "OpenNI or NiTE, 15 points",
    _OPENNI_POINTS,
    _roles({"chest": "torso", "neck": "neck", "head": "head"}, {**_LIMBS, "hand": "hand", "ankle": "foot"})
    | {f"{s}_wrist": {f"{s}_elbow": 1.0 - WRIST_SHARE, f"{s}_hand": WRIST_SHARE} for s in SIDES},
    fifteen=_OPENNI_POINTS,
)


def _fifteen(neck: str, torso: str) -> tuple[str, ...]:
    stands_for = {"neck": neck, "torso": torso, **{f"{s}_foot": f"{s}_ankle" for s in SIDES}}
    return tuple(stands_for.get(point, point) for point in _OPENNI_POINTS)


_MICROSOFT: Final = {**_LIMBS, "wrist": "wrist", "hand": "hand", "ankle": "ankle", "toe": "foot"}

KINECT_V1: Final = PointSet(
    "kinect_v1",
    "Kinect v1, 20 points",
    ("hip_center", "spine", "shoulder_center", "head", *_ARMS, *_LEGS),
    _roles({"chest": "spine", "neck": "shoulder_center", "head": "head"}, _MICROSOFT),
    _fifteen("shoulder_center", "spine"),
)
KINECT_V2: Final = PointSet(
    "kinect_v2",
    "Kinect v2, 25 points",
    (
        *("spine_base", "spine_mid", "neck", "head", *_ARMS, *_LEGS, "spine_shoulder"),
        *_sided("hand_tip", "thumb"),
    ),
    _roles({"chest": "spine_mid", "neck": "neck", "head": "head"}, _MICROSOFT),
    _fifteen("neck", "spine_mid"),
)
UI_PRMD: Final = PointSet(
    "kinect_22",
    "Kinect, 22 joints of offsets and angles",
    (
        *("waist", "spine", "chest", "neck", "head", "head_tip"),
        *_sided("collar", "shoulder", "elbow", "wrist"),
        *_sided("hip", "knee", "ankle", "toe"),
    ),
    _roles(
        {"chest": "chest", "neck": "neck", "head": "head", "head_top": "head_tip"},
        {**_LIMBS, "wrist": "wrist", "ankle": "ankle", "toe": "toe"},
    ),
)
POINT_SETS: Final = (OPENNI, KINECT_V1, KINECT_V2)
"""The sets that a sensor delivers; `UI_PRMD` is one that was fitted to it."""

_SYNONYMS: Final = {
    "hipcentre": "hip_center", "hipcenter": "hip_center", "centerhip": "hip_center",
    "shouldercentre": "shoulder_center", "shouldercenter": "shoulder_center", "centershoulder": "shoulder_center",
    "spinebase": "spine_base", "basespine": "spine_base", "spinemid": "spine_mid", "midspine": "spine_mid",
    "spineshoulder": "spine_shoulder", "shoulderspine": "spine_shoulder", "handtip": "hand_tip", "tiphand": "hand_tip",
}  # fmt: skip
_PREFIX = re.compile(r"^(xn_?)?(skel|jointtype|joint|nite)_", re.IGNORECASE)
_KNOWN: Final = frozenset(p for s in POINT_SETS for p in s.points)


@functools.lru_cache(maxsize=1024)  # a table with a line a point asks for every line
def canonical(name: str) -> str | None:
    """Return a point's canonical name: of ``ShoulderLeft`` or ``JOINT_LEFT_SHOULDER``, ``left_shoulder``.

    Returns:
        The name, or None when it is no point of any set.
    """
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", _PREFIX.sub("", name.strip())).lower()
    parts = [w for w in re.split(r"[^a-z0-9]+", words) if w]
    sides = [{"l": "left", "r": "right"}.get(w, w) for w in parts]
    side = next((w for w in sides if w in SIDES), "")
    rest = "".join(w for w in sides if w not in SIDES)
    point = _SYNONYMS.get(rest, rest)
    full = f"{side}_{point}" if side else point
    return full if full in _KNOWN else None


def find_set(names: Sequence[str]) -> PointSet | None:
    """Return the set that holds all the points given and has fewest others; None when no set holds them."""
    fitting = [s for s in POINT_SETS if set(names) <= set(s.points)]
    return min(fitting, key=lambda s: len(s.points), default=None)
