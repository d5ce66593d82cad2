"""The mapper of scaled segments: the human's directions with the robot's lengths, on the robot's feet."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, inf
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from imitor.kinds import Config, Mapper
from imitor.tasks import TaskKind, TaskStack
from imitor.types import SEGMENTS, SIDES, HumanFrame, Support

if TYPE_CHECKING:
    from imitor.mapping.scaled_body import ScaledBody

_POSITIONS = ("head", "left_hand", "right_hand")


class SegmentScalingConfig(Config):
    """Options of segment scaling."""

    anchor: bool = Field(
        True, description="Fix the support foot to the world exactly; no: feet are tasks only."
    )
    support: Literal["human", "robot"] = Field(
        "human",
        description="Whose support decides which feet stand: the human's; or the robot's own, where a stabilizer "
        "(support_transition) changes it in its own time and the body is to stand on the feet the robot has.",
    )
    posture: Literal["standing", "human"] = Field(
        "standing",
        description="Target of the task `posture`: the standing posture, or the human's joint values in the robot's "
        "joint structure (eq. 8).",
    )
    free_foot: Literal["position", "ground"] = Field(
        "position",
        description="What is tracked of the ankle of a foot in the air: position, its scaled place; ground, only its "
        "height, so that the leg's directions place it.",
    )
    replace_m: float | None = Field(
        None,
        gt=0,
        description="In double support, step a foot that is further off the scaled body's than this, because the "
        "human slid or turned on the spot; none: both feet keep their places [m].",
    )
    replace_rad: float = Field(
        0.5, gt=0, description="The same for the heading of a foot, where replace_m is given [rad]."
    )
    roll: bool = Field(
        False,
        description="Whether a standing foot rolls over the edge of its sole when the human's heel or toes rise.",
    )
    flat_below_m: float = Field(
        0.04, gt=0, description="A free foot with heel and toes lower than this is held flat [m]."
    )
    free_above_m: float = Field(
        0.15,
        gt=0,
        description="Above this clearance a foot's height follows the scaled leg, not the ground [m].",
    )
    blend_s: float = Field(
        0.1, ge=0, description="Time constant to fade the offset of a foot after it lifted off [s]."
    )


class ScalingMapper(Mapper[SegmentScalingConfig]):
    """Base of mappers that size a person segment by segment; see `imitor.plugins.mappers.segment_scaling`."""

    wants = frozenset({"support"})
    declares: Mapping[str, TaskKind] = {  # type: ignore[misc]
        **dict.fromkeys(SEGMENTS, TaskKind.DIRECTION),
        "left_foot": TaskKind.POSE,
        "right_foot": TaskKind.POSE,
        "left_ankle": TaskKind.POSITION,
        "right_ankle": TaskKind.POSITION,
        "left_sole": TaskKind.ORIENTATION,
        "right_sole": TaskKind.ORIENTATION,
        "waist": TaskKind.ORIENTATION,
        "chest": TaskKind.ORIENTATION,
        **dict.fromkeys(_POSITIONS, TaskKind.POSITION),
        "com": TaskKind.COM,
        "posture": TaskKind.POSTURE,
    }

    def declare(self, stack: TaskStack) -> None:
        """Declare the tasks the robot has frames for."""
        from imitor.ik.vectors import cross3
        from imitor.mapping.footing import Footing, FootSettings
        from imitor.mapping.human_joints import HumanJoints
        from imitor.mapping.scaled_body import POINTS

        robot, config = self.robot, self.config
        self._cross3 = cross3
        self._body = self.scaled_body()
        self._settings = FootSettings(
            flat_below_m=config.flat_below_m,
            free_above_m=config.free_above_m,
            blend_s=config.blend_s,
            replace_m=inf if config.replace_m is None else config.replace_m,
            replace_rad=inf if config.replace_m is None else config.replace_rad,
            roll=config.roll,
        )
        self._footing = Footing(robot, self.skeleton, self._settings, self.dt_s)
        self._ground_only = config.free_foot == "ground"
        index = self._body.segments.index
        self._directions = [
            (stack.declare(name, TaskKind.DIRECTION, frame=distal, relative_to=proximal), index(name))
            for name, (proximal, distal) in SEGMENTS.items()
        ]
        self._feet = [stack.declare(f"{side}_foot", TaskKind.POSE, frame=f"{side}_foot") for side in SIDES]
        self._free = [
            stack.declare(f"{side}_ankle", TaskKind.POSITION, frame=f"{side}_ankle") for side in SIDES
        ]
        self._soles = [
            stack.declare(f"{side}_sole", TaskKind.ORIENTATION, frame=f"{side}_foot") for side in SIDES
        ]
        self._waist = stack.declare("waist", TaskKind.ORIENTATION, frame="waist")
        self._chest = stack.declare("chest", TaskKind.ORIENTATION, frame="chest")
        self._positions = [
            (stack.declare(name, TaskKind.POSITION, frame=name), POINTS.index(name))
            for name in _POSITIONS
            if robot.has(name)
        ]
        self._com = stack.declare("com", TaskKind.COM)
        self._posture = stack.declare("posture", TaskKind.POSTURE)
        self._hips, self._torso, self._shoulders = index("hips"), index("torso"), index("shoulders")
        self._ankles = np.array([POINTS.index(f"{side}_ankle") for side in SIDES])
        shape = [task for task, _ in self._directions] + [self._waist, self._chest, *self._soles]
        self._human_joints = HumanJoints(robot, shape) if config.posture == "human" else None

    def scaled_body(self) -> ScaledBody:
        """Return the human in the robot's size."""
        from imitor.mapping.scaled_body import ScaledBody

        return ScaledBody(self.robot, self.skeleton, self.dt_s)

    def reset(self) -> None:
        """Forget directions, feet and CoM."""
        self._com_offset = np.zeros(3)
        self._hips_were_seen = True
        self._first = True
        self._body.reset()
        self._footing.reset()
        if self._human_joints is not None:
            self._human_joints.reset()

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        """Write the targets of this frame."""
        config, body, footing = self.config, self._body, self._footing
        body.take(frame)
        direction = body.direction
        for task, i in self._directions:
            task.target[:] = direction[i]
        self._write_frames(direction)
        support = frame.support
        if config.support == "robot":
            support = None if self._first else Support(bool(stack.contact[0]), bool(stack.contact[1]))
        if support is None or not body.legs_known:  # who was not seen yet stands
            support = Support(True, True)
        self._first = False
        if body.hips_seen and not self._hips_were_seen:
            footing.rebase(body.mid_hip)
        self._hips_were_seen = body.hips_seen
        forward = self._waist.target[:, 0]
        human = (body.mid_hip, body.mid_ankle)
        footing.step(frame, support, body.relative[self._ankles], human, body.leg_ratio, forward)
        mid_hip = footing.mid_hip
        for task, point in self._positions:
            np.add(mid_hip, body.relative[point], out=task.target)
        if frame.com is not None and body.hips_seen:
            self._com_offset = body.leg_ratio * (frame.com - body.mid_hip)
        self._com.target[:] = mid_hip + self._com_offset
        stack.contact[:] = footing.contact
        flight = footing.anchor < 0  # then the feet are all that places the robot
        for i, foot in enumerate(footing.feet):
            stands, task, free, sole = footing.contact[i], self._feet[i], self._free[i], self._soles[i]
            task.active[0], free.active[0], sole.active[0] = stands, not stands, not stands
            task.target[:] = foot.pose
            placed = footing.placed(i)
            task.mask[:2] = task.mask[5] = placed
            sole.target[:] = foot.pose[:3, :3]
            free.target[:] = foot.ankle
            free.mask[:2] = flight or placed or not self._ground_only
        stack.anchor = ""
        if config.anchor and footing.anchor >= 0:
            held = footing.feet[footing.anchor]
            stack.anchor = held.role
            stack.anchor_pose[:] = held.pose
            self._feet[footing.anchor].active[0] = False
        joints = self._human_joints
        self._posture.target[:] = self.robot.standing[7:] if joints is None else joints.step()

    def _write_frames(self, direction: np.ndarray) -> None:
        """Orientations of waist and chest: left from the hips and shoulders, up from the torso."""
        up = direction[self._torso].tolist()
        for task, line in ((self._waist, self._hips), (self._chest, self._shoulders)):
            y = direction[line].tolist()
            x = self._cross3(y, up)
            norm = hypot(*x)
            if norm < 1e-3:
                continue  # torso along the line of hips or shoulders: as in the last frame
            x = (x[0] / norm, x[1] / norm, x[2] / norm)
            z = self._cross3(x, y)
            task.target[:] = ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]))


__all__ = ["ScalingMapper", "SegmentScalingConfig"]
