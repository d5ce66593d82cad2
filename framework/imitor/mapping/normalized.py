r"""The Humanoid-Normalized model: the human as positions and planes in the robot's size [montecillo2010] eqs. 1, 2, 6.

.. math::
    [P_h, V_h, N_c, V_w, P_{lh}, N_{la}, P_{rh}, N_{ra}, P_{lf}, P_{rf}]

Each segment keeps the human's direction and takes the robot's length, legs the length they have when the robot stands.
What the robot's build has beside the human's (a neck further forward) is carried along as constant offsets, so that the
human's rest pose becomes the robot's standing posture. The hips are placed over where both feet stand or last
stood, in proportion to the legs.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from imitor.ik.vectors import cross
from imitor.mapping.planes import VirtualPlane, frame_of, upright
from imitor.mapping.scaled_body import POINTS, ScaledBody
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SIDES, Array, BoolArray, HumanFrame, Skeleton, Support

_FADE_S = 0.4
"""Time constant with which the hips come to be over newly placed feet [s]."""
_BENT = 0.17
"""Sine of the elbow's angle from which on the plane of the arm is taken as it is seen [-]."""

_KNEES = 0.96
"""Largest share of the leg's length for an upright human [-]: robots that stand with straight knees need room, too."""
_LEAN = 0.3
"""How far beyond the feet the hips go at most, as a share of the leg's length [-]."""
_FREE, _REACH = 0.85, 0.97
"""Up to which share of the arm's length a wrist is where the human's is, and how far it goes at most [-]: a straight
arm could only follow with the whole trunk."""


@dataclass
class ArmPlane:
    """The plane of shoulder, elbow and wrist, and the forearm in it [montecillo2010] eq. 6.

    Attributes:
        normal: Unit normal, parallel to the elbow's axis, shape (3,).
    """

    normal: Array | None = None

    def step(self, upper: Array, forearm: Array) -> Array:
        """Return the axes (N x V, N, V) from the directions of upper arm and forearm, shape (3, 3).

        A straight arm has no plane: it keeps its last normal, at first the one that an elbow has that bends forward
        from a hanging arm.
        """
        seen = cross(upper, forearm)
        before = _hanging_normal(forearm) if self.normal is None else self.normal
        share = min(float(np.sqrt(seen @ seen)) / _BENT, 1.0)
        length = max(float(np.sqrt(seen @ seen)), 1e-9)
        normal = share * seen / length + (1.0 - share) * before
        normal = normal - float(normal @ forearm) * forearm
        norm = float(np.sqrt(normal @ normal))
        if norm < 1e-3:
            normal = _hanging_normal(forearm)
            norm = 1.0
        self.normal = normal / norm
        return arm_axes(self.normal, forearm)


def arm_axes(normal: Array, forearm: Array) -> Array:
    """Return the rotation of eq. 6, columns N x V, N and V, shape (3, 3)."""
    out = np.empty((3, 3))
    out[:, 0], out[:, 1], out[:, 2] = cross(normal, forearm), normal, forearm
    return out


def _hanging_normal(forearm: Array) -> Array:
    """Return the normal of a straight arm: that of a hanging one, turned the shortest way to where the arm points."""
    x, y, z = forearm.tolist()
    if z > 0.999:
        return np.array([0.0, -1.0, 0.0])
    k = y / (1.0 - z)  # the image of -y under the smallest rotation from straight down
    return np.array([k * x, k * y - 1.0, -y + 0.0 * k])


class NormalizedBody:
    """The HN model, frame by frame.

    Args:
        robot: The robot; left at its standing posture.
        skeleton: The human.
        dt_s: Time between frames [s].

    Attributes:
        body: The scaled segments.
        mid_hip, mid_shoulder, head: In the robot's world, shape (3,) [m].
        wrist: Poses of the robot's wrists, left and right, world from wrist, shape (2, 4, 4).
        turn: How ``head``, ``chest`` and ``waist`` are turned, world from segment, shape (3, 3) each.
    """

    def __init__(self, robot: RobotModel, skeleton: Skeleton, dt_s: float) -> None:
        lengths = robot.segment_lengths()
        robot.update(robot.standing)
        at = {r: robot.position(r).copy() for r in robot.roles}
        hip, shoulder = (0.5 * (at[f"left_{r}"] + at[f"right_{r}"]) for r in ("hip", "shoulder"))
        ankle = 0.5 * (at["left_ankle"] + at["right_ankle"])
        legs = [lengths[f"{s}_{part}"] for s in SIDES for part in ("thigh", "shank")]
        stand = sum(float(np.linalg.norm(at[f"{s}_hip"] - at[f"{s}_ankle"])) for s in SIDES)
        share = min(stand / sum(legs), _KNEES)
        self.body = ScaledBody(robot, skeleton, dt_s, leg_share=share)
        rest = _Rest(skeleton)
        head = at.get("head", shoulder)
        self._over_feet = hip - ankle - rest.hips(0.5 * stand)
        self._torso_offset = shoulder - hip - lengths["torso"] * rest.torso
        self._head_offset = head - shoulder - lengths.get("head", 0.0) * rest.head
        self._wrist_turn = _wrist_turns(robot)
        self._place = {name: i for i, name in enumerate(POINTS)}
        self._arm_length = [lengths[f"{s}_upper_arm"] + lengths[f"{s}_forearm"] for s in SIDES]
        index = self.body.segments.index
        self._torso, self._hips, self._shoulders = index("torso"), index("hips"), index("shoulders")
        self._arm = [(index(f"{s}_upper_arm"), index(f"{s}_forearm")) for s in SIDES]
        self._ankles = [ROLE_INDEX[f"{s}_ankle"] for s in SIDES]
        self._planes = {
            "head": VirtualPlane(skeleton, "head", "head"),
            "chest": VirtualPlane(skeleton, "thorax", "chest"),
            "waist": VirtualPlane(skeleton, "pelvis", "pelvis"),
        }
        self._fade = exp(-dt_s / _FADE_S)
        self.turn: dict[str, Array] = {}
        self.wrist = np.tile(np.eye(4), (2, 1, 1))
        self.reset()

    def reset(self) -> None:
        """Forget the person and where the feet stood."""
        self.body.reset()
        for plane in self._planes.values():
            plane.reset()
        self.turn.update({name: np.eye(3) for name in self._planes})
        self._points = {name: np.eye(3) for name in ("chest", "waist")}
        self._arms = [ArmPlane(), ArmPlane()]
        self._human_foot: list[Array] = []
        self._robot_foot: list[Array] = []
        self._stood = [False, False]
        self._shift: Array = np.zeros(3)
        self.mid_hip: Array = np.zeros(3)
        self.mid_shoulder: Array = np.zeros(3)
        self.head: Array = np.zeros(3)

    def step(
        self, frame: HumanFrame, support: Support | None, ankles: tuple[Array, Array], contact: BoolArray
    ) -> None:
        """Build the model of this frame; the scaled body has taken the frame before.

        Args:
            frame: The human.
            support: Its feet in contact, when known.
            ankles: The robot's ankles where its feet stand, shape (3,) [m] each.
            contact: The feet that the robot stands on.
        """
        body = self.body
        direction = body.direction
        up = direction[self._torso].tolist()
        for name, line in (("chest", self._shoulders), ("waist", self._hips)):
            found = frame_of(direction[line].tolist(), up)
            if found is not None:
                self._points[name] = found
        for name, plane in self._planes.items():
            self.turn[name] = plane.step(frame, self._points["waist" if name == "waist" else "chest"])
        self._place_hips(frame, support, ankles, contact)
        relative, chest = body.relative, self._points["chest"]
        lifted = self.mid_hip + chest @ self._torso_offset
        np.add(lifted, relative[self._place["mid_shoulder"]], out=self.mid_shoulder)
        np.add(lifted, relative[self._place["head"]] + chest @ self._head_offset, out=self.head)
        for i, side in enumerate(SIDES):
            upper, forearm = self._arm[i]
            axes = self._arms[i].step(direction[upper], direction[forearm])
            self.wrist[i, :3, :3] = axes @ self._wrist_turn[i]
            shoulder = relative[self._place[f"{side}_shoulder"]]
            way = _within(relative[self._place[f"{side}_wrist"]] - shoulder, self._arm_length[i])
            self.wrist[i, :3, 3] = lifted + shoulder + way

    def _place_hips(
        self, frame: HumanFrame, support: Support | None, ankles: tuple[Array, Array], contact: BoolArray
    ) -> None:
        """Put the hips over both feet's places; a foot in the air counts where it stood."""
        stands = (True, True) if support is None else (support.left, support.right)
        if not self._human_foot:
            if not all(frame.valid[k] for k in self._ankles) or not self.body.hips_seen:
                self.mid_hip = 0.5 * (ankles[0] + ankles[1]) + self._standing_over()
                return
            self._human_foot = [frame.position[k].copy() for k in self._ankles]
            self._robot_foot = [a.copy() for a in ankles]
            self._stood = [True, True]
        landed = False
        for i, k in enumerate(self._ankles):
            both = stands[i] and bool(contact[i])
            if both:
                if frame.valid[k]:
                    self._human_foot[i] = frame.position[k]
                self._robot_foot[i] = ankles[i].copy()
            landed = landed or (both and not self._stood[i])
            self._stood[i] = both
        before = self.mid_hip
        self._shift = self._shift * self._fade
        human = self.body.mid_hip - 0.5 * (self._human_foot[0] + self._human_foot[1])
        place = self._middle_of_feet() + self._near_feet(self.body.leg_ratio * human)
        place = place + upright(self._points["waist"]) @ self._over_feet
        if landed:
            self._shift = before - place
        self.mid_hip = place + self._shift

    def _middle_of_feet(self) -> Array:
        return np.asarray(0.5 * (self._robot_foot[0] + self._robot_foot[1]))

    def _near_feet(self, over: Array) -> Array:
        """Keep the hips in reach of feet that the robot has not set down yet after the human's, shape (3,) [m]."""
        apart = self._robot_foot[0] - self._robot_foot[1]
        most = 0.5 * float(np.sqrt(apart @ apart)) + _LEAN * self.body.standing_leg
        aside = float(np.hypot(over[0], over[1]))
        if aside > most:
            over = over * np.array([most / aside, most / aside, 1.0])
        return over

    def _standing_over(self) -> Array:
        """Where the hips are over the ankles before the human was seen, shape (3,) [m]."""
        return np.asarray(self._over_feet + np.array([0.0, 0.0, self.body.standing_leg]))


class _Rest:
    """Directions of the human's rest pose, upright where the skeleton does not know them."""

    def __init__(self, skeleton: Skeleton) -> None:
        at = skeleton.rest_position

        def middle(role: str) -> Array:
            return np.asarray(0.5 * (at[ROLE_INDEX[f"left_{role}"]] + at[ROLE_INDEX[f"right_{role}"]]))

        self.torso = _steep(middle("shoulder") - middle("hip"))
        self.head = _steep(at[ROLE_INDEX["head"]] - middle("shoulder"))
        self._leg = _steep(middle("hip") - middle("ankle"))

    def hips(self, leg: float) -> Array:
        """Return the hips over the ankles for legs of a length [m], shape (3,) [m]."""
        return leg * self._leg


def _steep(d: Array) -> Array:
    """Return the direction when it is known and about upward, else straight up."""
    length = float(np.linalg.norm(d))
    up = np.array([0.0, 0.0, 1.0])
    return d / length if np.isfinite(length) and length > 1e-6 and d[2] > 0.7 * length else up


def _within(way: Array, length: float) -> Array:
    """Return the way from shoulder to wrist, drawn in smoothly where the arm is nearly straight, shape (3,) [m]."""
    reach = float(np.sqrt(way @ way))
    free, most = _FREE * length, _REACH * length
    if reach <= free:
        return way
    room = most - free
    return way * ((free + room * (1.0 - exp((free - reach) / room))) / reach)


def _wrist_turns(robot: RobotModel) -> Array:
    """Return the wrists in the axes of eq. 6, shape (2, 3, 3): measured with bent elbows, wrists in mid-range."""
    q = robot.standing.copy()
    q[7:] = 0.5 * (robot.lower + robot.upper)
    robot.update(q)
    out = np.empty((2, 3, 3))
    for i, side in enumerate(SIDES):
        shoulder, elbow, wrist = (robot.position(f"{side}_{r}") for r in ("shoulder", "elbow", "wrist"))
        forearm = (wrist - elbow) / np.linalg.norm(wrist - elbow)
        normal = cross((elbow - shoulder) / np.linalg.norm(elbow - shoulder), forearm)
        size = float(np.linalg.norm(normal))
        normal = normal / size if size > 0.1 else _hanging_normal(forearm)
        out[i] = arm_axes(normal, forearm).T @ robot.rotation(f"{side}_wrist")
    robot.update(robot.standing)
    return out
