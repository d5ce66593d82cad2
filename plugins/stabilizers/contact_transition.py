"""From a robot's own hand paths to a person's where the hands take hold of something, and back."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import Field, model_validator

from imitor import Component, Config, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.tasks import Task
from imitor.types import SIDES, Array

if TYPE_CHECKING:
    from imitor.contact.grips import Grips

Vector = tuple[float, float, float]
_LOG: Final = logging.getLogger("imitor")


class ContactTransitionConfig(Config):
    """Options of the transition to contact."""

    object: str | None = Field(
        None,
        description="Name of the object of the environment that is held; none, or an empty environment: no contact "
        "ever [-].",
    )
    grip_offset_m: Vector = Field(
        (0.0, 0.0, 0.0),
        description="The left hand's grip from the object's position, in world; mirrored for the right hand [m].",
    )
    travel_m: Vector | None = Field(
        None,
        description="How far and where to the object is moved when it is pulled or pushed, in world; none: as far as "
        "it slides, and not at all if it has no `slide` [m].",
    )
    grasp_m: float = Field(
        0.01,
        gt=0,
        description="A hand of the person this near its grip, wherever the object is, takes hold of it, and lets go "
        "this far from its travel [m].",
    )
    radius_m: float = Field(
        0.1, gt=0, description="Sphere around the grip within which the robot grows to the person's size [m]."
    )
    held_m: float = Field(
        0.02,
        ge=0,
        description="A hand of the person this near its grip holds it: the robot has the full size [m].",
    )
    limit_margin: float = Field(
        0.08, gt=0, lt=0.5, description="Share of a joint's range at its ends in which motion is scaled [-]."
    )
    calibration_s: float = Field(
        1.0,
        gt=0,
        le=60,
        description="Beginning of the recording that tells the person's segment lengths [s].",
    )
    placement_m: Vector | None = Field(
        None,
        description="Shift of the robot from the person's place to reach the object: forward, left, up; none: the "
        "smallest from which the hands reach their grips. Without an object the robot stands on the floor [m].",
    )
    grip_rpy_rad: Vector = Field(
        (0.0, 0.0, 0.0),
        description="How the left hand is turned at its grip when a placement is looked for, about world's x, y and z; "
        "mirrored for the right hand [rad].",
    )
    room_m: float = Field(
        0.015,
        ge=0,
        le=0.5,
        description="How far to each side of the grips hands must reach from a placement: they come and leave [m].",
    )
    search_m: float = Field(
        0.6, ge=0, le=3, description="How far a placement is looked for, fore and aft [m]."
    )
    rise_m: float = Field(0.0, ge=0, le=2, description="How far a placement may raise the robot [m].")

    @model_validator(mode="after")
    def _holds_in_full_size(self) -> ContactTransitionConfig:
        if self.held_m < self.grasp_m:
            raise ValueError("a hand that holds has the person's path: grasp_m should be at most held_m")
        return self


class ContactTransition(Stabilizer[ContactTransitionConfig]):
    """Own hand paths in the free, the person's at an object, the robot growing between [tomic2018] T7, T8, T11.

    Without contact the hands go where the imitated joints, scaled locally into the limits, put them on the robot in its
    own size (eq. 14); an arm far beyond its limits points as nearly as it can where the person's does. Within
    `radius_m` of a grip the model that gives the hands' targets grows to the person's size, its pelvis goes to the
    person's: at the grip a hand's target is the person's hand. The share of growth depends on the distance of the
    person's hand alone, with no step in velocity; leaving is the same way back.

    It also tells which hands hold the object and how far they moved it: from when the person's hand reaches the grip
    until it leaves the object's travel. An object that slides, and what is part of it, moves along.

    It belongs after a mapper that gives the person's hands and joints, `virtual_marker_fit` or `marker_fit`. The pelvis
    is anchored where the mapper has it, shifted by `placement_m`; without an object it is not shifted, and the robot
    stands on its legs.
    """

    name = "contact_transition"
    needs_tasks = frozenset({"posture"})

    @property
    def calibration_s(self) -> float:
        """How much of the recording tells the segment lengths [s]."""
        return self.config.calibration_s

    def declare(self, stack: TaskStack) -> None:
        """Look up hands, posture and pelvis; find the object.

        Raises:
            ImitorError: The environment has objects, but none of this name.
        """
        from imitor.contact.grasp import Grasp
        from imitor.contact.grips import Grips

        c = self.config
        names = [f"{side}_hand" for side in SIDES]
        hands = [stack[name] if name in stack and not stack[name].relative_to else None for name in names]
        placed = (TaskKind.POSE, TaskKind.POSITION)
        self._hands = [(i, task) for i, task in enumerate(hands) if task is not None and task.kind in placed]
        self._posture = stack["posture"]
        self._pelvis = None
        if "pelvis" in stack:
            self._pelvis = stack["pelvis"]
        self.grips = self._grasp = None
        if c.object is not None and self.environment:
            self.grips = Grips(self.environment, c.object, c.grip_offset_m, c.travel_m)
            self._grasp = Grasp(self.grips, c.grasp_m)

    def start(self) -> None:
        """Prepare the limits and a robot in its own size."""
        from imitor.contact.arm_within_limits import ArmWithinLimits
        from imitor.contact.local_limits import LocalLimits

        robot = self.robot
        self._limits = LocalLimits(robot.lower, robot.upper, self.config.limit_margin)
        carry = [robot.ancestors(task.frame)[6:] > 0.0 for _, task in self._hands]
        self._arms = np.any(carry, axis=0) if carry else np.zeros(robot.n, dtype=bool)
        both = np.all(carry, axis=0) if len(carry) > 1 else np.zeros(robot.n, dtype=bool)
        self._each_arm = [
            (joints & ~both, ArmWithinLimits(robot, SIDES[i], joints & ~both))
            for (i, _), joints in zip(self._hands, carry, strict=True)
        ]
        self._grown = robot.scaled({})
        self._size = 1.0

    def calibrate(self, frames: Sequence[HumanFrame]) -> None:
        """Take the person's size."""
        from imitor.mapping.segment_factors import segment_factors

        self._grown = self.robot.scaled(segment_factors(self.robot, frames))

    def reset(self) -> None:
        """Forget where the robot was placed."""
        self.placement: Array | None = None
        self.share: Array = np.zeros(2)
        for _, arm in self._each_arm:
            arm.reset()
        if self._grasp is not None:
            self._grasp.reset()

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Write the targets of the hands and the state of the object, and place the pelvis."""
        self._move_object(stack)
        own = self._place(stack)
        q = self._posture.target.copy()
        rest = q if self.grips is not None else self.robot.standing[7:]
        scaled = np.where(self._arms, self._limits(q), rest)
        modified = scaled.copy()
        for joints, arm in self._each_arm:
            modified[joints] = arm(q, scaled)
        pelvis = own if self._pelvis is None else self._pelvis.target
        for i, task in self._hands:
            self.share[i] = self._share(_position(task), i)
            if self.share[i] >= 1.0:
                continue  # the person's hand itself
            pose = self._grown_hand(float(self.share[i]), task.frame, (own, pelvis), (modified, q))
            if task.kind is TaskKind.POSITION:
                task.target[:] = pose[:3, 3]
            else:
                task.target[:] = pose
        self._posture.target[:] = modified  # beyond a limit it would hold a joint there that the hands need

    def _move_object(self, stack: TaskStack) -> None:
        """Write which hands hold the object, and where it is."""
        stack.held[:] = -1
        if self._grasp is None or self.grips is None:
            return
        self._grasp.step([(i, _position(task)) for i, task in self._hands])
        stack.held[self._grasp.holds] = self.grips.number
        stack.object_shift[self.grips.moving] = self._grasp.shift

    def _share(self, hand: Array, side: int) -> float:
        """Return the share of growth for a hand of the person: 0 outside the sphere, 1 at the grip."""
        if self.grips is None:
            return 0.0
        c = self.config
        s = (c.radius_m - self.grips.distance(hand, side)) / max(c.radius_m - c.held_m, 1e-6)
        s = min(max(s, 0.0), 1.0)
        return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)  # no step in velocity at either end

    def _grown_hand(
        self, share: float, role: str, pelvis: tuple[Array, Array], joints: tuple[Array, Array]
    ) -> Array:
        """Return the pose of a hand of the robot grown by a share, from its own pelvis and joints to the person's."""
        from imitor.contact.blend import blend

        if share != self._size:
            self._grown.set_scale(share)
            self._size = share
        q = self._grown.standing.copy()
        q[7:] = joints[0] + share * (joints[1] - joints[0])
        self._grown.update(q)
        self._grown.place(q, "waist", blend(pelvis[0], pelvis[1], share))
        return self._grown.pose(role)

    def _place(self, stack: TaskStack) -> Array:
        """Anchor the robot's pelvis at its placement; return it, world from waist, shape (4, 4)."""
        pose = stack.anchor_pose if stack.anchor == "waist" else self._standing_pelvis()
        if self.placement is None:
            self.placement = self._shift(pose)
        own = pose.copy()
        own[:3, 3] += pose[:3, :3] @ self.placement
        if self._pelvis is not None:
            stack.anchor = "waist"
            stack.anchor_pose[:] = own
        return own

    def _standing_pelvis(self) -> Array:
        self._grown.set_scale(0.0)
        self._size = 0.0
        self._grown.update(self.robot.standing)
        return self._grown.pose("waist")

    def _shift(self, pelvis: Array) -> Array:
        """Return the placement, shape (3,) [m]: none without an object, that of the options, or the one found."""
        if self.grips is None or not self._hands:
            return np.zeros(3)
        given = self.config.placement_m
        return self._found(pelvis, self.grips) if given is None else np.asarray(given)

    def _found(self, pelvis: Array, grips: Grips) -> Array:
        """Return the nearest placement from which the grips are in the workspace, all along the travel.

        Raises:
            ImitorError: There is none within reach.
        """
        from imitor.contact.placement import REACHED, Workspace
        from imitor.errors import ImitorError

        c = self.config
        poses = grips.poses(c.grip_rpy_rad, c.room_m)
        shift, miss = Workspace(self.robot).nearest_placement(pelvis, poses, c.search_m, c.rise_m)
        told = [round(float(x), 3) for x in shift]
        if miss > REACHED:
            raise ImitorError(
                f"'{c.object}' is out of the robot's workspace from every placement up to {c.search_m} m fore and aft "
                f"and {c.rise_m} m up: at best, {told}, a hand misses by {miss:.3f} m or rad; raise search_m or "
                "rise_m, lower room_m, move the object, or give placement_m"
            )
        _LOG.info("contact_transition: '%s' is in the workspace from placement_m: %s", c.object, told)
        return shift


def _position(task: Task) -> Array:
    """Return where a hand's target is, shape (3,) [m]."""
    return task.target if task.kind is TaskKind.POSITION else task.target[:3, 3]


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [ContactTransition]
