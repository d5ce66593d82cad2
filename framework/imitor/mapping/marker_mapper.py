"""The mapper that two algorithms share: a person's poses on the scaled robot, written as hand and posture targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from pydantic import Field

from imitor.kinds import Config, Mapper
from imitor.tasks import TaskKind, TaskStack
from imitor.types import SIDES, Array, HumanFrame

if TYPE_CHECKING:
    from imitor.mapping.marker_imitation import MarkerImitation


class MarkerMapperConfig(Config):
    """Options of mappers from markers."""

    calibration_s: float = Field(
        1.0, gt=0, le=60, description="How long the person holds the calibration pose at the start [s]."
    )
    pose: dict[str, float] | None = Field(
        None,
        description="Joint values of the robot in the calibration pose, {S} and {s} both sides, others 0; none: near "
        "the standing posture [rad].",
    )


C = TypeVar("C", bound=MarkerMapperConfig)


class MarkerMapper(Mapper[C]):
    """Base of mappers that lead a scaled robot by markers; a subclass makes the imitation.

    Declares the poses of the hands, which are those of the scaled robot and so the person's, the posture with its
    joints, and the pose of its pelvis, which holds the place of the robot's: the waist is the anchor, over the
    place on the floor where the person's was in the calibration, facing the same way, as high as the robot stands.
    So the robot is held at its pelvis, and no foot is in contact.
    """

    wants = frozenset({"targets"})
    declares: Mapping[str, TaskKind] = {  # type: ignore[misc]
        "left_hand": TaskKind.POSE,
        "right_hand": TaskKind.POSE,
        "pelvis": TaskKind.POSE,
        "posture": TaskKind.POSTURE,
    }
    imitation: MarkerImitation
    """The scaled robot; made by `declare`."""

    def make(self) -> MarkerImitation:
        """Return the imitation of this algorithm."""
        raise NotImplementedError

    @property
    def calibration_s(self) -> float:
        """How long the calibration pose is held [s]."""
        return self.config.calibration_s

    def declare(self, stack: TaskStack) -> None:
        """Declare hands, pelvis and posture."""
        self.imitation = self.make()
        hands = [f"{side}_hand" for side in SIDES if self.robot.has(f"{side}_hand")]
        self._hands = [(stack.declare(name, TaskKind.POSE, frame=name), name) for name in hands]
        self._pelvis = stack.declare("pelvis", TaskKind.POSE, frame="waist")
        self._posture = stack.declare("posture", TaskKind.POSTURE)
        robot = self.robot
        self._height = float(robot.twin().position("waist")[2])
        self._anchor: Array = np.eye(4)

    def calibrate(self, frames: Sequence[HumanFrame]) -> None:
        """Scale the robot to the person and attach the virtual markers."""
        self.imitation.calibrate(frames)

    def missing(self, frame: HumanFrame) -> Sequence[str]:
        """Return the rigid markers of the arms while none of them is seen; single ones are led by the others."""
        markers = self.imitation.criterion.real_markers(frame)
        return () if np.isfinite(markers[:, 0, 0]).any() else ("the rigid markers of both arms",)

    def reset(self) -> None:
        """Go back to the calibration pose."""
        self.imitation.reset()
        scaled = self.imitation.model.robot
        scaled.update(self.imitation.model.q)
        self._anchor = scaled.pose("waist")
        self._anchor[2, 3] = self._height
        forward = self._anchor[:2, 0] / np.hypot(*self._anchor[:2, 0])
        self._anchor[:3, :3] = ((forward[0], -forward[1], 0), (forward[1], forward[0], 0), (0, 0, 1))

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        """Write the targets of this frame."""
        self.imitation.take(frame)
        scaled = self.imitation.model.robot
        for task, role in self._hands:
            task.target[:3, :3], task.target[:3, 3] = scaled.rotation(role), scaled.position(role)
        self._pelvis.target[:3, :3], self._pelvis.target[:3, 3] = (
            scaled.rotation("waist"),
            scaled.position("waist"),
        )
        self._posture.target[:] = self.imitation.model.q[7:]
        stack.contact[:] = False  # the pelvis is held; the legs hang from it
        stack.anchor = "waist"
        stack.anchor_pose[:] = self._anchor


__all__ = ["MarkerMapper", "MarkerMapperConfig"]
