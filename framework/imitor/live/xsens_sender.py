"""Datagrams of Xsens MVN for human frames, to rehearse without a suit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from imitor.live.quaternions import quaternions
from imitor.live.xsens_body import PARENT_INDEX, ROLE_OF, SEGMENT_INDEX
from imitor.live.xsens_null_pose import NullPose, null_pose_payloads
from imitor.live.xsens_wire import header, write_pose
from imitor.motion.mvnx_body import ON_SEGMENT, ORIGIN
from imitor.motion.mvnx_file import SEGMENTS
from imitor.motion.normalise import role
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, HumanFrame, Skeleton

_SENT: Final = tuple(dict.fromkeys(ORIGIN))
_SENT_INDEX: Final = [ROLE_INDEX[r] for r in _SENT]
_TURNS: Final = [ROLE_INDEX[ROLE_OF.get(s, "pelvis" if s in ("L5", "L3") else "chest")] for s in SEGMENTS]
"""Role whose orientation each segment gets; those without a role turn with the pelvis or the chest."""
_COLLAR: Final = 0.2
"""Where a shoulder girdle begins on the way from neck to shoulder [-]."""


class XsensEncoder:
    """Makes datagrams of type 02 for human frames, and of type 13 about once a second.

    What a frame does not know is sent as NaN. Segments that are no role lie between those that are.

    Args:
        skeleton: The person.
        rate_hz: Instants a second [Hz].
    """

    def __init__(self, skeleton: Skeleton, rate_hz: float) -> None:
        rest = skeleton.rest_position
        self._every = max(round(rate_hz), 1)
        origin = _between(rest[[ROLE_INDEX[r] for r in _SENT]])
        points = {
            key: role(rest, name) - origin[SEGMENT_INDEX[key[0]]]
            for name, key in ON_SEGMENT.items()
            if np.isfinite(role(rest, name)).all() and np.isfinite(origin[SEGMENT_INDEX[key[0]]]).all()
        }
        whole = bool(np.isfinite(origin).all())
        self._null_pose = NullPose(origin, points) if whole else None

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return the datagrams of one instant.

        Args:
            frame: The person, with orientations.
            counter: The sender's count of instants.
        """
        position = _between(frame.position[_SENT_INDEX])
        turn = np.full((N_ROLES, 3, 3), np.nan) if frame.orientation is None else frame.orientation
        quaternion = quaternions(turn[_TURNS])
        for i in np.flatnonzero(
            np.isnan(quaternion[:, 0])
        ):  # e.g. toes of a recording that turns them with the foot
            quaternion[i] = quaternion[PARENT_INDEX[i]]
        out = []
        if counter % self._every == 0 and self._null_pose is not None:
            out += [
                header("13", counter, 0, 0, frame.time_s, 0, len(p)) + p
                for p in null_pose_payloads(self._null_pose)
            ]
        return out + write_pose(counter, frame.time_s, position, quaternion)


def _between(place: Array) -> Array:
    """Return segment origins, shape (23, 3), from those of `_SENT`: the spine and the girdles are put between them."""
    out = np.full((len(SEGMENTS), 3), np.nan)
    by_role = dict(zip(_SENT, place, strict=True))
    for name, segment in ORIGIN.items():
        out[SEGMENT_INDEX[segment]] = by_role[name]
    pelvis, chest, neck = (by_role[r] for r in ("pelvis", "chest", "neck"))
    for k, name in enumerate(("L5", "L3", "T12"), start=1):
        out[SEGMENT_INDEX[name]] = pelvis + k / 4 * (chest - pelvis)
    for side in SIDES:
        out[SEGMENT_INDEX[f"{side.capitalize()}Shoulder"]] = neck + _COLLAR * (
            by_role[f"{side}_shoulder"] - neck
        )
    return out


__all__ = ["XsensEncoder"]
