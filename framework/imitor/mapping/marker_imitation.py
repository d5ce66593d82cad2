"""A scaled robot that takes a person's poses: calibrated in a known pose, then led from frame to frame.

Two ways to lead it: by the analytic step of [tomic2018] eq. 11 on markers and joints, or numerically on the markers
alone as in [ude2004]. Joint limits do not count here: the scaled robot stands for the person.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from imitor.errors import ImitorError
from imitor.mapping.scaled_model import ScaledModel, Trunk
from imitor.mapping.segment_factors import segment_factors
from imitor.mapping.virtual_markers import Criterion, Weights, arms_of
from imitor.robot.card import expand
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SIDES, Array, HumanFrame

Step = Callable[[Criterion, Array, Array], Array]
_LARGEST_STEP = 0.5
"""A single step moves no coordinate further [m or rad]: points that come back are far away."""
_PLACING = Weights(alpha=0.0, beta=1.0, gamma=0.0, delta=1.0)
_PLACING_STEPS, _PLACING_DAMPING = 60, 0.05
_FIRST_STEPS = 30


class MarkerImitation:
    """The scaled robot of one person.

    Args:
        robot: The robot in its own size.
        target_names: The rigid markers of the recording.
        trunk: Coordinates in place of the legs.
        pose: Robot joints in the calibration pose [rad], others 0; ``None`` when the pose is unknown.
        weights: Of the criterion.
        step: Finds the step of the free coordinates.
        steps: Steps per frame.
    """

    def __init__(
        self,
        robot: RobotModel,
        target_names: Sequence[str],
        trunk: Trunk,
        pose: Mapping[str, float] | None,
        weights: Weights,
        step: Step,
        steps: int,
    ) -> None:
        self._robot, self._names, self._trunk = robot, list(target_names), trunk
        self._weights, self._step, self._steps = weights, step, steps
        self._ends = [f"{s}_{'hand' if robot.has(f'{s}_hand') else 'wrist'}" for s in SIDES]
        self._pose = robot.standing[7:].copy()
        if pose is not None:  # outside the joint limits too: the person has others
            self._pose[:] = 0.0
            for name, value in expand(dict(pose)).items():
                self._pose[robot.joint_index(name, "pose")] = value
        self.factors: dict[str, float] = {}
        self._build({})

    def _build(self, factors: Mapping[str, float]) -> None:
        self.model = ScaledModel(self._robot, factors, self._trunk, self._ends)
        arms = arms_of(self.model, self._names)
        index = [self._names.index(name) for name in arms.markers]
        self.criterion = Criterion(self.model, arms, self._weights, index)
        self._placing = (arms, index)
        self._initial: Array = self.model.q.copy()

    def calibrate(self, frames: Sequence[HumanFrame]) -> None:
        """Scale the robot to the person and attach the virtual markers (T1, T2).

        Raises:
            ImitorError: No marker of the arms, or neither shoulders nor hands, are seen in these frames.
        """
        self.factors = segment_factors(self._robot, frames)
        self._build(self.factors)
        criterion = self.criterion
        real = np.stack([criterion.real_markers(f) for f in frames])
        position = np.stack([f.position for f in frames])
        mean = position[0].copy()
        seen = np.asarray(np.isfinite(position).all(axis=2))
        for role in np.flatnonzero(seen.any(axis=0)):
            mean[role] = position[seen[:, role], role].mean(axis=0)
        if not np.isfinite(real).all(axis=(2, 3)).any(axis=0).all() or not real.shape[1]:
            raise ImitorError(
                "not all markers of the arms are seen in the calibration; it needs the rigid markers "
                "left_upper_arm, left_forearm, left_hand and those of the right arm; lengthen calibration_s, or wear "
                "them (source.targets=true)"
            )
        self._place(mean)
        criterion.place_markers(np.stack([_mean_pose(real[:, i]) for i in range(real.shape[1])]))
        self._initial = self.model.q.copy()

    def reset(self) -> None:
        """Go back to the calibration pose."""
        self.model.q[:] = self._initial
        self._first = True

    def take(self, frame: HumanFrame) -> None:
        """Lead the scaled robot to a frame; where nothing is seen it stays."""
        steps = _FIRST_STEPS if self._first else self._steps
        self._first = False
        goal, real = self.criterion.targets(frame)
        for _ in range(steps):
            self.model.update()
            step = self._step(self.criterion, goal, real)
            largest = float(np.abs(step).max(initial=0.0))
            self.model.move(step if largest <= _LARGEST_STEP else step * (_LARGEST_STEP / largest))
        self.model.robot.update(self.model.q)

    def _place(self, mean: Array) -> None:
        """Bring the scaled robot into the calibration pose, where the person's joints are."""
        model = self.model
        model.q[7:] = self._pose
        shoulders = [mean[ROLE_INDEX[f"{side}_shoulder"]] for side in SIDES]
        if np.isfinite(shoulders).all():
            left = shoulders[0] - shoulders[1]
            yaw = np.arctan2(-left[0], left[1])
            model.q[3:7] = (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
            model.robot.update(model.q)
            at = 0.5 * (model.robot.position("left_shoulder") + model.robot.position("right_shoulder"))
            model.q[:3] += 0.5 * (shoulders[0] + shoulders[1]) - at
        arms, index = self._placing
        placing = Criterion(model, arms, _PLACING, index)
        frame = HumanFrame(0.0, mean, np.asarray(np.isfinite(mean).all(axis=1)))
        goal, real = placing.targets(frame)
        for _ in range(
            _PLACING_STEPS
        ):  # damped: twists that the joints do not show stay as the pose has them
            model.update()
            e, J = placing.rows(goal, real)
            damped = J.T @ J + _PLACING_DAMPING**2 * np.eye(J.shape[1])
            model.move(np.clip(-np.linalg.solve(damped, J.T @ e), -0.2, 0.2))
        self.criterion.place_markers(np.tile(np.eye(4), (len(arms.markers), 1, 1)))


def analytic_step(criterion: Criterion, goal: Array, real: Array) -> Array:
    """Return the step of eq. 11: the pseudo-inverse of the criterion's derivative times its value."""
    e, J = criterion.rows(goal, real)
    return np.asarray(np.linalg.lstsq(J, -e, rcond=1e-4)[0])


def _mean_pose(poses: Array) -> Array:
    """Return the mean of poses, shape (T, 4, 4), some of them NaN: the nearest rotation to the mean matrix."""
    mean = poses[np.isfinite(poses).all(axis=(1, 2))].mean(axis=0)
    U, _, Vt = np.linalg.svd(mean[:3, :3])
    mean[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return np.asarray(mean)


__all__ = ["MarkerImitation", "analytic_step"]
