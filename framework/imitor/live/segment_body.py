"""From the poses of a sender's segments to human frames: indices and constants found once, arithmetic per instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imitor.motion.skeletons import RolePoint
from imitor.types import N_ROLES, ROLE_INDEX, Array, BoolArray, HumanFrame, IntArray, read_only


@dataclass(frozen=True)
class Fixed:
    """A point that is fixed in the segment of another role.

    Attributes:
        role: The role whose segment it belongs to.
        arm: From that role to the point in the rest pose, shape (3,) [m].
    """

    role: str
    arm: Array


class SegmentBody:
    """Makes human frames of segment poses, position (..., S, 3) [m] and rotation (..., S, 3, 3), in a world with z up.

    Args:
        points: Role to place among the segments.
        rest: World from segment in the rest pose that faces +x, shape (S, 3, 3).
        fixed: Role to point in the segment of a role of ``points``.
        scale: Our metres per metre of the sender [-].

    Attributes:
        floor_m: Height of the floor in the sender's world, after scaling [m].
    """

    def __init__(
        self,
        points: Mapping[str, RolePoint],
        rest: Array,
        fixed: Mapping[str, Fixed] | None = None,
        *,
        scale: float = 1.0,
    ) -> None:
        fixed = fixed or {}
        self.floor_m = 0.0
        self._scale = scale
        self._role = _indices([ROLE_INDEX[name] for name in points])
        self._start = _indices([p.start for p in points.values()])
        self._end = _indices([p.end for p in points.values()])
        self._at = np.array([p.at for p in points.values()])[:, None]
        self._turn = _indices([p.turns_with for p in points.values()])
        self._segment_from_rest = np.swapaxes(rest[self._turn], -1, -2).copy()
        self._fixed_role = _indices([ROLE_INDEX[name] for name in fixed])
        self._fixed_to = _indices([ROLE_INDEX[f.role] for f in fixed.values()])
        self._arm = np.array([f.arm for f in fixed.values()]).reshape(-1, 3, 1)

    def roles(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Return role positions, shape (..., R, 3) [m], and orientations, shape (..., R, 3, 3); NaN where not known.

        Args:
            position: Segment origins, shape (..., S, 3) [m of the sender].
            rotation: World from segment, shape (..., S, 3, 3).
        """
        before = position.shape[:-2]
        place, turn = np.full((*before, N_ROLES, 3), np.nan), np.full((*before, N_ROLES, 3, 3), np.nan)
        start = position[..., self._start, :]
        place[..., self._role, :] = start + self._at * (position[..., self._end, :] - start)
        turn[..., self._role, :, :] = rotation[..., self._turn, :, :] @ self._segment_from_rest
        if self._scale != 1.0:
            place *= self._scale
        if len(self._arm):
            arm = (turn[..., self._fixed_to, :, :] @ self._arm)[..., 0]
            place[..., self._fixed_role, :] = place[..., self._fixed_to, :] + arm
        place[..., 2] -= self.floor_m
        return place, turn

    def frame(self, position: Array, rotation: Array, time_s: float) -> HumanFrame:
        """Return the frame of one instant; its arrays cannot be written.

        Args:
            position: Segment origins, shape (S, 3) [m of the sender]; NaN where lost.
            rotation: World from segment, shape (S, 3, 3).
            time_s: The time that the frame is to bear [s].
        """
        place, turn = self.roles(position, rotation)
        valid: BoolArray = np.asarray(np.isfinite(place).all(axis=-1))
        place[~valid] = np.nan
        return HumanFrame(time_s, read_only(place), read_only(valid), read_only(turn))


def _indices(values: list[int]) -> IntArray:
    return np.array(values, dtype=np.int_)


__all__ = ["Fixed", "SegmentBody"]
