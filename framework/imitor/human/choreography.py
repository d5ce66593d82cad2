"""What an author writes down: the time courses from which the kinematics builds the body's motion.

Angles [rad], lengths [m]. Every channel starts in quiet standing; a scenario adds to it. Angle signs are
those of anatomy, the same on both sides, so that a mirrored motion has the same channels with the sides
swapped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from imitor.human.body import Body
from imitor.human.trajectories import bump, keys, minimum_jerk
from imitor.types import ROLE_INDEX, SIDES, Array, BoolArray

TOE_OUT: Final = np.radians(7.0)
"""Yaw of each foot in quiet standing, toes outwards [rad]."""
STANCE: Final = 0.062
"""Distance of each ankle from the middle in quiet standing, as a fraction of the stature."""
COM_BEFORE_ANKLES: Final = 0.024
"""How far before the ankles the CoM stands in quiet standing, as a fraction of the stature."""

SIGN: Final = {"left": 1.0, "right": -1.0}


class Arm:
    """Angles of an arm, each (T,) [rad], zero when it hangs straight down with the palm inwards.

    Attributes:
        flexion: Forwards, in the shoulder.
        abduction: Sideways, in the shoulder; with flexion one rotation vector, so nothing is singular below
            a half turn.
        twist: Inwards about the upper arm.
        elbow: Flexion of the elbow.
        pronation: Thumb inwards, about the forearm.
        wrist: Towards the palm.
    """

    def __init__(self, n: int) -> None:
        self.flexion = np.full(n, np.radians(2.0))
        self.abduction = np.full(n, np.radians(6.0))
        self.twist = np.full(n, np.radians(12.0))
        self.elbow = np.full(n, np.radians(16.0))
        self.pronation = np.full(n, np.radians(15.0))
        self.wrist = np.full(n, np.radians(4.0))


@dataclass
class Reach:
    """Where a hand is drawn to, whatever the trunk does.

    Attributes:
        share: How much the target counts, (T,), 0 (the arm's angles) to 1 (exactly there).
        hand: Knuckle positions in world (T, 3) [m].
        yaw: Turn of the hand about the vertical from its T-pose orientation (T,) [rad].
        pole: Direction in world in which the elbow points, (3,).
    """

    share: Array
    hand: Array
    yaw: Array
    pole: Array


@dataclass
class Foot:
    """The course of a foot.

    Attributes:
        place: The floor point under the ankle when flat (T, 2) [m].
        yaw: Turn about the vertical (T,) [rad].
        lift: Height of the ball of the foot over its height on the floor (T,) [m].
        heel_up: Pitch about the ball that raises the heel (T,) [rad].
        toes_up: Pitch about the ball that raises the toes, the heel kept clear of the floor (T,) [rad].
        contact: When it stands, flat and unmoving (T,).
    """

    place: Array
    yaw: Array
    lift: Array
    heel_up: Array
    toes_up: Array
    contact: BoolArray


@dataclass
class Choreography:
    """All channels of a motion.

    Attributes:
        time: Authored time (T,) [s], before the scaling by ``speed``.
        body: Whose motion it is.
        drop: How far the pelvis is lowered from where the straight legs would hold it (T,) [m].
        pelvis: Yaw, pitch, roll of the pelvis in world (T, 3) [rad].
        spine: Yaw, pitch, roll of the thorax against the pelvis (T, 3) [rad].
        head: Yaw, pitch, roll of the head against the thorax (T, 3) [rad].
        com: Where the CoM is to be, horizontally (T, 2) [m].
        arms, reaches, feet: By side.
        handle: Pose of a handle that the hands hold (T, 4, 4), and ``grasped`` (T,) when.
    """

    time: Array
    body: Body
    drop: Array = field(init=False)
    pelvis: Array = field(init=False)
    spine: Array = field(init=False)
    head: Array = field(init=False)
    com: Array = field(init=False)
    arms: dict[str, Arm] = field(init=False)
    reaches: dict[str, Reach] = field(default_factory=dict)
    feet: dict[str, Foot] = field(init=False)
    handle: Array | None = None
    grasped: BoolArray | None = None

    def __post_init__(self) -> None:
        n = len(self.time)
        self.drop = np.zeros(n)
        self.pelvis, self.spine, self.head = (np.zeros((n, 3)) for _ in range(3))
        self.arms = {side: Arm(n) for side in SIDES}
        self.feet = {
            side: Foot(
                np.tile([0.0, SIGN[side] * STANCE * self.height], (n, 1)),
                np.full(n, SIGN[side] * TOE_OUT),
                np.zeros(n),
                np.zeros(n),
                np.zeros(n),
                np.ones(n, dtype=bool),
            )
            for side in SIDES
        }
        self.com = np.tile([COM_BEFORE_ANKLES * self.height, 0.0], (n, 1))

    @property
    def height(self) -> float:
        """The nominal stature, for lengths written as its fractions [m]."""
        return self.body.height_m

    @property
    def length_s(self) -> float:
        """Authored length [s]."""
        return float(self.time[-1])

    def over(self, side: str, t: float, forward: float = 0.0) -> Array:
        """Return the floor point over which the CoM stands on one foot, (2,) [m].

        Args:
            side: The standing foot.
            t: When the foot stands there [s].
            forward: Further along the foot, as a fraction of the stature.
        """
        foot = self.feet[side]
        i = int(np.clip(np.searchsorted(self.time, t), 0, len(self.time) - 1))
        ahead = (COM_BEFORE_ANKLES + forward) * self.height
        return np.asarray(foot.place[i] + ahead * np.array([np.cos(foot.yaw[i]), np.sin(foot.yaw[i])]))

    def between(self, t: float) -> Array:
        """Return the floor point of the CoM with the weight on both feet, (2,) [m]."""
        return np.asarray(0.5 * (self.over("left", t) + self.over("right", t)))

    def lead_com(self, points: Sequence[tuple[float, ArrayLike]]) -> None:
        """Lead the CoM from point to point, at rest in each."""
        self.com = keys(self.time, points)

    def step(
        self,
        side: str,
        off: float,
        on: float,
        to: ArrayLike,
        *,
        height: float,
        roll_off: float,
        strike: float,
    ) -> None:
        """Move a foot from where it stands to another place, flat on the floor before ``off`` and after
        ``on``.

        Args:
            side: Which foot.
            off: When it leaves the floor [s].
            on: When it stands again [s].
            to: The new floor point under the ankle (2,) [m].
            height: Height of the ball of the foot midway [m].
            roll_off: How far the heel rises first [rad].
            strike: How far the toes are raised before landing [rad].
        """
        foot, t = self.feet[side], self.time
        s = np.clip((t - off) / (on - off), 0.0, 1.0)
        start = foot.place[-1].copy()  # steps are written in the order of time
        foot.place += minimum_jerk((s - 0.08) / 0.84)[:, None] * (np.asarray(to) - start)
        foot.place[t >= on] = to
        foot.lift += height * bump(s, 0.0, 1.0)
        foot.heel_up += roll_off * bump(s, 0.0, 0.75)
        foot.toes_up += strike * bump(s, 0.45, 1.0)
        self.airborne(side, off, on)

    def lead_ankle(self, side: str, place: Array, height: Array) -> None:
        """Lead a foot by its ankle, whatever its pitch ``heel_up`` and for a yaw of zero.

        Args:
            side: Which foot.
            place: Horizontal ankle positions (T, 2) [m].
            height: Ankle heights (T,) [m].
        """
        foot, to_ball = self.feet[side], self.body.offset(f"{side}_ankle", f"{side}_toe")
        c, s = np.cos(foot.heel_up), np.sin(foot.heel_up)
        ahead, below = to_ball[0], -to_ball[2]
        foot.place = place - np.column_stack([ahead * (1.0 - c) + below * s, np.zeros_like(c)])
        flat = self.body.rest[ROLE_INDEX[f"{side}_ankle"], 2]
        foot.lift = height - flat - ahead * s + below * (1.0 - c)

    def airborne(self, side: str, off: float, on: float) -> None:
        """Declare that a foot has no contact between two times [s]."""
        self.feet[side].contact &= ~((self.time > off) & (self.time < on))

    def swing_arms(self, gain: float) -> None:
        """Swing the arms, the shoulders and the hips against the legs, as in walking.

        Args:
            gain: Shoulder flexion per lead of the opposite foot over the other, in statures [rad].
        """
        lead = (self.feet["left"].place[:, 0] - self.feet["right"].place[:, 0]) / self.height
        for side in SIDES:
            forwards = -SIGN[side] * gain * lead
            self.arms[side].flexion += forwards
            self.arms[side].elbow += 0.35 * gain * np.sqrt(lead**2 + 0.01) - 0.035 * gain + 0.25 * forwards
        self.pelvis[:, 0] += -0.25 * lead
        self.spine[:, 0] += 0.5 * lead

    def lean_with_weight(self, gain: float = 0.5) -> None:
        """Let the pelvis sink on the side without weight and the trunk stay upright over it [rad/m]."""
        middle = 0.5 * (self.feet["left"].place[:, 1] + self.feet["right"].place[:, 1])
        aside = gain * (self.com[:, 1] - middle)
        self.pelvis[:, 2] += aside
        self.spine[:, 2] -= 1.2 * aside

    def breathe(self) -> None:
        """Let the chest rise and fall a little, at rest at both ends."""
        t = self.time
        ends = keys(t, [(0.0, 0.0), (1.0, 1.0), (max(self.length_s - 1.0, 1.0), 1.0), (self.length_s, 0.0)])
        self.spine[:, 1] -= np.radians(0.35) * ends * (1.0 - np.cos(2 * np.pi * 0.27 * t))

    def keep_gaze(self, share: float = 0.75) -> None:
        """Turn the head against the trunk, so that the eyes stay with the world."""
        self.head -= share * (self.pelvis + self.spine)
