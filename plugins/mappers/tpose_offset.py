"""Offsets from the T-pose: the hands and feet leave their reference as the human's do, in proportion to the limbs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from imitor import Component, Config, HumanFrame, ImitorError, Mapper, TaskKind, TaskStack, hookimpl
from imitor.types import SIDES, Array

Vector = tuple[float, float, float]
_FREE_HEADING = np.array([True, True, False])


class TposeOffsetConfig(Config):
    """Options of the T-pose offsets."""

    calibration: Literal["auto", "recording", "rest_pose", "given"] = Field(
        "auto",
        description="Where the human's T-pose is: in the first seconds of the recording; the segments of the "
        "skeleton's rest pose put into one; given as `reference`; auto: the recording's, or else the rest pose's.",
    )
    search_s: float = Field(3.0, gt=0, description="How long from the start the T-pose is looked for [s].")
    t_pose_rad: float = Field(
        0.35, gt=0, le=1.5, description="How far arms and legs may be off a T-pose to be taken for one [rad]."
    )
    reference: Mapping[Literal["hand", "foot"], Vector] = Field(
        {},
        description="With `given`: the human's left limb vectors in the T-pose, shoulder to hand in the chest's axes, "
        "hip to ankle in the waist's (x forward, y left, z up); y is mirrored for the right [m].",
    )
    reach: Annotated[float, Field(gt=0, le=1)] = Field(
        0.99,
        description="A target further away than this share of the limb's length is brought back to it [-].",
    )
    leg_reach: Annotated[float, Field(gt=0, le=1)] = Field(
        0.97, description="The same for legs, so that the knee does not end stretched out [-]."
    )


class TposeOffset(Mapper[TposeOffsetConfig]):
    """Hands and feet leave their T-pose as the human's do, scaled by limb length [koenemann2014] eqs. 1-5 (K1).

    The hand is taken relative to the shoulder in axes fixed to the chest (left: the line of the shoulders; up: the
    torso), the foot relative to the hip in axes fixed to the waist (left: the line of the hips). Targets are positions
    relative to the robot's chest and waist, so each moves its limb alone. The waist is the anchor: turned as the
    human's, over the foot that stands; a stabilizer may set the robot on its soles instead. A limb that is lost keeps
    its last target.
    """

    name = "tpose_offset"
    wants = frozenset({"support"})
    declares: Mapping[str, TaskKind] = {  # type: ignore[misc]
        "left_hand": TaskKind.POSITION,
        "right_hand": TaskKind.POSITION,
        "left_foot": TaskKind.POSITION,
        "right_foot": TaskKind.POSITION,
        "left_sole": TaskKind.ORIENTATION,
        "right_sole": TaskKind.ORIENTATION,
        "waist": TaskKind.ORIENTATION,
        "com": TaskKind.COM,
        "posture": TaskKind.POSTURE,
    }

    @property
    def calibration_s(self) -> float:
        """The first seconds, where the T-pose may be in them."""
        return self.config.search_s if self.config.calibration in ("auto", "recording") else 0.0

    def declare(self, stack: TaskStack) -> None:
        """Declare hands and feet relative to chest and waist, and what balance needs."""
        from imitor.balance.offset import yaw, yaw_of
        from imitor.mapping.limb_vectors import HumanLimbs, RobotLimbs, looks_like_t_pose

        self._yaw, self._yaw_of, self._looks_like_t_pose = yaw, yaw_of, looks_like_t_pose
        config, robot = self.config, self.robot
        self._human = HumanLimbs(self.skeleton)
        self._limbs = RobotLimbs(robot, config.reach, config.leg_reach)
        self._tasks = [
            stack.declare(limb.name, TaskKind.POSITION, frame=limb.end, relative_to=limb.carrier)
            for limb in self._limbs.limbs
        ]
        self._soles = [
            stack.declare(f"{side}_sole", TaskKind.ORIENTATION, frame=f"{side}_foot") for side in SIDES
        ]
        self._waist = stack.declare("waist", TaskKind.ORIENTATION, frame="waist")
        self._com = stack.declare("com", TaskKind.COM)
        self._posture = stack.declare("posture", TaskKind.POSTURE)
        self._set_reference(self._first_reference())

    def _first_reference(self) -> Array:
        """Return the human's T-pose as known before any frame, shape (4, 3) [m]."""
        if self.config.calibration != "given":
            return self._human.t_pose_of_lengths()
        given = self.config.reference
        if {"hand", "foot"} - given.keys():
            raise ImitorError(
                "calibration is `given`, so `reference` needs both `hand` and `foot` vectors [m]"
            )
        vectors = np.array([given["hand"], given["hand"], given["foot"], given["foot"]], dtype=float)
        vectors[1::2, 1] *= -1.0
        return vectors

    def _set_reference(self, human: Array) -> None:
        """Keep the human's T-pose and the ratios of limb lengths (eq. 4)."""
        length = np.linalg.norm(human, axis=1)
        if not (length > 1e-3).all():
            raise ImitorError(
                f"the limb lengths {np.round(length, 3).tolist()} m of the T-pose are not those of a human; give a "
                "recording with all limbs visible at its start, or `calibration: given` with `reference`"
            )
        self.human_reference = human
        self.ratio = np.linalg.norm(self._limbs.reference, axis=1) / length
        self._ratio_column, self._leg_ratio = self.ratio[:, None], float(self.ratio[2:].mean())

    def calibrate(self, frames: Sequence[HumanFrame]) -> None:
        """Look for the T-pose; its frames are averaged."""
        found = []
        for frame in frames:
            self._human.take(frame)
            if self._human.seen.all() and self._looks_like_t_pose(
                self._human.vectors, self.config.t_pose_rad
            ):
                found.append(self._human.vectors.copy())
        if found:
            self._set_reference(np.mean(found, axis=0))
        elif self.config.calibration == "recording":
            raise ImitorError(
                f"no T-pose in the first {self.config.search_s:g} s: arms sideways and legs straight within "
                f"{self.config.t_pose_rad:g} rad; set calibration to rest_pose, or raise search_s or t_pose_rad"
            )

    def reset(self) -> None:
        """Forget the last targets."""
        self._human.reset()
        self.limb_targets = self._limbs.origin + self._limbs.standing
        self._ground = (0.0, 0.0)
        self._support = -1

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        """Write the targets of this frame."""
        human, limbs = self._human, self._limbs
        human.take(frame)
        change = self._ratio_column * (human.vectors - self.human_reference)  # eqs. 2 and 3
        target = limbs.origin + limbs.within_reach(limbs.reference + change)  # eq. 5
        if not human.seen.all():
            target = np.where(human.seen[:, None], target, self.limb_targets)
        self.limb_targets = target
        for task, place in zip(self._tasks, self.limb_targets, strict=True):
            task.target[:] = place
        support = frame.support
        contact = [True, True] if support is None else [support.left, support.right]
        stack.contact[:] = contact
        R = self._waist.target
        if human.waist_seen:
            R[:] = human.waist
        heading = self._yaw(self._yaw_of(R))
        for sole, stands in zip(self._soles, contact, strict=True):
            sole.target[:] = heading
            sole.mask[:] = _FREE_HEADING
            sole.active[0] = stands
        self._place_waist(stack, R, contact)
        if frame.com is not None and human.waist_seen:
            offset = self._leg_ratio * (frame.com - human.mid_hip)
            self._com.target[:] = stack.anchor_pose[:3, 3] + R.dot(self._limbs.mid_hip) + offset
        self._posture.target[:] = self.robot.standing[7:]

    def _place_waist(self, stack: TaskStack, R: Array, contact: Sequence[bool]) -> None:
        """Anchor the waist so that the foot that stands keeps its place on the ground."""
        feet = self.limb_targets[2:].dot(R.T).tolist()
        lowest = 0 if feet[0][2] <= feet[1][2] else 1
        foot = lowest if contact[0] == contact[1] else int(contact[1])
        x, y, z = feet[foot]
        if self._support < 0:
            self._ground = (x, y)
        elif foot != self._support:
            last = feet[self._support]
            self._ground = (self._ground[0] + x - last[0], self._ground[1] + y - last[1])
        self._support = foot
        stack.anchor, pose = "waist", stack.anchor_pose
        pose[:3, :3] = R
        pose[:3, 3] = self._ground[0] - x, self._ground[1] - y, -z
        pose[3] = (0.0, 0.0, 0.0, 1.0)


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the mapper."""
    return [TposeOffset]
