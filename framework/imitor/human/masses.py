"""Centre of mass from segment masses: two published tables as linear weights of the role positions.

A segment's centre lies on the line between two points, and each point is a role or a fixed mix of roles, so
the body's centre of mass is ``w @ position`` with weights ``w`` (R,) that depend only on which roles are
known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, BoolArray

Point = Mapping[str, float]
"""A point as a mix of roles: role -> share; the shares sum to 1."""


@dataclass(frozen=True)
class Segment:
    """One mass and where to put it, best known way first.

    Attributes:
        mass: Fraction of the body mass [-].
        choices: Mixes of roles; the first whose roles are all known is taken.
    """

    mass: float
    choices: tuple[Point, ...]


@dataclass(frozen=True)
class _DeLeva:
    """Masses and centres of [deleva1996], fractions of body mass and of segment length."""

    head: tuple[float, float]
    trunk: tuple[float, float]
    upper_arm: tuple[float, float]
    forearm: tuple[float, float]
    hand: tuple[float, float]
    thigh: tuple[float, float]
    shank: tuple[float, float]
    foot: tuple[float, float]


DELEVA: Final[Mapping[str, _DeLeva]] = {
    "male": _DeLeva(
        (0.0694, 0.5002), (0.4346, 0.4310), (0.0271, 0.5772), (0.0162, 0.4574), (0.0061, 0.7900),
        (0.1416, 0.4095), (0.0433, 0.4395), (0.0137, 0.4415),
    ),
    "female": _DeLeva(
        (0.0668, 0.4841), (0.4257, 0.3782), (0.0255, 0.5754), (0.0138, 0.4559), (0.0056, 0.7474),
        (0.1478, 0.3612), (0.0481, 0.4352), (0.0129, 0.4014),
    ),
}  # fmt: skip

_KNUCKLES: Final = 0.050 / 0.146  # wrist to knuckles, as a share of the forearm
_FOOT_CENTRE: Final = 0.377  # ankle to ball of the foot: where the centre of heel to toe tip falls


def _along(start: Point, end: Point, share: float) -> Point:
    mix: dict[str, float] = {}
    for point, part in ((start, 1.0 - share), (end, share)):
        for role, value in point.items():
            mix[role] = mix.get(role, 0.0) + part * value
    return mix


def _at(role: str) -> Point:
    return {role: 1.0}


def _middle(part: str) -> Point:
    return {f"left_{part}": 0.5, f"right_{part}": 0.5}


_TRUNK_ENDS: Final = (
    (_middle("shoulder"), _middle("hip")),
    (_at("neck"), _middle("hip")),
    (_at("neck"), _at("pelvis")),
)


def _trunk(mass: float, share: float) -> Segment:
    return Segment(
        mass, (*(_along(top, bottom, share) for top, bottom in _TRUNK_ENDS), _at("chest"), _at("pelvis"))
    )


def deleva(sex: str) -> list[Segment]:
    """Return the segments of [deleva1996], for skeletons of joint centres with wrists and feet."""
    m = DELEVA[sex]
    segments = [
        Segment(
            m.head[0],
            (
                _along(_at("head_top"), _at("neck"), m.head[1]),
                _at("head"),
                _at("neck"),
                _middle("shoulder"),
            ),
        ),
        _trunk(*m.trunk),
    ]
    for s in SIDES:
        shoulder, elbow, wrist, hand = (_at(f"{s}_{j}") for j in ("shoulder", "elbow", "wrist", "hand"))
        hip, knee, ankle = (_at(f"{s}_{j}") for j in ("hip", "knee", "ankle"))
        heel, toe, tip = (_at(f"{s}_{j}") for j in ("heel", "toe", "toe_tip"))
        above = (elbow, shoulder, _at("neck"), _at("chest"))
        segments += [
            Segment(m.upper_arm[0], (_along(shoulder, elbow, m.upper_arm[1]), *above[1:])),
            Segment(m.forearm[0], (_along(elbow, wrist, m.forearm[1]), *above)),
            Segment(
                m.hand[0],
                (
                    _along(wrist, hand, m.hand[1]),
                    _along(elbow, wrist, 1.0 + _KNUCKLES * m.hand[1]),
                    hand,
                    wrist,
                    *above,
                ),
            ),
            Segment(m.thigh[0], (_along(hip, knee, m.thigh[1]), hip, _at("pelvis"))),
            Segment(m.shank[0], (_along(knee, ankle, m.shank[1]), ankle, knee, hip, _at("pelvis"))),
            Segment(
                m.foot[0],
                (
                    _along(heel, tip, m.foot[1]),
                    _along(ankle, toe, _FOOT_CENTRE),
                    ankle,
                    toe,
                    heel,
                    knee,
                    hip,
                    _at("pelvis"),
                ),
            ),
        ]
    return segments


def winter() -> list[Segment]:
    """Return Winter's segments [winter2009] for the 15 points of a depth camera: no wrists, no toes.

    Such a tracker's hand point lies in the palm, its foot point at the ankle.
    """
    segments = [Segment(0.081, (_at("head"), _at("neck"), _middle("shoulder"))), _trunk(0.497, 0.5)]
    for s in SIDES:
        shoulder, elbow, wrist, hand = (_at(f"{s}_{j}") for j in ("shoulder", "elbow", "wrist", "hand"))
        hip, knee, ankle = (_at(f"{s}_{j}") for j in ("hip", "knee", "ankle"))
        segments += [
            Segment(0.028, (_along(shoulder, elbow, 0.436), shoulder, _at("neck"), _at("chest"))),
            Segment(
                0.022,
                (
                    _along(elbow, wrist, 0.682),
                    _along(elbow, hand, 0.50),
                    elbow,
                    shoulder,
                    _at("neck"),
                    _at("chest"),
                ),
            ),
            Segment(0.100, (_along(hip, knee, 0.433), hip, _at("pelvis"))),
            Segment(0.061, (_along(knee, ankle, 0.606), ankle, knee, hip, _at("pelvis"))),
        ]
    return segments


def weights(segments: list[Segment], valid: BoolArray) -> Array | None:
    """Return the weights (R,) of the role positions, or ``None`` where too little is known.

    Args:
        segments: A mass table.
        valid: Which roles are known, shape (R,).

    Returns:
        Weights that sum to 1 and are zero for unknown roles. A limb that is not known in full has its mass
        at the nearest known joint towards the trunk.
    """
    w = np.zeros(N_ROLES)
    total = 0.0
    for segment in segments:
        for mix in segment.choices:
            if all(valid[ROLE_INDEX[role]] for role in mix):
                break
        else:
            return None
        for role, share in mix.items():
            w[ROLE_INDEX[role]] += segment.mass * share
        total += segment.mass
    return w / total


def full_weights(sex: str) -> Array:
    """Return the weights (R,) of a body whose every role is known, by [deleva1996]."""
    w = np.zeros(N_ROLES)
    segments = deleva(sex)
    for segment in segments:
        for role, share in segment.choices[0].items():
            w[ROLE_INDEX[role]] += segment.mass * share
    return np.asarray(w / sum(segment.mass for segment in segments))
