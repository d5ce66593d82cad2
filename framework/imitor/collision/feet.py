"""What a correction keeps: standing feet and the CoM.

Where the joints between the base and a standing foot do not move, feet and base stay exactly. Where they do, the base
is placed anew so that the anchor :math:`a` stays; a point :math:`x` of a frame :math:`f` then moves with the joints by
the columns :math:`(v_j + \\omega_j \\times x)(m_f - m_a)` of Pinocchio's world-frame Jacobian, :math:`m` being 1 for
the joints that carry a frame, and the CoM by its own Jacobian less the columns of :math:`m_a`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imitor.tasks import TaskKind, TaskStack
from imitor.types import SIDES, Array, BoolArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

_FEET = [f"{side}_foot" for side in SIDES]


class Feet:
    """Which joints standing feet leave free.

    Args:
        robot: The robot.
        release: Whether standing feet may move at all: a later stage sets them on the ground.
        slide: Whether a standing foot that is not the anchor may slide.
    """

    def __init__(self, robot: RobotModel, *, release: bool, slide: bool) -> None:
        self._robot, self._release, self._slide = robot, release, slide
        self._carried = [robot.ancestors(foot) for foot in _FEET]

    def sliding(self, stack: TaskStack) -> int | None:
        """Return which foot slides: 0 is the left one; ``None`` when none does."""
        if not self._slide or not stack.contact.all() or stack.anchor not in _FEET:
            return None
        return 1 - _FEET.index(stack.anchor)

    def free(self, stack: TaskStack) -> BoolArray:
        """Return the joints whose motion moves neither the anchor nor a foot that stands or is being placed, (n,)."""
        robot, slides = self._robot, self.sliding(stack)
        held = np.zeros(robot.nv)
        for i, stands in enumerate(stack.contact.tolist()):
            if (stands or _is_placed(stack, i)) and not self._release and i != slides:
                held += self._carried[i]
        if stack.anchor:
            held += robot.ancestors(stack.anchor)
        return np.asarray(held[6:] == 0.0)

    def can_bend(self, stack: TaskStack) -> bool:
        """Tell whether the standing legs may be moved, too: the anchor is a standing foot."""
        if self._release or stack.anchor not in _FEET:
            return False
        return bool(stack.contact[_FEET.index(stack.anchor)])

    def kept(self, stack: TaskStack, *, bent: bool) -> Kept:
        """Return what is to be kept of the pose of the robot's last update; ``bent`` frees the standing legs."""
        return Kept(self._robot, stack, self.sliding(stack), bent)


def _is_placed(stack: TaskStack, i: int) -> bool:
    """Tell whether a foot is on a way that its task gives in full, place and tilt: it is about to land."""
    if _FEET[i] not in stack:
        return False
    task = stack[_FEET[i]]
    return task.kind is TaskKind.POSE and bool(task.active[0] and task.mask[:5].all())


class Kept:
    """CoM and feet of a pose as rows of the joints' motion.

    Args:
        robot: The robot, updated at the pose.
        stack: The tasks: CoM task, anchor, contact.
        slides: Which foot may slide on the ground, if any.
        bent: Whether the standing legs move, and with them the base.

    Attributes:
        anchor: Role that the base is placed by, or empty.
    """

    def __init__(self, robot: RobotModel, stack: TaskStack, slides: int | None, bent: bool) -> None:
        self._robot, self._slides = robot, slides
        task = next((t for t in stack if t.kind is TaskKind.COM and t.active[0]), None)
        self._axes = np.flatnonzero(task.mask) if task is not None else np.zeros(0, dtype=int)
        self._com: Array = robot.com.copy()
        self.anchor = stack.anchor if bent else ""
        self._base = robot.ancestors(self.anchor)[6:] if bent else np.zeros(robot.n)
        self._pose = robot.pose(self.anchor) if bent else np.eye(4)
        feet = [i for i, on in enumerate(stack.contact.tolist()) if on and _FEET[i] != stack.anchor]
        self._feet = [(i, robot.pose(_FEET[i])) for i in (feet if bent else [slides]) if i is not None]

    def __bool__(self) -> bool:
        return bool(self._axes.size or self._feet)

    def place(self, q: Array) -> None:
        """Place the base of the last update's configuration so that the anchor is where it was."""
        if self.anchor:
            self._robot.place(q, self.anchor, self._pose)

    @property
    def base(self) -> Array:
        """1 for each joint that moves the base, (n,)."""
        return self._base

    def rows(self) -> tuple[Array, Array]:
        """Return C and c of C dq = c at the robot's last update, (k, n) and (k,)."""
        robot = self._robot
        linear, angular = robot.jacobian[:3, 6:], robot.jacobian[3:, 6:]

        def at(point: Array) -> Array:
            return np.asarray(linear + np.cross(angular.T, point).T)

        C = [(robot.com_jacobian[:, 6:] - at(robot.com) * self._base)[self._axes]]
        c = [(self._com - robot.com)[self._axes]]
        for i, pose in self._feet:
            moves = robot.ancestors(_FEET[i])[6:] - self._base
            place, R = robot.position(_FEET[i]), robot.rotation(_FEET[i])
            twist = pose[:3, :3] @ R.T
            turn = 0.5 * np.array(
                [twist[2, 1] - twist[1, 2], twist[0, 2] - twist[2, 0], twist[1, 0] - twist[0, 1]]
            )
            rows = np.vstack([at(place), angular]) * moves
            left = np.append(pose[:3, 3] - place, turn)
            which = (
                [2, 3, 4] if i == self._slides else list(range(6))
            )  # sliding: height, and tilt of the sole
            C.append(rows[which])
            c.append(left[which])
        return np.vstack(C), np.concatenate(c)
