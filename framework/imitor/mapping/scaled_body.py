r"""Segment scaling: the human's segment directions with the robot's segment lengths [pennapoubel2014] eq. 1.

.. math::
    p^r_l = \frac{p^h_l - p^h_a}{\|p^h_l - p^h_a\|}\, l^r_l + p^r_a

The chain may start anywhere: only differences of points enter, so the scaled body is computed around the middle of the
hips and moved as a whole to wherever the support is. The torso is one rigid segment from mid-hip to mid-shoulder,
hips and shoulders keep the robot's widths symmetrically (P2).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.errors import RobotError, SourceError
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SEGMENTS, Array, HumanFrame, Skeleton

_CHAIN: Final[tuple[tuple[str, str, str], ...]] = (
    # segment, from, to; `mid_hip` and `mid_shoulder` are middles of two points
    ("hips", "right_hip", "left_hip"),
    ("shoulders", "right_shoulder", "left_shoulder"),
    *((name, a, b) for name, (a, b) in SEGMENTS.items()),
    ("head", "mid_shoulder", "head"),
    ("left_hand", "left_wrist", "left_hand"),
    ("right_hand", "right_wrist", "right_hand"),
)
_NEEDED: Final = tuple(
    f"{side}_{joint}"
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
RETURN_S: Final = 0.25
"""Time over which a segment comes back after it was lost [s]."""
POINTS: Final[tuple[str, ...]] = (
    "mid_hip", "mid_shoulder", "head",
    *(f"{s}_{j}" for s in ("left", "right") for j in ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle")),
)  # fmt: skip
"""Points of the scaled body, in the order of `ScaledBody.relative`."""


class ScaledBody:
    """The human in the robot's size, frame by frame; legs may be taken as a share of the robot's.

    Attributes:
        segments: Names of the segments, in the order of ``direction``.
        direction: Unit vectors of the human's segments in world, shape (S, 3); a segment with a lost end keeps its
            last direction.
        seen: Whether both ends of each segment were seen in this frame, shape (S,).
        relative: Scaled points relative to mid-hip in world axes, shape (P, 3) [m], in the order of `POINTS`.
        mid_hip, mid_ankle: Human points in world, shape (3,) [m].
        leg_ratio: Robot leg length over the human's in this frame [-].
        standing_leg: Length of a leg in the robot's size, or the share of it that counts [m].
        hips_seen: Whether the hips were seen in this frame.
        legs_known: Whether both legs have been seen since the start.
    """

    def __init__(self, robot: RobotModel, skeleton: Skeleton, dt_s: float, leg_share: float = 1.0) -> None:
        missing = [r for r in _NEEDED if r not in skeleton.roles]
        if missing:
            raise SourceError(
                skeleton.name,
                f"the skeleton has no {', '.join(missing)}; segment scaling needs shoulders, elbows, wrists, hips, "
                "knees and ankles. Map them in the skeleton's card.",
            )
        lengths = robot.segment_lengths()
        lacking = [s for s in SEGMENTS if s not in lengths]
        if lacking:
            raise RobotError(
                f"robot '{robot.name}' has no {', '.join(lacking)}: its card lacks roles at their ends"
            )
        has_head, has_hands = skeleton.has("head"), skeleton.has("left_hand", "right_hand")
        self.segments = [
            s for s, _, _ in _CHAIN if (s != "head" or has_head) and (not s.endswith("_hand") or has_hands)
        ]
        chain = [c for c in _CHAIN if c[0] in self.segments]
        used = sorted(
            {r for _, a, b in chain for end in (a, b) for r in _sources(end)}, key=ROLE_INDEX.__getitem__
        )
        self._index = np.array([ROLE_INDEX[r] for r in used])
        self._difference = np.array([_weights(b, used) - _weights(a, used) for _, a, b in chain])  # (S, U)
        self._touched = self._difference != 0.0
        self.lengths = np.array([lengths.get(s, 0.0) for s in self.segments])
        leg = [self.segments.index(s) for s in ("left_thigh", "left_shank", "right_thigh", "right_shank")]
        self.lengths[leg] *= leg_share
        self._compose = self._composition()
        self._middle = np.stack(
            [_weights("mid_hip", used), 0.5 * (_weights("left_ankle", used) + _weights("right_ankle", used))]
        )
        self._middle_touched = self._middle != 0.0
        self._dt_s = dt_s
        self._leg, self._robot_leg = leg, float(self.lengths[leg].sum())
        self.standing_leg = 0.5 * self._robot_leg
        self.direction: Array = np.zeros((len(chain), 3))
        self.seen = np.zeros(len(chain), dtype=bool)
        self.reset()

    def reset(self) -> None:
        """Forget the last directions: a segment never seen points as when standing, arms down."""
        self.direction[:] = (0.0, 0.0, -1.0)
        for upward in ("torso", "head"):
            if upward in self.segments:
                self.direction[self.segments.index(upward)] = (0.0, 0.0, 1.0)
        self.direction[[self.segments.index("hips"), self.segments.index("shoulders")]] = (0.0, 1.0, 0.0)
        self.mid_hip = np.array([0.0, 0.0, 0.5 * self._robot_leg])
        self.mid_ankle = np.zeros(3)
        self.leg_ratio = 1.0
        self.legs_known = self.hips_seen = False
        self._trust = np.ones(len(self.segments))
        self._trusted = True

    def _composition(self) -> Array:
        """Return the matrix that adds up scaled segments to points relative to mid-hip, shape (P, S)."""
        row = {s: np.eye(len(self.segments))[i] for i, s in enumerate(self.segments)}
        zero = np.zeros(len(self.segments))
        at = {"mid_hip": zero, "mid_shoulder": row["torso"]}
        at["head"] = at["mid_shoulder"] + row.get("head", zero)
        for side, sign in (("left", 0.5), ("right", -0.5)):
            at[f"{side}_hip"] = sign * row["hips"]
            at[f"{side}_knee"] = at[f"{side}_hip"] + row[f"{side}_thigh"]
            at[f"{side}_ankle"] = at[f"{side}_knee"] + row[f"{side}_shank"]
            at[f"{side}_shoulder"] = at["mid_shoulder"] + sign * row["shoulders"]
            at[f"{side}_elbow"] = at[f"{side}_shoulder"] + row[f"{side}_upper_arm"]
            at[f"{side}_wrist"] = at[f"{side}_elbow"] + row[f"{side}_forearm"]
            at[f"{side}_hand"] = at[f"{side}_wrist"] + row.get(f"{side}_hand", zero)
        return np.array([at[p] for p in POINTS])

    def take(self, frame: HumanFrame) -> None:
        """Read a human frame."""
        points = frame.position[self._index]
        known = frame.valid[self._index]
        whole = bool(known.all())
        if not whole:
            points = np.where(known[:, None], points, 0.0)
        d = self._difference @ points
        length2 = np.einsum("ij,ij->i", d, d)
        self.seen = length2 > 1e-12 if whole else (length2 > 1e-12) & ~(self._touched & ~known).any(axis=1)
        length = np.sqrt(np.where(self.seen, length2, 1.0))
        if self.seen.all() and self._trusted:
            self.direction = d / length[:, None]
        else:
            self._return_softly(d / length[:, None])
        self.hips_seen = whole or not (self._middle_touched[0] & ~known).any()
        if self.hips_seen:
            self.mid_hip = self._middle[0] @ points
        if whole or not (self._middle_touched[1] & ~known).any():
            self.mid_ankle = self._middle[1] @ points
        if self.seen[self._leg].all():
            self.leg_ratio = self._robot_leg / float(length[self._leg].sum())
            self.legs_known = True
        self.relative: Array = self._compose @ (self.direction * self.lengths[:, None])

    def _return_softly(self, now: Array) -> None:
        """Hold the direction of a segment that is not seen, and come back to it over `RETURN_S` once it is."""
        self._trust = np.where(self.seen, np.minimum(self._trust + self._dt_s / RETURN_S, 1.0), 0.0)
        self._trusted = bool((self._trust >= 1.0).all())
        share = self._trust[:, None]
        blended = share * now + (1.0 - share) * self.direction
        norm = np.sqrt(np.einsum("ij,ij->i", blended, blended))
        usable = self.seen & (norm > 1e-6)
        self.direction = np.where(
            usable[:, None], blended / np.where(usable, norm, 1.0)[:, None], self.direction
        )


def _sources(end: str) -> tuple[str, ...]:
    return (f"left_{end[4:]}", f"right_{end[4:]}") if end.startswith("mid_") else (end,)


def _weights(end: str, used: list[str]) -> Array:
    sources = _sources(end)
    row = np.zeros(len(used))
    row[[used.index(r) for r in sources]] = 1.0 / len(sources)
    return row
