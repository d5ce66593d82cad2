"""Feet on the floor: where the robot's feet stand, which one anchors it, how a free foot moves over the ground.

[pennapoubel2014] P4 to P6 and P10: the support foot is fixed to the world; in double support both feet keep the place
of the step before; a landing foot is first set to the ground. A free foot follows the scaled body horizontally; near
the ground its height is the human's clearance in the robot's size, so that it neither sinks in nor hovers, and it turns
flat before it lands, about whatever heading the leg gives it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan2, cos, exp, hypot, inf, pi, sin, sqrt
from typing import Final

import numpy as np

from imitor.ik.vectors import cross3
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SIDES, Array, HumanFrame, Skeleton, Support

_FLIGHT: Final = -1
_NONE: Final = -1
_STEP_M: Final = 0.02
_STEP_S: Final = 0.5
_ARRIVED_M: Final = 0.02
_LAND_S: Final = 0.15
_FADED_M: Final = 0.01
"""A foot that is re-placed: how high it is lifted (in the human's size), for how long at most, how near is there;
how long a landing foot may still shift on the floor until it lies flat; and how near the scaled body a foot that
lifted off is let go."""
FLATTEN_S: Final = 0.04
"""Time constant with which a landed sole comes to lie flat [s]."""
LEVEL_RAD: Final = 0.06
"""A rolling foot tilted less than this is flat [rad]: noise must not rock the robot."""
ROLL_RAD: Final = 0.9
"""Most that a standing foot rolls [rad]."""
Vector = tuple[float, float, float]


def smoothstep(x: float) -> float:
    """Return 3x^2 - 2x^3 between 0 and 1, clipped outside."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@dataclass
class FootSettings:
    """How feet move near the ground.

    Attributes:
        flat_below_m: A free foot whose heel and toes are lower than this is flat; at twice this it follows the human.
        free_above_m: Above this clearance the foot's height is the scaled body's, below it the clearance's.
        blend_s: Time constant with which a foot's offset at lift-off from the scaled body fades [s].
        replace_m, replace_rad: How far the human's foot may creep and turn in contact, in double support, before the
            robot steps its foot after it; ``inf`` for never.
        roll: Whether a standing foot rolls over the front or rear edge of its sole with the human's, or stays flat.
    """

    flat_below_m: float
    free_above_m: float
    blend_s: float
    replace_m: float = inf
    replace_rad: float = inf
    roll: bool = False


class Foot:
    """One foot of the human and the target of the robot's sole.

    Attributes:
        pose: Target of the sole, world from sole, shape (4, 4).
        ankle: Target of the ankle of a free foot, shape (3,) [m].
        turn: The human's foot, world from sole, shape (3, 3): where a free foot would like to point.
        offset: What the foot is off the scaled body, shape (3,) [m]; fades after lift-off.
        clearance: Lowest point of the human's foot over the floor [m].
        highest: Higher one of heel and toes [m].
    """

    def __init__(self, side: str, robot: RobotModel, skeleton: Skeleton) -> None:
        self.role = f"{side}_foot"
        self._ankle, self._toe, self._knee = (ROLE_INDEX[f"{side}_{r}"] for r in ("ankle", "toe", "knee"))
        self._has_toe = skeleton.has(f"{side}_toe")
        self._ankle_height, self._toe_height = skeleton.ankle_height_m, skeleton.toe_height_m
        robot.update(robot.standing)
        self._sole_to_ankle = robot.rotation(self.role).T @ (
            robot.position(f"{side}_ankle") - robot.position(self.role)
        )
        self._corners = robot.sole[SIDES.index(side)]
        x = self._corners[:, 0]
        self._edges = (np.array([x.min(), 0.0, 0.0]), np.array([x.max(), 0.0, 0.0]))  # heel, front
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self.pose: Array = np.eye(4)
        self._flat: Array = np.eye(4)
        self._start: Array = np.eye(4)
        self._rest = 0.0
        self.ankle: Array = np.zeros(3)
        self.turn: Array = np.eye(3)
        self.offset: Array = np.zeros(3)
        self._landed_at = (0.0, 0.0, 0.0)
        self._at = (0.0, 0.0)
        self.clearance = 0.0
        self.highest = 0.0

    def read(self, frame: HumanFrame, forward: Array) -> None:
        """Read the human's foot; without toes it points where the pelvis faces."""
        valid = frame.valid
        if not valid[self._ankle]:
            return
        ax, ay, az = frame.position[self._ankle].tolist()
        self._at = (ax, ay)
        heel = toe = az - self._ankle_height
        if self._has_toe and valid[self._toe]:
            tx, ty, tz = frame.position[self._toe].tolist()
            toe = tz - self._toe_height
            if valid[self._knee]:
                kx, ky, kz = frame.position[self._knee].tolist()
                self._read_turn((tx - ax, ty - ay, tz - az), (kx - ax, ky - ay, kz - az))
        else:
            self.turn[:] = _yaw(atan2(float(forward[1]), float(forward[0])))
        self.clearance, self.highest = max(min(heel, toe), 0.0), max(heel, toe, 0.0)

    def _read_turn(self, d: Vector, shank: Vector) -> None:
        """Turn of the sole from ankle to toe and ankle to knee: left is up x forward; flat when standing flat."""
        length, left = hypot(*d), cross3(shank, d)
        norm = hypot(*left)
        if length < 1e-3 or norm < 1e-2 * length * hypot(*shank):
            return  # foot in line with the shank: as in the last frame
        x = (d[0] / length, d[1] / length, d[2] / length)
        y = (left[0] / norm, left[1] / norm, left[2] / norm)
        z = cross3(x, y)
        s = min(max((self._ankle_height - self._toe_height) / length, -0.9), 0.9)  # drop from ankle to toe
        c = sqrt(1.0 - s * s)
        self.turn[:] = (
            (c * x[0] + s * z[0], y[0], c * z[0] - s * x[0]),
            (c * x[1] + s * z[1], y[1], c * z[1] - s * x[1]),
            (c * x[2] + s * z[2], y[2], c * z[2] - s * x[2]),
        )

    def land(self, robot_pose: Array) -> None:
        """Begin to stand where the robot's foot is; it comes to lie flat within a few `FLATTEN_S`."""
        self._landed_at = (*self._at, self._heading())
        self._start[:] = robot_pose
        self._rest = 1.0
        self.lay(robot_pose)

    def lay(self, robot_pose: Array) -> None:
        """Put the sole on the ground where the robot's foot is now, its lower edge unmoved."""
        edge = self._edges[int(robot_pose[2, 0] < 0.0)]
        heading = _yaw(atan2(float(robot_pose[1, 0]), float(robot_pose[0, 0])))
        self._flat[:3, :3] = heading
        self._flat[:2, 3] = (robot_pose[:3, 3] + (robot_pose[:3, :3] - heading) @ edge)[:2]
        self._flat[2, 3] = 0.0
        self.pose[:] = self._flat

    def flatten(self, dt_s: float) -> None:
        """Bring a landed sole from how it touched down to flat, its lowest corner down to the floor."""
        if self._rest == 0.0:
            self.pose[:] = self._flat
            return
        self._rest = self._rest * exp(-dt_s / FLATTEN_S) if self._rest > 1e-3 else 0.0
        start, flat = self._start, self._flat
        edge = self._edges[int(start[2, 0] < 0.0)]
        R = _between(flat[:3, :3], start[:3, :3], self._rest)
        self.pose[:3, :3] = R
        self.pose[:3, 3] = flat[:3, 3] + (flat[:3, :3] - R) @ edge
        lowest = max(float(start[2, 3]) + float((self._corners @ start[2, :3]).min()), 0.0)
        self.pose[2, 3] = self._rest * lowest - float((self._corners @ R[2]).min())

    def crept(self, distance: float, angle: float) -> bool:
        """Tell whether the human's foot has moved [m] or turned [rad] further than this since it landed."""
        x, y, heading = self._landed_at
        turn = (self._heading() - heading + pi) % (2 * pi) - pi
        return hypot(self._at[0] - x, self._at[1] - y) > distance or abs(turn) > angle

    def _heading(self) -> float:
        return atan2(float(self.turn[1, 0]), float(self.turn[0, 0]))

    def roll(self) -> None:
        """Turn the standing sole about its front edge as the human's heel rises, about its rear edge as the toes do."""
        pitch = asin(min(max(-float(self.turn[2, 0]), -1.0), 1.0))
        pitch = min(max(pitch - min(max(pitch, -LEVEL_RAD), LEVEL_RAD), -ROLL_RAD), ROLL_RAD)
        c, s = cos(pitch), sin(pitch)
        edge = self._edges[int(pitch > 0.0)]
        R = self._flat[:3, :3] @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        self.pose[:3, :3] = R
        self.pose[:3, 3] = self._flat[:3, 3] + (self._flat[:3, :3] - R) @ edge

    def swing(self, ankle: Array, ratio: float, settings: FootSettings, robot_turn: Array) -> None:
        """Follow the scaled body's ankle, shape (3,) [m], over the ground.

        ``robot_turn`` is how the robot's sole is turned now, world from sole: where its ankle cannot turn the sole as
        far as the human's, the sole that is there clears the floor.
        """
        follow = 1.0 if settings.roll else self.freedom(settings)
        self.pose[:3, :3] = _between(_yaw(self._heading()), self.turn, follow)
        self.ankle[:] = ankle + self.offset
        w = smoothstep(self.clearance / settings.free_above_m)
        over_ground = ratio * self.clearance + self._ankle_over_lowest(self.pose[:3, :3])
        height = w * float(self.ankle[2]) + (1 - w) * over_ground
        self.ankle[2] = max(height, self._ankle_over_lowest(robot_turn))
        self.pose[:3, 3] = self.ankle - self.pose[:3, :3] @ self._sole_to_ankle

    def _ankle_over_lowest(self, R: Array) -> float:
        """Return how high the ankle is over the lowest corner of a sole turned by R [m]."""
        return float(R[2] @ self._sole_to_ankle) - float((self._corners @ R[2]).min())

    def freedom(self, settings: FootSettings) -> float:
        """Return 0 for a foot that must be flat, 1 for one that turns as the human's, and between near the ground."""
        return smoothstep((self.highest - settings.flat_below_m) / settings.flat_below_m)

    def ankle_of(self, pose: Array) -> Array:
        """Return the ankle's place for a pose of the sole, shape (3,) [m]."""
        return np.asarray(pose[:3, :3] @ self._sole_to_ankle + pose[:3, 3])


def _is_flat(sole: Array) -> bool:
    """Tell whether a sole lies on the floor, within 3 degrees and 3 mm."""
    return bool(sole[2, 2] > cos(0.05) and abs(sole[2, 3]) < 3e-3)


def _yaw(angle: float) -> Array:
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _between(A: Array, B: Array, share: float) -> Array:
    """Return a rotation between two, exact at both ends (columns blended and made orthonormal)."""
    if share <= 0.0:
        return A
    if share >= 1.0:
        return B
    z = (1 - share) * A[:, 2] + share * B[:, 2]
    x = (1 - share) * A[:, 0] + share * B[:, 0]
    z_norm = sqrt(float(z @ z))
    if z_norm < 1e-6:
        return B
    z /= z_norm
    x -= float(x @ z) * z
    x_norm = sqrt(float(x @ x))
    if x_norm < 1e-6:
        return B
    x /= x_norm
    out = np.empty((3, 3))
    out[:, 0], out[:, 1], out[:, 2] = x, cross3(z.tolist(), x.tolist()), z
    return out


class Footing:
    """Places both feet and the middle of the hips in the robot's world, frame after frame.

    Attributes:
        feet: Left and right.
        contact: The feet the robot stands on (left, right).
        landing: Time left in which a foot that landed may still shift, because the robot cannot lay it flat where it
            came down, left and right [s].
        anchor: Index of the foot that anchors the robot, or -1 in flight.
        mid_hip: Where the scaled body's mid-hip is, shape (3,) [m].
    """

    def __init__(self, robot: RobotModel, skeleton: Skeleton, settings: FootSettings, dt_s: float) -> None:
        self._robot, self._settings = robot, settings
        self._dt_s = dt_s
        self._fade = exp(-dt_s / settings.blend_s) if settings.blend_s > 0 else 0.0
        self.feet = [Foot(side, robot, skeleton) for side in SIDES]
        self.reset()

    def reset(self) -> None:
        """Forget where the feet stood."""
        self._started = False
        self._stepping, self._step_left = _NONE, 0.0
        self.landing = [0.0, 0.0]
        self.contact = [True, True]
        self.anchor = 0
        self.mid_hip: Array = np.zeros(3)
        self._human_mid_hip: Array = np.zeros(3)
        self._shift: Array = np.zeros(3)
        for foot in self.feet:
            foot.reset()

    def step(
        self,
        frame: HumanFrame,
        support: Support,
        ankles: Array,
        human: tuple[Array, Array],
        ratio: float,
        forward: Array,
    ) -> None:
        """Advance by a frame.

        Args:
            frame: The human.
            support: Its feet in contact.
            ankles: Scaled ankles relative to mid-hip, left and right, shape (2, 3) [m].
            human: The human's mid-hip and mid-ankle in world, shapes (3,) [m].
            ratio: Robot leg length over the human's [-].
            forward: Where the pelvis faces, shape (3,).
        """
        for foot in self.feet:
            foot.read(frame, forward)
        wanted = [support.left, support.right]
        if not self._started:
            self._start(wanted, ankles, human, ratio)
        if support.double:
            self._replace(wanted, ankles)
        else:
            self._stepping = _NONE
        landed = [w and not c for w, c in zip(wanted, self.contact, strict=True)]
        lifted = [c and not w for w, c in zip(wanted, self.contact, strict=True)]
        for i, foot in enumerate(self.feet):
            if landed[i]:
                foot.land(self._robot.pose(foot.role))
                self.landing[i] = _LAND_S
            if wanted[i] and self.landing[i] > 0.0:
                at = self._robot.pose(foot.role)
                foot.lay(at)
                self.landing[i] = 0.0 if _is_flat(at) else self.landing[i] - self._dt_s
            if wanted[i]:
                foot.flatten(self._dt_s)
                if self._settings.roll:
                    foot.roll()
        self.contact = wanted
        self._choose_anchor()
        if self.anchor != _FLIGHT:
            self.landing[self.anchor] = 0.0
        self._place_body(ankles, human, ratio, any(landed) or any(lifted))
        for i, foot in enumerate(self.feet):
            if wanted[i]:
                continue
            ankle = self.mid_hip + ankles[i]
            if lifted[i]:
                foot.offset[:] = foot.ankle_of(foot.pose) - ankle
                foot.offset[2] = 0.0
            else:
                foot.offset *= self._fade
            foot.swing(ankle, ratio, self._settings, self._robot.rotation(foot.role))
        self._human_mid_hip = human[0].copy()

    def rebase(self, human_mid_hip: Array) -> None:
        """Take the human's hips, seen again after a loss, as where they were: the robot does not jump after them."""
        self._human_mid_hip = human_mid_hip.copy()

    def placed(self, i: int) -> bool:
        """Tell whether a foot's place on the floor is held: it stands, or it has just lifted off and fades away."""
        if self.contact[i]:
            return self.landing[i] <= 0.0
        offset = self.feet[i].offset
        return hypot(float(offset[0]), float(offset[1])) > _FADED_M

    def _start(self, wanted: list[bool], ankles: Array, human: tuple[Array, Array], ratio: float) -> None:
        self._started = True
        self.mid_hip = np.array([ratio * human[0][0], ratio * human[0][1], 0.0])
        for i, foot in enumerate(self.feet):
            foot.pose[:3, 3] = (self.mid_hip + ankles[i])[0], (self.mid_hip + ankles[i])[1], 0.0
            foot.pose[:3, :3] = _yaw(atan2(float(foot.turn[1, 0]), float(foot.turn[0, 0])))
            foot.pose[:2, 3] -= (foot.ankle_of(foot.pose) - foot.pose[:3, 3])[:2]
            foot.land(foot.pose.copy())
        self.contact = list(wanted)
        self._human_mid_hip = human[0].copy()
        lowest = min(float(ankles[i][2] - foot.ankle_of(np.eye(4))[2]) for i, foot in enumerate(self.feet))
        self.mid_hip[2] = -lowest + ratio * min(f.clearance for f in self.feet)
        self.anchor = _FLIGHT

    def _replace(self, wanted: list[bool], ankles: Array) -> None:
        """In double support, step a foot whose human foot has crept or turned from where it landed.

        The human may slide, the robot's feet do not: the foot that does not anchor the robot is lifted (``wanted`` is
        changed) until it is where the scaled body has it, or for `_STEP_S`.
        """
        settings = self._settings
        if self.anchor == _FLIGHT or settings.replace_m == inf:
            return
        moved = [f.crept(settings.replace_m, settings.replace_rad) for f in self.feet]
        other = 1 - self.anchor
        if self._stepping == _NONE and moved[self.anchor] and self.contact[other] and not moved[other]:
            self.anchor, other = other, self.anchor
        if self._stepping == _NONE and not (moved[other] and self.contact[other]):
            return
        if self._stepping == _NONE:
            self._stepping, self._step_left = other, _STEP_S
        foot = self.feet[self._stepping]
        wish = self._stand_ankle(self.anchor) - ankles[self.anchor] + ankles[self._stepping]
        here = foot.ankle_of(self._robot.pose(foot.role))
        self._step_left -= self._dt_s
        if self._step_left <= 0.0 or hypot(float(wish[0] - here[0]), float(wish[1] - here[1])) < _ARRIVED_M:
            self._stepping = _NONE
            return
        foot.clearance = max(foot.clearance, _STEP_M)
        wanted[self._stepping] = False

    def _choose_anchor(self) -> None:
        if self.anchor != _FLIGHT and self.contact[self.anchor]:
            return
        standing = [i for i in range(2) if self.contact[i]]
        self.anchor = standing[-1] if standing else _FLIGHT

    def _place_body(self, ankles: Array, human: tuple[Array, Array], ratio: float, changed: bool) -> None:
        before = self.mid_hip
        if all(self.contact):  # the closed leg loop, without the knees (P4)
            middle = 0.5 * (self._stand_ankle(0) + self._stand_ankle(1))
            place = middle + ratio * (human[0] - human[1])
        elif self.anchor != _FLIGHT:
            place = self._stand_ankle(self.anchor) - ankles[self.anchor]
        else:
            place = before - self._shift + ratio * (human[0] - self._human_mid_hip)
        if changed:
            moved = ratio * (human[0] - self._human_mid_hip)
            self._shift = before + moved - place
        else:
            self._shift = self._shift * self._fade
        self.mid_hip = place + self._shift

    def _stand_ankle(self, i: int) -> Array:
        foot = self.feet[i]
        return foot.ankle_of(foot.pose)
