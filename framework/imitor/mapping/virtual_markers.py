r"""Real markers on a scaled robot: virtual marker frames, the imitation criterion and its analytic Jacobian.

The criterion [tomic2018] eqs. 7 and 8 stacks, with weights :math:`\alpha, \beta, \gamma, \delta`, errors of marker
positions, of shoulders and elbows, of the orientation of the hands' markers and of the hand joints. The orientation
error is the vector part of a quaternion product, eq. 9, with real marker :math:`(\eta_r, e_r)` and virtual one
:math:`(\eta_v, e_v)`

.. math:: \Delta e = \eta_v e_r - \eta_r e_v - S(e_r) e_v .

Turning with angular velocity :math:`\omega` in world, a quaternion changes by :math:`\dot\eta = -e^T\omega/2` and
:math:`\dot e = (\eta I - S(e))\,\omega/2` (the matrix Omega of the appendix), which gives the rows of eq. 10.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imitor.ik.vectors import skew
from imitor.mapping.scaled_model import ScaledModel
from imitor.robot.model import quaternion_of
from imitor.types import ROLE_INDEX, SIDES, Array, HumanFrame

PARTS = ("upper_arm", "forearm", "hand")
"""Segments of each arm that carry a marker."""
_EYE = np.eye(3)


@dataclass(frozen=True)
class Weights:
    """Weights of the criterion [-]: marker positions, joints, hand marker orientations, hand joints."""

    alpha: float = 1.0
    beta: float = 2.0
    gamma: float = 10.0
    delta: float = 20.0


@dataclass(frozen=True)
class Arms:
    """Which points of human and robot the criterion compares.

    Attributes:
        markers: Names of the rigid markers, in the order of ``sides`` within ``parts``.
        joints: Roles of shoulders and elbows.
        hands: Roles of the hand joints: wrists, or knuckles where the robot has no wrists.
    """

    markers: tuple[str, ...]
    joints: tuple[str, ...]
    hands: tuple[str, ...]

    @property
    def roles(self) -> tuple[str, ...]:
        """All joint roles, proximal ones first."""
        return (*self.joints, *self.hands)


def arms_of(model: ScaledModel, markers: Sequence[str]) -> Arms:
    """Return what the criterion compares on this robot, for the markers that the person wears."""
    has = model.robot.has
    hands = tuple(f"{side}_wrist" if has(f"{side}_wrist") else f"{side}_hand" for side in SIDES)
    joints = tuple(f"{side}_{joint}" for joint in ("shoulder", "elbow") for side in SIDES)
    worn = tuple(f"{side}_{part}" for part in PARTS for side in SIDES)
    return Arms(tuple(name for name in worn if name in markers), tuple(j for j in joints if has(j)), hands)


class Criterion:
    """The criterion of one person on one scaled robot, for the configuration of the model.

    Args:
        model: The scaled robot; its points are attached here.
        arms: What is compared.
        weights: Of the four kinds of error.
        index: Places of ``arms.markers`` among the person's targets.

    Attributes:
        carrier: Joint that carries each virtual marker, and ``virtual``, their poses in its frame, shape (M, 4, 4).
        rest: Configuration in which they were placed, shape (nq,).
    """

    def __init__(self, model: ScaledModel, arms: Arms, weights: Weights, index: Sequence[int]) -> None:
        self.model, self.arms, self.weights = model, arms, weights
        self._index = np.asarray(index, dtype=int)
        self._roles = np.array([ROLE_INDEX[r] for r in arms.roles])
        self._joint = [model.joint_of(r) for r in arms.roles]
        self._place = [model.place_of(r) for r in arms.roles]
        n_markers, n_joints = len(arms.markers), len(arms.joints)
        hands = [i for i, name in enumerate(arms.markers) if name.endswith("_hand")]
        self._hands = np.array(hands, dtype=int)
        weight = [weights.alpha] * n_markers + [weights.beta] * n_joints + [weights.delta] * len(arms.hands)
        self._weight = np.array(weight)
        self.carrier = [self._nearest_joint(name) for name in arms.markers]
        self.rest: Array = model.q.copy()
        self.virtual = np.tile(np.eye(4), (n_markers, 1, 1))
        self._attach()

    def place_markers(self, real: Array) -> None:
        """Fix the virtual markers where the mean real ones are, at the model's configuration (T2).

        Args:
            real: Mean poses of ``arms.markers``, world from marker, shape (M, 4, 4).
        """
        self.model.update()
        self.rest[:] = self.model.q
        for i, joint in enumerate(self.carrier):
            placed = self.model.robot.data.oMi[joint]
            self.virtual[i, :3, :3] = placed.rotation.T @ real[i, :3, :3]
            self.virtual[i, :3, 3] = placed.rotation.T @ (real[i, :3, 3] - placed.translation)
        self._attach()

    def real_markers(self, frame: HumanFrame) -> Array:
        """Return the poses of ``arms.markers``, world from marker, shape (M, 4, 4); NaN where lost."""
        if frame.target is None:
            return np.full((len(self.arms.markers), 4, 4), np.nan)
        return np.asarray(frame.target[self._index])

    def targets(self, frame: HumanFrame) -> tuple[Array, Array]:
        """Return where the points shall be, shape (P, 3), and real marker poses, (M, 4, 4); NaN where unknown."""
        real = self.real_markers(frame)
        return np.concatenate([real[:, :3, 3], frame.position[self._roles]]), real

    def rows(self, goal: Array, real: Array) -> tuple[Array, Array]:
        """Return the error of eq. 8 and its derivative, shapes (m,) and (m, c); rows of lost points are 0.

        Args:
            goal, real: Of `targets`.
        """
        model = self.model
        at = model.points()
        error = (goal - at) * self._weight[:, None]
        slope = -model.jacobians(at) * self._weight[:, None, None]
        errors, slopes = [error.reshape(-1)], [slope.reshape(-1, slope.shape[2])]
        for i in self._hands if self.weights.gamma > 0.0 else ():
            e, J = self._turned(i, real[i, :3, :3])
            errors.append(self.weights.gamma * e)
            slopes.append(self.weights.gamma * J)
        stacked, jacobian = np.concatenate(errors), np.concatenate(slopes)
        lost = ~np.isfinite(stacked)
        if lost.any():
            stacked[lost], jacobian[lost] = 0.0, 0.0
        return stacked, jacobian

    def _turned(self, i: int, real: Array) -> tuple[Array, Array]:
        """Return the orientation error of a hand's marker, eq. 9, and its derivative."""
        if not np.isfinite(real).all():
            return np.full(3, np.nan), np.zeros((3, self.model.columns.size))
        joint = self.carrier[i]
        virtual = self.model.robot.data.oMi[joint].rotation @ self.virtual[i, :3, :3]
        e_v, n_v = _quaternion(virtual)
        e_r, n_r = _quaternion(real)
        if e_r @ e_v + n_r * n_v < 0.0:  # the same rotation, on the nearer side
            e_r, n_r = -e_r, -n_r
        error = n_v * e_r - n_r * e_v - np.cross(e_r, e_v)
        turn = self.model.turning(joint)
        d_n = -0.5 * (e_v @ turn)
        d_e = 0.5 * ((n_v * _EYE - skew(e_v)) @ turn)
        return error, np.outer(e_r, d_n) - n_r * d_e - skew(e_r) @ d_e

    def _nearest_joint(self, name: str) -> int:
        """Return the joint that carries a marker: the last one of the chain that starts its segment."""
        side, _, part = name.partition("_")
        starts = {"upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist"}
        role = f"{side}_{starts[part]}"
        return self.model.joint_of(role if self.model.robot.has(role) else f"{side}_hand")

    def _attach(self) -> None:
        places = [*self.virtual[:, :3, 3], *self._place]
        self.model.attach([*self.carrier, *self._joint], np.array(places))


def _quaternion(R: Array) -> tuple[Array, float]:
    """Return vector and scalar part of a rotation's quaternion."""
    q = quaternion_of(np.ascontiguousarray(R))
    return q[:3], float(q[3])


__all__ = ["PARTS", "Arms", "Criterion", "Weights", "arms_of"]
