"""The robot's structure in a person's size: points fixed to its joints, their Jacobians, and its free coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pinocchio as pin

from imitor.ik.vectors import skew
from imitor.robot.model import BASE_NV, RobotModel
from imitor.types import Array, BoolArray

Trunk = Literal["prismatic", "free"]


class ScaledModel:
    """A scaled robot whose trunk moves freely in place of the legs, and whose joints have no limits.

    The 3 prismatic coordinates of the trunk stand for the legs [tomic2018] section 2.1 (T4); ``free``: it turns too.

    Args:
        robot: The robot in its own size.
        factors: Segment -> length factor [-].
        trunk: Whether the trunk shifts only, or turns as well.
        ends: Roles whose chains from the trunk are free; all other joints keep their values.

    Attributes:
        q: Configuration, shape (nq,).
        columns: The free coordinates, shape (c,): places in the velocity.
    """

    def __init__(
        self, robot: RobotModel, factors: Mapping[str, float], trunk: Trunk, ends: Sequence[str]
    ) -> None:
        self.robot = robot.scaled(factors)
        moved = np.zeros(robot.nv, dtype=bool)
        for role in ends:
            moved |= robot.ancestors(role) > 0.0
        moved[:BASE_NV] = False
        moved[: 3 if trunk == "prismatic" else BASE_NV] = True
        self.columns = np.flatnonzero(moved)
        self.q: Array = self.robot.standing.copy()
        self._parent: list[int] = []
        self._local = np.zeros((0, 3))
        self._masks = np.zeros((0, self.columns.size))

    def attach(self, joints: Sequence[int], local: Array) -> None:
        """Name the points of `points` and `jacobians`: Pinocchio joints and places in their frames, (P, 3) [m]."""
        self._parent = list(joints)
        self._local = np.asarray(local, dtype=float).reshape(-1, 3)
        masks = np.array([self._ancestors(j) for j in joints]).reshape(len(joints), self.robot.nv)
        self._masks = masks[:, self.columns]

    def update(self) -> None:
        """Bring placements and Jacobians to `q`."""
        pin.computeJointJacobians(self.robot.model, self.robot.data, self.q)

    def place(self) -> None:
        """Bring placements alone to `q`."""
        pin.forwardKinematics(self.robot.model, self.robot.data, self.q)

    def points(self) -> Array:
        """Return the attached points in world, shape (P, 3) [m]."""
        placed = self.robot.data.oMi
        rotation = np.array([placed[j].rotation for j in self._parent])
        origin = np.array([placed[j].translation for j in self._parent])
        return np.asarray((rotation @ self._local[:, :, None])[:, :, 0] + origin)

    def jacobians(self, points: Array) -> Array:
        """Return the Jacobians of the attached points, which are at ``points``, shape (P, 3, c).

        The velocity of a point p under the spatial velocity (v, w) about the world's origin is v + w x p.
        """
        J = self.robot.data.J[:, self.columns]
        return np.asarray((J[:3] + skew(-points) @ J[3:]) * self._masks[:, None, :])

    def turning(self, joint: int) -> Array:
        """Return the Jacobian of a joint frame's angular velocity in world, shape (3, c)."""
        return np.asarray(self.robot.data.J[3:, self.columns] * self._ancestors(joint)[self.columns])

    def move(self, step: Array) -> None:
        """Add a step of the free coordinates, shape (c,)."""
        v = np.zeros(self.robot.nv)
        v[self.columns] = step
        self.q[:] = self.robot.integrate(self.q, v)

    def joint_of(self, role: str) -> int:
        """Return the Pinocchio joint that carries a role's frame."""
        return int(self.robot.model.frames[self.robot.frame_id(role)].parentJoint)

    def place_of(self, role: str) -> Array:
        """Return where a role's frame lies in its joint's frame, shape (3,) [m]."""
        return np.array(self.robot.model.frames[self.robot.frame_id(role)].placement.translation)

    def chain(self, joint: int) -> list[int]:
        """Return the joints from the trunk to a joint, which is the last of them."""
        parents, out = self.robot.model.parents, []
        while joint > 0:
            out.append(int(joint))
            joint = parents[joint]
        return out[::-1]

    def _ancestors(self, joint: int) -> BoolArray:
        mask = np.zeros(self.robot.nv, dtype=bool)
        for j in self.chain(joint):
            first, width = self.robot.model.joints[j].idx_v, self.robot.model.joints[j].nv
            mask[first : first + width] = True
        return mask


__all__ = ["ScaledModel", "Trunk"]
