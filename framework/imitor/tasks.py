"""Tasks: the common tongue between mappers, stabilizers and solvers.

A mapper declares tasks when the pipeline is built; `TaskStack.compile` lays their arrays out in flat memory; per
frame, stages write into views. The order and the weights of tasks belong to the solver stage (its YAML), not here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import numpy as np

from imitor.errors import ImitorError, did_you_mean
from imitor.types import Array, BoolArray, IntArray


class TaskKind(StrEnum):
    """What a task is about, and so the meaning of its target."""

    POSITION = "position"  # target (3,) [m]
    ORIENTATION = "orientation"  # target (3, 3), reference from frame
    DIRECTION = "direction"  # target (3,), unit vector in world
    VECTOR = "vector"  # target (3,), unit vector in world that the frame's forward axis (its x) is to have
    POSE = "pose"  # target (4, 4), reference from frame
    COM = "com"  # target (3,) [m]
    POSTURE = "posture"  # target (n,), joint positions [rad]
    LIMITS = "limits"  # no target: joint-limit centring


_TARGET_SHAPE: Final[dict[TaskKind, tuple[int, ...]]] = {
    TaskKind.POSITION: (3,),
    TaskKind.ORIENTATION: (3, 3),
    TaskKind.DIRECTION: (3,),
    TaskKind.VECTOR: (3,),
    TaskKind.POSE: (4, 4),
    TaskKind.COM: (3,),
    TaskKind.LIMITS: (0,),
}

MASK_SIZE: Final[dict[TaskKind, int]] = {
    TaskKind.POSITION: 3,  # x y z
    TaskKind.ORIENTATION: 3,  # rotation about x y z
    TaskKind.DIRECTION: 1,  # on or off
    TaskKind.VECTOR: 1,  # on or off
    TaskKind.POSE: 6,  # x y z, rotation about x y z
    TaskKind.COM: 3,  # x y z
    TaskKind.POSTURE: 1,
    TaskKind.LIMITS: 1,
}
"""Length of a task's axis mask; axes are those of the reference frame (world, or ``relative_to``)."""


@dataclass(slots=True)
class Task:
    """One IK objective.

    Attributes:
        name: Canonical where there is one (``left_foot``, ``com``, ``left_forearm``).
        kind: What the target means.
        frame: Role of the robot frame that the task moves (empty for com, posture, limits).
        relative_to: Role of the reference frame; empty for world. A direction points from ``relative_to`` to
            ``frame`` and is always expressed in world.
        target: View into the stack's flat targets; its shape follows the kind.
        mask: View into the stack's flat masks; see `MASK_SIZE`.
        gain: Share of the error to remove in one solver iteration [-], a view of one value.
        active: Whether solvers see the task in this frame, a view of one value.
    """

    name: str
    kind: TaskKind
    frame: str = ""
    relative_to: str = ""
    target: Array = field(default_factory=lambda: np.zeros(0))
    mask: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    gain: Array = field(default_factory=lambda: np.ones(1))
    active: BoolArray = field(default_factory=lambda: np.ones(1, dtype=bool))


class TaskStack:
    """The tasks of a pipeline, its anchor, the feet the robot stands on, and the objects in its hands.

    Attributes:
        anchor: Role of the frame that solvers and post-processors hold exactly; empty for a free base.
        anchor_pose: Pose of the anchor frame, world from anchor, shape (4, 4).
        contact: The feet the robot is to stand on (left, right), shape (2,); mappers and stabilizers write it.
        held: Number of the object of the environment that each hand (left, right) holds, -1 for none, shape (2,).
        object_shift: How far each object of the environment was moved from where it is written, in world, shape
            (K, 3) [m]; a stabilizer for contact writes both.
        flat_target: All targets one after the other, shape (N,).
        flat_switch: All masks and then all active flags, shape (S,); a change asks solvers for a new row layout.
    """

    def __init__(self, n_joints: int, n_objects: int = 0) -> None:
        self._n_joints = n_joints
        self._tasks: dict[str, Task] = {}
        self._places: dict[str, slice] = {}
        self._compiled = False
        self.anchor = ""
        self.anchor_pose: Array = np.eye(4)
        self.contact: BoolArray = np.ones(2, dtype=bool)
        self.held: IntArray = np.full(2, -1)
        self.object_shift: Array = np.zeros((n_objects, 3))
        self.flat_target: Array = np.zeros(0)
        self.flat_switch: BoolArray = np.zeros(0, dtype=bool)
        self.flat_gain: Array = np.zeros(0)

    def declare(self, name: str, kind: TaskKind, *, frame: str = "", relative_to: str = "") -> Task:
        """Add a task while the pipeline is being built.

        Raises:
            ImitorError: The name is taken, or the stack was compiled already.
        """
        if self._compiled:
            raise ImitorError(f"task '{name}': tasks are declared before the first frame, not while running")
        if name in self._tasks:
            raise ImitorError(
                f"task '{name}' is declared twice; a second mapper or stabilizer needs another name"
            )
        task = Task(name, kind, frame, relative_to)
        self._tasks[name] = task
        return task

    def target_shape(self, kind: TaskKind) -> tuple[int, ...]:
        """Return the shape of a target of this kind."""
        return (self._n_joints,) if kind is TaskKind.POSTURE else _TARGET_SHAPE[kind]

    def compile(self) -> None:
        """Give every task its views into flat memory; identity targets, all axes on, gain 1, active."""
        sizes = [int(np.prod(self.target_shape(t.kind))) for t in self]
        masks = [MASK_SIZE[t.kind] for t in self]
        n_mask = sum(masks)
        self.flat_target = np.zeros(sum(sizes))
        self.flat_switch = np.ones(n_mask + len(sizes), dtype=bool)
        self.flat_gain = np.ones(len(sizes))
        at = m = 0
        self._places = {}
        for i, (task, size, mask) in enumerate(zip(self, sizes, masks, strict=True)):
            task.target = self.flat_target[at : at + size].reshape(self.target_shape(task.kind))
            task.mask = self.flat_switch[m : m + mask]
            task.active = self.flat_switch[n_mask + i : n_mask + i + 1]
            task.gain = self.flat_gain[i : i + 1]
            if task.target.ndim == 2:
                task.target[:] = np.eye(task.target.shape[0])
            self._places[task.name] = slice(at, at + size)
            at, m = at + size, m + mask
        self._compiled = True

    def twin(self) -> TaskStack:
        """Return a compiled stack with the same tasks and memory of its own, for another thread."""
        other = TaskStack(self._n_joints, len(self.object_shift))
        for task in self:
            other.declare(task.name, task.kind, frame=task.frame, relative_to=task.relative_to)
        other.compile()
        return other

    def place_of(self, name: str) -> slice:
        """Return where a task's target lies in ``flat_target``; its gain lies at the task's place in ``names``."""
        return self._places[name]

    @property
    def compiled(self) -> bool:
        """Whether the stack is laid out and ready for frames."""
        return self._compiled

    @property
    def names(self) -> Sequence[str]:
        """Task names in order of declaration."""
        return list(self._tasks)

    def __contains__(self, name: object) -> bool:
        return name in self._tasks

    def __iter__(self) -> Iterator[Task]:
        return iter(self._tasks.values())

    def __getitem__(self, name: str) -> Task:
        try:
            return self._tasks[name]
        except KeyError:
            hint = did_you_mean(name, self._tasks)
            raise ImitorError(
                f"no task is called '{name}'"
                + (f"; {hint}" if hint else "")
                + f"; declared: {', '.join(self._tasks)}"
            ) from None
