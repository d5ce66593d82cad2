"""Other segment lengths: how the placements of joints and role frames grow from the robot's size to another."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Final

import numpy as np

from imitor.errors import RobotError
from imitor.types import SEGMENTS, SIDES, Array

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    import pinocchio as pin

MIDDLES: Final = (("mid_hip", "waist", "hip"), ("mid_shoulder", "chest", "shoulder"))
"""Points between a left and a right joint, and the link that carries them."""
_LIMBS: Final = tuple(s for s in SEGMENTS if s != "torso")
SCALABLE: Final = ("hips", "shoulders", "head", *SEGMENTS)


class Growth:
    """Placements of a model at its own size and at another one.

    A limb's factor applies to the joints along it. Widths (``hips``, ``shoulders``) scale the lateral part of where hip
    and shoulder joints sit, the torso the other part of the shoulders' and the joints of the spine.

    Args:
        model: The robot's model, in its own size.
        role_frame: Role -> frame.
        factors: Segment -> length factor [-]; ``*`` for everything else.
        robot: Its name, for errors.
    """

    def __init__(
        self, model: pin.Model, role_frame: Mapping[str, int], factors: Mapping[str, float], robot: str
    ) -> None:
        unknown = sorted(set(factors) - {"*", *SCALABLE})
        if unknown:
            raise RobotError(
                f"robot '{robot}' has no segment {', '.join(unknown)} to scale; segments: {', '.join(SCALABLE)}, or *"
            )
        if not all(np.isfinite(f) and f > 0 for f in factors.values()):
            raise RobotError(f"robot '{robot}': a length factor must be a number above 0")
        self._model, self._role_frame, self._factors = model, role_frame, factors
        self._joint = [model.jointPlacements[j].translation.copy() for j in range(model.njoints)]
        self._frame = {role: model.frames[i].placement.translation.copy() for role, i in role_frame.items()}
        data = model.createData()
        pin.forwardKinematics(model, data, pin.neutral(model))
        self._upright = [data.oMi[model.parents[j]].rotation.copy() for j in range(model.njoints)]
        self._growth = self._factor_of_joints()
        self._data = data

    def apply(self, model: pin.Model, share: float) -> None:
        """Write the placements at a share of the growth into a model: 0 is the robot's size, 1 the other one."""
        for j in range(2, model.njoints):
            R, factor = self._upright[j], 1.0 + share * (self._growth[j] - 1.0)
            model.jointPlacements[j].translation = R.T @ (factor * (R @ self._joint[j]))
        ends = 1.0 + share * (self._of("*") - 1.0)
        for role, frame in self._role_frame.items():
            model.frames[frame].placement.translation = ends * self._frame[role]
        pin.forwardKinematics(model, self._data, pin.neutral(model))
        pin.updateFramePlacements(model, self._data)
        for middle, _, joint in MIDDLES:
            if middle in self._role_frame:
                points = [self._data.oMf[self._role_frame[f"{side}_{joint}"]].translation for side in SIDES]
                frame = model.frames[self._role_frame[middle]]
                frame.placement.translation = self._data.oMi[frame.parentJoint].actInv(
                    0.5 * (points[0] + points[1])
                )

    def _of(self, *names: str) -> float:
        return next((float(self._factors[n]) for n in (*names, "*") if n in self._factors), 1.0)

    def _factor_of_joints(self) -> Array:
        """Return the factor of each joint's placement along x, y, z of the upright robot, shape (njoints, 3)."""
        out = np.full((self._model.njoints, 3), self._of("*"))
        for joint in self._between("waist", "chest"):
            out[joint] = self._of("torso")
        for joint in self._between("chest", "head"):
            out[joint] = self._of("head")
        for side in SIDES:
            for joint in self._between("waist", f"{side}_hip"):
                out[joint] = self._of("hips")
            for joint in self._between("chest", f"{side}_shoulder"):
                out[joint] = (self._of("torso"), self._of("shoulders"), self._of("torso"))
        for segment in _LIMBS:
            for joint in self._between(*SEGMENTS[segment]):
                out[joint] = self._of(segment)
        return out

    def _between(self, proximal: str, distal: str) -> list[int]:
        """Return the joints after the proximal frame's joint up to the distal frame's joint."""
        if proximal not in self._role_frame or distal not in self._role_frame:
            return []
        top, joint = (self._model.frames[self._role_frame[r]].parentJoint for r in (proximal, distal))
        chain = []
        while joint not in (0, top):
            chain.append(int(joint))
            joint = self._model.parents[joint]
        return chain if joint == top else []
