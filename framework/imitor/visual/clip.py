"""What is shown of a run: the robot's joints, soles and CoM and the human's points, frame by frame."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from imitor.metrics.polygon import Point, convex_hull
from imitor.record import Motion, Reference
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, Array, BoolArray


@dataclass(frozen=True)
class Clip:
    """T frames of robot and human in world.

    Attributes:
        time_s: shape (T,) [s].
        joint_position: Origins of the model's J joints (0 the world, 1 the base), shape (T, J, 3) [m].
        joint_quaternion: Their rotations x y z w, world from joint, shape (T, J, 4).
        com: The robot's centre of mass, shape (T, 3) [m].
        sole: Corners of the left and right sole, shape (T, 2, K, 3) [m].
        contact: The feet the robot stands on, shape (T, 2).
        frame: Role -> pose of the robot's frame, world from frame, shape (T, 4, 4), for the roles asked for.
        human: Role positions, shape (T, R, 3) [m]; NaN where not known.
        human_valid: shape (T, R).
        human_com: shape (T, 3) [m], NaN where not known.
        object_shift: How far each object around the robot was moved, shape (T, K, 3) [m].
    """

    time_s: Array
    joint_position: Array
    joint_quaternion: Array
    com: Array
    sole: Array
    contact: BoolArray
    frame: Mapping[str, Array]
    human: Array
    human_valid: BoolArray
    human_com: Array
    object_shift: Array = field(default_factory=lambda: np.zeros((0, 0, 3)))

    def __len__(self) -> int:
        return len(self.time_s)

    def shifts(self, count: int) -> Array:
        """Return how far each of ``count`` objects was moved, (T, count, 3) [m]; zeros where the run knew of none."""
        known = self.object_shift.shape[1] == count
        return self.object_shift if known else np.zeros((len(self), count, 3))

    def support_polygon(self, i: int) -> list[Point]:
        """Return the corners of the hull of the feet that stand in frame ``i`` [m]; may be empty."""
        corners = self.sole[i][self.contact[i]].reshape(-1, 3)
        return convex_hull([(float(x), float(y)) for x, y, _ in corners])

    @property
    def human_known(self) -> BoolArray:
        """Which roles are known in any frame, shape (R,)."""
        return np.asarray(self.human_valid.any(axis=0))

    @property
    def human_centre(self) -> Array:
        """Middle of the human's trunk or, where it is not known, of all known points, shape (T, 3) [m].

        Frames without any point lie between their neighbours; a clip without human gives the robot's base.
        """
        trunk = [ROLE_INDEX[r] for r in ("pelvis", "left_hip", "right_hip", "chest")]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # means over nothing are NaN, as wanted
            centre = np.nanmean(self.human[:, trunk], axis=1)
            anything = np.nanmean(self.human, axis=1)
        centre = np.where(np.isnan(centre), anything, centre)
        known = np.flatnonzero(~np.isnan(centre).any(axis=1))
        if not len(known):
            return np.asarray(self.joint_position[:, 1])
        rows = np.arange(len(centre))
        return np.column_stack([np.interp(rows, known, centre[known, k]) for k in range(3)])


def make_clip(
    robot: RobotModel, motion: Motion, reference: Reference, rows: np.ndarray, roles: Sequence[str] = ()
) -> Clip:
    """Return the chosen frames of a recorded run.

    The robot's shared state stays as it is: the frames are computed in a Data of their own.

    Args:
        robot: The robot of the motion.
        motion: The robot's motion.
        reference: The human, frame by frame as the motion.
        rows: Indices of the frames to show.
        roles: Roles whose frames are wanted.
    """
    import pinocchio as pin

    model, data = robot.model, robot.model.createData()
    n, n_joints = len(rows), model.njoints
    pose = np.empty((n, n_joints, 7))
    com = np.empty((n, 3))
    ids = {role: robot.frame_id(role) for role in roles}
    frame = {role: np.empty((n, 4, 4)) for role in roles}
    feet = [robot.frame_id(f"{side}_foot") for side in ("left", "right")]
    sole = np.empty((n, *robot.sole.shape))
    for i, q in enumerate(motion.configurations()[rows]):
        pin.centerOfMass(model, data, q, False)
        for j in range(n_joints):
            pose[i, j] = pin.SE3ToXYZQUAT(data.oMi[j])
        com[i] = data.com[0]
        for k, foot in enumerate(feet):
            M = pin.updateFramePlacement(model, data, foot)
            sole[i, k] = robot.sole[k] @ M.rotation.T + M.translation
        for role, fid in ids.items():
            frame[role][i] = pin.updateFramePlacement(model, data, fid).homogeneous
    valid = reference.role_valid[rows]
    human = np.where(valid[:, :, None], reference.role_position_m[rows], np.nan)
    return Clip(
        time_s=motion.time_s[rows],
        joint_position=pose[:, :, :3],
        joint_quaternion=pose[:, :, 3:],
        com=com,
        sole=sole,
        contact=motion.contact[rows],
        frame=frame,
        human=human,
        human_valid=valid & np.isfinite(human).all(axis=2),
        human_com=reference.human_com_m[rows],
        object_shift=reference.object_shift_m[rows],
    )


def rows_at(time_s: Array, rate_hz: float, begin_s: float = 0.0, end_s: float | None = None) -> np.ndarray:
    """Return the frames nearest to an even grid of times, none twice.

    Args:
        time_s: Times of the frames, increasing, shape (T,) [s].
        rate_hz: Frames wanted per second [Hz].
        begin_s: From where, counted from the first frame [s].
        end_s: Until where; the end where it is ``None`` [s].
    """
    if len(time_s) == 1:
        return np.zeros(1, dtype=np.intp)
    since = time_s - time_s[0]
    last = float(since[-1]) if end_s is None else min(end_s, float(since[-1]))
    begin_s = min(begin_s, last)
    wanted = begin_s + np.arange(int((last - begin_s) * rate_hz + 1e-6) + 1) / rate_hz
    after = np.clip(np.searchsorted(since, wanted), 1, len(since) - 1)
    nearer = after - (wanted - since[after - 1] < since[after] - wanted)
    return np.unique(nearer)


def rotation_matrices(quaternion: Array) -> Array:
    """Return rotation matrices of unit quaternions x y z w, shape (..., 3, 3)."""
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
