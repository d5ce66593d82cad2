"""The Humanoid-Normalized model: positions and virtual planes of the human in the robot's size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from imitor import Component, HumanFrame, TaskKind, TaskStack, hookimpl
from imitor.mapping.scaling_mapper import ScalingMapper
from imitor.types import ROLE_INDEX, ROLES, SIDES

if TYPE_CHECKING:
    from imitor.mapping.scaled_body import ScaledBody

_PARTS = ("head", "chest", "waist")
NEEDED = ("head", *(f"{s}_{r}" for s in SIDES for r in ("shoulder", "elbow", "wrist", "hip", "ankle")))
"""Points of the model that it does not go on without, of those that the recording has."""


class NormalizedModel(ScalingMapper):
    """The human as positions of head, wrists and feet and normals of virtual planes [montecillo2010] eqs. 1, 2, 5, 6.

    Works with markers (planes through three markers of head, thorax and pelvis), with orientations, or with points
    alone. Legs take the length that the robot's have when it stands, so that an upright human is the robot's standing
    posture and straight knees of the human leave the robot room to rise.

    Declares the vectors `head_vector`, `chest_vector` and `waist_vector` (where each part faces; the turn about it is
    free), the poses of both wrists, the position of the head, and beside them whatever segment_scaling declares, so
    that other stabilizers and orders work too. Feet stand and swing as those of segment_scaling.
    """

    name = "normalized_model"
    declares: Mapping[str, TaskKind] = {  # type: ignore[misc]
        **ScalingMapper.declares,
        **{f"{part}_vector": TaskKind.VECTOR for part in _PARTS},
        "left_wrist": TaskKind.POSE,
        "right_wrist": TaskKind.POSE,
    }

    def scaled_body(self) -> ScaledBody:
        """Return the scaled body of the normalised model."""
        from imitor.mapping.normalized import NormalizedBody

        self.model = NormalizedBody(self.robot, self.skeleton, self.dt_s)
        return self.model.body

    def declare(self, stack: TaskStack) -> None:
        """Declare the tasks the robot has frames for."""
        super().declare(stack)
        self._needed = [ROLE_INDEX[r] for r in NEEDED if self.skeleton.has(r)]
        self._vectors = [
            (stack.declare(f"{part}_vector", TaskKind.VECTOR, frame=part), part)
            for part in _PARTS
            if self.robot.has(part)
        ]
        self._wrists = [
            stack.declare(f"{side}_wrist", TaskKind.POSE, frame=f"{side}_wrist") for side in SIDES
        ]

    def missing(self, frame: HumanFrame) -> Sequence[str]:
        """Return the points of the model that are not seen: a part of it alone is no model [montecillo2010]."""
        if frame.valid[self._needed].all():
            return ()
        return [ROLES[i] for i in self._needed if not frame.valid[i]]

    def reset(self) -> None:
        """Forget the person and where the feet stood."""
        super().reset()
        self.model.reset()
        self._placed = False

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        """Write the targets of this frame."""
        super().step(frame, stack)
        model, footing = self.model, self._footing
        if self.config.support == "robot" and self._placed:  # where a stabilizer has put them
            left, right = (self.robot.position(f"{side}_ankle") for side in SIDES)
        else:
            left, right = (foot.ankle_of(foot.pose) for foot in footing.feet)
        self._placed = True
        model.step(frame, frame.support, (left, right), stack.contact)
        moved = model.mid_hip + (model.mid_shoulder - model.mid_hip) - footing.mid_hip - self._mid_shoulder()
        for task, _ in self._positions:
            task.target[:] = model.head if task.name == "head" else task.target + moved
        self._com.target[:] = model.mid_hip + self._com_offset
        for task, part in self._vectors:
            task.target[:] = model.turn[part][:, 0]
        for task, pose in zip(self._wrists, model.wrist, strict=True):
            task.target[:] = pose

    def _mid_shoulder(self) -> Any:
        """Where segment scaling has the middle of the shoulders over the hips, shape (3,) [m]."""
        return self._body.relative[1]


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the mapper."""
    return [NormalizedModel]
