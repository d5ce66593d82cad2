r"""The smallest motion of the legs after which the robot stands: feet flat on the floor, CoM inside their polygon.

With the anchor foot :math:`a` held, a point :math:`p` of a frame :math:`f` moves along :math:`n` as
:math:`\dot d = (w^T\,{}^0J) \odot (m_f - m_a)\,\dot q`, :math:`w = (n, p \times n)`; the CoM as its own Jacobian with
the base's part replaced. Each iteration is the damped minimum-norm step of the rows that are wanted; a joint that
would leave its bounds stays at them, and its column is taken out.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from imitor.balance.stance import floor_point, footprint, heights, moved_inside
from imitor.ik.vectors import cross3
from imitor.metrics.polygon import Point, margin
from imitor.types import SIDES, Array, BoolArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

ITERATIONS: Final = 12
_DAMPING2: Final = 1e-8
_MOST_RAD: Final = 0.2
"""Largest change of a joint in one iteration [rad]."""
_FLAT_M: Final = 5e-4
"""A standing sole's corners are this near to the floor [m]."""
_PLACE_M: Final = 5e-4
"""A standing foot is this near to its place [m]."""
_ABOVE_M: Final = 1e-3
"""A free sole is lifted to this height where it would be in the floor [m]."""
_EXTRA_M: Final = 5e-4
"""How much further inside than the margin the CoM is brought, so that it ends inside it [m]."""
_AXES: Final = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Legs:
    """Puts a robot that is held by one standing foot on its feet.

    Args:
        robot: The robot; left updated at what was found.
        margin_m: How far inside the polygon of the standing soles the CoM shall be [m].
        tolerance_m: How near to its target the CoM shall be, where it has one [m].
    """

    def __init__(self, robot: RobotModel, margin_m: float, tolerance_m: float) -> None:
        self._robot, self._margin, self._tolerance = robot, margin_m, tolerance_m
        self._carried = [robot.ancestors(f"{side}_foot")[6:] for side in SIDES]
        S = robot.coupling if robot.coupling is not None else np.eye(robot.n)
        moves = sum(self._carried) > 0
        self._S = S[:, (np.abs(S[moves]) > 0).any(axis=0)]
        self._views = [(robot.position(f"{side}_foot"), robot.rotation(f"{side}_foot")) for side in SIDES]

    def stands(self, contact: BoolArray, places: list[Array]) -> bool:
        """Tell whether the robot, where it was last updated, stands on the feet in contact as it shall.

        Args:
            contact: The feet that stand, shape (2,).
            places: Where on the floor each foot shall stand, shape (2,) each [m].
        """
        soles = self._robot.sole_corners()
        standing = []
        for i, (stands, (low, high)) in enumerate(zip(contact.tolist(), heights(soles), strict=True)):
            if not stands:
                if low < -_FLAT_M:
                    return False
                continue
            (x, y, _), (to_x, to_y) = self._views[i][0].tolist(), places[i].tolist()
            if max(high, -low) > 2.0 * _FLAT_M or max(abs(x - to_x), abs(y - to_y)) > 2.0 * _PLACE_M:
                return False
            standing.append(soles[i])
        return margin(floor_point(self._robot.com), footprint(standing)) >= self._margin

    def near(self, target: Array | None) -> bool:
        """Tell whether the CoM is as near to its target on the floor, shape (2,) [m], as it shall."""
        return target is None or math.dist(self._robot.com[:2], target) <= self._tolerance

    def _goal(self, soles: Array, contact: BoolArray, target: Array | None) -> Point | None:
        """Return the nearest point on the floor where the CoM may be [m]; ``None`` where it is."""
        here = floor_point(self._robot.com)
        goal = here
        if target is not None and not self.near(target):
            way = self._robot.com[:2] - target
            goal = floor_point(target + (self._tolerance - _EXTRA_M) / float(np.hypot(*way)) * way)
        goal = moved_inside(goal, footprint(list(soles[contact])), self._margin + _EXTRA_M)
        return None if math.dist(goal, here) < _EXTRA_M else goal

    def solve(
        self, q: Array, anchor: int, pose: Array, contact: BoolArray, places: list[Array],
        com: Array | None, bounds: tuple[Array, Array],
    ) -> None:  # fmt: skip
        """Move the legs of ``q`` in place towards a pose in which the robot stands.

        Args:
            q: Where to start, shape (nq,), the robot updated at it with the anchor in place.
            anchor: Index of the foot that is held, one of those in contact.
            pose: Its pose, world from foot, shape (4, 4).
            contact: The feet that stand, shape (2,).
            places: Where on the floor each foot shall stand, shape (2,) each [m].
            com: Target of the CoM on the floor, shape (2,) [m], or ``None``.
            bounds: Lowest and highest joint positions, shape (n,) each [rad].
        """
        robot, joints, S = self._robot, q[7:], self._S
        for _ in range(ITERATIONS):
            J, e = self._rows(anchor, contact, places, com)
            if not len(e) or float(np.abs(e).max()) < 0.2 * _FLAT_M:
                break
            J = J @ S
            free = np.ones(S.shape[1])
            step = np.zeros(S.shape[0])
            for _ in range(S.shape[1]):
                Jf = J * free
                A = Jf @ Jf.T
                A.flat[:: len(e) + 1] += _DAMPING2
                u = Jf.T @ np.linalg.solve(A, e)
                step = S @ u
                largest = float(np.abs(step).max())
                if largest > _MOST_RAD:
                    step *= _MOST_RAD / largest
                to = joints + step
                out = np.maximum(to - bounds[1], bounds[0] - to)
                out[step == 0.0] = 0.0
                worst = int(out.argmax())
                if out[worst] <= 1e-9:
                    break
                blocked = np.abs(S[worst]) > 0
                if not free[blocked].any():
                    break
                free[blocked] = 0.0
            np.minimum(np.maximum(joints + step, bounds[0]), bounds[1], out=joints)
            robot.update(q)
            robot.place(q, f"{SIDES[anchor]}_foot", pose)

    def _rows(
        self, anchor: int, contact: BoolArray, places: list[Array], target: Array | None
    ) -> tuple[Array, Array]:
        """Return Jacobian (m, n) and error (m,) of what is wanted."""
        robot = self._robot
        soles = robot.sole_corners()
        wrenches, masks, errors = [], [], []
        other = 1 - anchor
        difference = self._carried[other] - self._carried[anchor]
        at, R = self._views[other][0].tolist(), self._views[other][1]
        if contact[other]:
            place = (*places[other], 0.0)
            for k in range(3):
                wrenches.append((*_AXES[k], *cross3(at, _AXES[k])))
                errors.append(place[k] - at[k])
            tilt = cross3(R[:, 2].tolist(), _AXES[2])
            for k in range(2):
                wrenches.append((0.0, 0.0, 0.0, *_AXES[k]))
                errors.append(tilt[k])
            masks += [difference] * 5
        else:
            corner = soles[other][int(soles[other][:, 2].argmin())].tolist()
            if corner[2] < 0.0:
                wrenches.append((*_AXES[2], *cross3(corner, _AXES[2])))
                errors.append(_ABOVE_M - corner[2])
                masks.append(difference)
        W = np.array(wrenches).reshape(-1, 6)
        spatial = robot.jacobian[:, 6:]
        J = (W @ spatial) * np.array(masks).reshape(-1, robot.n)
        e = np.array(errors)
        goal = self._goal(soles, contact, target)
        if goal is not None:
            com = robot.com.tolist()
            W = np.array([(*axis, *cross3(com, axis)) for axis in _AXES[:2]])
            rows = robot.com_jacobian[:2, 6:] - (W @ spatial) * self._carried[anchor]
            J = np.vstack([J, rows])
            e = np.concatenate([e, np.array(goal) - robot.com[:2]])
        return J, e
