"""The person that joint positions from a socket show: learned once, then applied to each instant."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.errors import ImitorError
from imitor.live.body_options import AxesConfig, as_received
from imitor.motion.body_lengths import rest_pose, stature
from imitor.motion.kinect_body import side_evidence
from imitor.motion.marker_recording import find_stance_with_gaps
from imitor.motion.normalise import UP_AXES, choose_floor, foot_heights
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, SIDES, Array, BoolArray, HumanFrame, Skeleton, read_only

NEEDED: Final = ("pelvis", *(f"{s}_{j}" for j in ("hip", "shoulder") for s in SIDES))
"""Roles without which there is no body."""
_MIRRORED: Final = -0.3
_HIPS: Final = [ROLE_INDEX["left_hip"], ROLE_INDEX["right_hip"]]
_PELVIS: Final = ROLE_INDEX["pelvis"]


class PointBody:
    """A person told as positions, perhaps orientations, of roles.

    Args:
        name: Name of the skeleton.
        position: What was seen at first, shape (T, R, 3) [m], in the sender's axes; NaN where not known.
        rate_hz: Instants a second [Hz].
        options: What the user says.

    Raises:
        ImitorError: There is no body in it; says what is missing.

    Attributes:
        skeleton: The constant facts.
    """

    def __init__(self, name: str, position: Array, rate_hz: float, options: AxesConfig) -> None:
        self._world = np.array(UP_AXES[options.up], dtype=np.float64)
        self._upright = bool((self._world == np.eye(3)).all())
        position = with_pelvis(position) @ self._world.T
        seen: BoolArray = np.asarray(np.isfinite(position).all(axis=-1))
        never = [r for r in NEEDED if not seen[:, ROLE_INDEX[r]].any()]
        if never:
            raise ImitorError(
                f"{', '.join(never)}: not seen in the first {options.learn_s:g} s; a body needs hips and shoulders. "
                "Let the person stand in view, or set learn_s higher"
            )
        height_m = options.height_m or stature(position)
        if not 0.4 < height_m < 3.0:
            raise ImitorError(f"the body would be {height_m:.3g} m tall: positions are to be sent in metres")
        anatomy, _ = side_evidence(position)
        if anatomy < _MIRRORED:
            raise ImitorError(
                "left and right are swapped: the feet point backwards if the names are right; "
                "correct the names, or the sender's axes and the option up"
            )
        stance = find_stance_with_gaps(position, rate_hz, height_m)
        self._floor_m, why = choose_floor(stance, options.recorded_floor)
        position[..., 2] -= self._floor_m
        ankle_m, toe_m = foot_heights(stance, self._floor_m, height_m)
        self._known: BoolArray = np.asarray(seen.any(axis=0))
        roles = frozenset(r for r in ROLES if self._known[ROLE_INDEX[r]])
        notes = [why]
        notes.append(f"stature {height_m:.2f} m" + (" as given" if options.height_m else ""))
        skeleton = Skeleton(
            name=name,
            roles=roles,
            rest_position=rest_pose(position, height_m, ankle_m, toe_m, roles),
            height_m=height_m,
            ankle_height_m=ankle_m,
            toe_height_m=toe_m,
            mass_kg=options.mass_kg,
            sex=options.sex,
            notes=tuple(notes),
        )
        self.skeleton = as_received(skeleton)

    def frame(self, time_s: float, position: Array, orientation: Array | None = None) -> HumanFrame:
        """Return the human frame of one instant.

        Args:
            time_s: Its time [s].
            position: Role positions in the sender's axes, shape (R, 3) [m]; NaN where not known.
            orientation: Sender's world from segment, shape (R, 3, 3); NaN where not known.
        """
        placed = with_pelvis(position)
        if not self._upright:
            placed = placed @ self._world.T
        placed[:, 2] -= self._floor_m
        valid: BoolArray = np.asarray(np.isfinite(placed).all(axis=1) & self._known)
        placed[~valid] = np.nan
        turned = None
        if orientation is not None:
            turned = read_only(orientation if self._upright else self._world @ orientation @ self._world.T)
        return HumanFrame(time_s, read_only(placed), read_only(valid), turned)


def with_pelvis(position: Array) -> Array:
    """Return positions, shape (..., R, 3), whose pelvis is the middle of the hips where it was not told."""
    out = position.copy()
    told = np.asarray(np.isfinite(out[..., _PELVIS, :]).all(axis=-1))
    if told.all():
        return out
    middle = 0.5 * (out[..., _HIPS[0], :] + out[..., _HIPS[1], :])
    out[..., _PELVIS, :] = np.where(told[..., None], out[..., _PELVIS, :], middle)
    return out


def no_points() -> Array:
    """Return positions of which none is known, shape (R, 3)."""
    return np.full((N_ROLES, 3), np.nan)


__all__ = ["NEEDED", "PointBody", "no_points", "with_pelvis"]
