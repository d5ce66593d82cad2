"""The layout of task rows: which scalar objectives a frame has, in level order, and the arrays they fill.

A layout belongs to one combination of active tasks, axis masks and anchor; solvers keep one a combination, so that
per frame only numbers are written.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from imitor.robot.model import BASE_NV, RobotModel
from imitor.tasks import Task, TaskKind, TaskStack
from imitor.types import Array, IntArray

WORLD = -1


@dataclass(frozen=True)
class Entry:
    """A task of a solver's order."""

    task: Task
    level: int
    weight: float
    frame: int = WORLD
    reference: int = WORLD


@dataclass
class Part:
    """Rows of one task that share an error vector: its translation, its rotation, or the CoM."""

    task: Task
    rows: IntArray
    axes: IntArray
    frame: int
    reference: int


@dataclass
class Layout:
    """Rows of the tasks active in a frame and the arrays they are assembled into.

    Attributes:
        n: Number of columns; ``first`` of them are those of a free base (6, or 0 with an anchor).
        J, e: Jacobian (m, n) and error (m,).
        starts: First row of each level.
        level: Level of each row in the solver's order (m,).
        first_level: Whether rows of the order's first level are among them.
        root_weight: Root of each row's weight (m,), or ``None`` when all are 1.
        W: Wrench of each row about the world's origin, (m, 6).
        mask: Columns that move the row's frame against its reference, (m, n).
    """

    n: int
    first: int
    J: Array
    e: Array
    starts: list[int]
    level: IntArray
    first_level: bool
    root_weight: Array | None
    W: Array
    mask: Array
    translations: list[Part] = field(default_factory=list)
    rotations: list[Part] = field(default_factory=list)
    vectors: list[Part] = field(default_factory=list)
    com: Part | None = None
    world_rows: IntArray = field(default_factory=lambda: np.zeros(0, dtype=int))
    world_frame: IntArray = field(default_factory=lambda: np.zeros(0, dtype=int))
    directions: Directions | None = None

    @property
    def m(self) -> int:
        """Number of rows."""
        return int(self.e.shape[0])


@dataclass
class Directions:
    """All direction tasks of a layout, two rows each in the tangent plane.

    Attributes:
        rows: Their rows, (2 S,), a slice when they are neighbours.
        target, gain: Where their targets and gains are in the stack's flat arrays, (S, 3) and (S,).
        distal, proximal: Frames at the ends, (S,).
        near, far: Wrenches at the distal and at the proximal point, (2 S, 6).
        far_mask: Columns that move the proximal point, (2 S, n).
    """

    rows: slice | IntArray
    target: IntArray
    gain: IntArray
    distal: IntArray
    proximal: IntArray
    near: Array
    far: Array
    far_mask: Array


def make_layout(robot: RobotModel, stack: TaskStack, entries: Sequence[Entry], masks: Array) -> Layout:
    """Lay out the rows of the tasks that are active now.

    Args:
        robot: The robot.
        stack: The compiled tasks; its switches and anchor count.
        entries: The solver's tasks in level order.
        masks: Velocity coordinates that move each frame, shape (frames, nv).
    """
    anchor = stack.anchor
    first = 0 if anchor else BASE_NV
    columns = slice(BASE_NV - first, None)
    masks = masks[:, columns]
    n = robot.nv - BASE_NV + first
    held = robot.ancestors(anchor)[columns] if anchor else np.zeros(n)

    mask: list[Array] = []
    level: list[int] = []
    weight: list[float] = []
    translations: list[Part] = []
    rotations: list[Part] = []
    vectors: list[Part] = []
    com: Part | None = None
    chosen: list[tuple[Entry, int]] = []  # directions and their first rows
    for entry in entries:
        task, at = entry.task, len(mask)
        if not task.active[0]:
            continue
        if task.kind is TaskKind.DIRECTION:
            if task.mask[0]:
                mask += [masks[entry.frame] - held] * 2
                chosen.append((entry, at))
        elif task.kind is TaskKind.VECTOR:
            if task.mask[0]:
                mask += [masks[entry.frame] - held] * 2
                vectors.append(Part(task, at + np.arange(2), np.arange(2), entry.frame, WORLD))
        elif task.kind is TaskKind.COM:
            axes = np.flatnonzero(task.mask)
            mask += [-held] * len(axes)
            com = Part(task, at + np.arange(len(axes)), axes, WORLD, WORLD)
        else:
            moved = masks[entry.frame] - (held if entry.reference == WORLD else masks[entry.reference])
            shift = task.mask[:3] if task.kind is not TaskKind.ORIENTATION else task.mask[:0]
            turn = task.mask[len(shift) :]
            for which, parts in ((shift, translations), (turn, rotations)):
                axes = np.flatnonzero(which)
                if axes.size:
                    parts.append(
                        Part(task, len(mask) + np.arange(axes.size), axes, entry.frame, entry.reference)
                    )
                    mask += [moved] * axes.size
        added = len(mask) - at
        level += [entry.level] * added
        weight += [entry.weight] * added

    m = len(mask)
    W = np.zeros((m, 6))
    world = [p for p in translations if p.reference == WORLD]
    for part in world:
        W[part.rows, part.axes] = 1.0
    for part in rotations:
        if part.reference == WORLD:
            W[part.rows, 3 + part.axes] = 1.0
    none = np.zeros(0, dtype=int)
    layout = Layout(
        n=n,
        first=first,
        J=np.zeros((m, n)),
        e=np.zeros(m),
        starts=[i for i in range(m) if i == 0 or level[i] != level[i - 1]],
        level=np.array(level, dtype=int),
        first_level=bool(level) and level[0] == 0,
        root_weight=None if all(w == 1.0 for w in weight) else np.sqrt(weight),
        W=W,
        mask=np.array(mask).reshape(m, n),
        translations=translations,
        rotations=rotations,
        vectors=vectors,
        com=com,
        world_rows=np.concatenate([none, *[p.rows for p in world]]),
        world_frame=np.concatenate([none, *[np.full(p.rows.size, p.frame) for p in world]]),
    )
    if chosen:
        layout.directions = _directions(stack, chosen, masks, held)
    return layout


def _directions(
    stack: TaskStack, chosen: Sequence[tuple[Entry, int]], masks: Array, held: Array
) -> Directions:
    rows = np.array([at + k for _, at in chosen for k in range(2)])
    together = bool((np.diff(rows) == 1).all())
    names = stack.names
    far_mask = np.array([masks[e.reference] - held for e, _ in chosen for _ in range(2)])
    return Directions(
        rows=slice(int(rows[0]), int(rows[-1]) + 1) if together else rows,
        target=np.array([np.arange(3) + stack.place_of(e.task.name).start for e, _ in chosen]),
        gain=np.array([names.index(e.task.name) for e, _ in chosen]),
        distal=np.array([e.frame for e, _ in chosen]),
        proximal=np.array([e.reference for e, _ in chosen]),
        near=np.zeros((rows.size, 6)),
        far=np.zeros((rows.size, 6)),
        far_mask=far_mask,
    )
