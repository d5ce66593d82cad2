"""The rules that a robot's model and card are held to, each about one thing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from imitor.metrics.polygon import convex_hull, margin
from imitor.robot.card import ROBOT_ROLES, expand, expand_limits
from imitor.robot.describe import collision_or_reason, height_m, human_length_m
from imitor.types import SEGMENTS, SIDES

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

Level = Literal["error", "warning", "note"]
LEVELS: Final[tuple[Level, ...]] = ("error", "warning", "note")

MOTOR_SPEED: Final = 15.0  # [rad/s]; limbs of humans reach about 10, motors without load 20 and more
FLAT_M: Final = 0.002
UNEQUAL: Final = 0.01  # [-]; left and right of one robot
RATIO: Final = (0.5, 2.0)  # [-]; a robot's segment over a human's at the robot's stature
BUILD: Final = (
    4.0,
    60.0,
)  # mass over stature cubed [kg/m^3]; a human has 13, a small robot of metal up to 30
SIDEWAYS_RAD: Final = np.radians(10.0)


@dataclass(frozen=True)
class Finding:
    """One thing found in a card.

    Attributes:
        level: ``error`` (it cannot work), ``warning`` (improbable, look at it) or ``note`` (good to know).
        message: What was found, what is right, what to do.
    """

    level: Level
    message: str

    def __str__(self) -> str:
        return f"{self.level}: {self.message}"


def check_roles(robot: RobotModel) -> Iterator[Finding]:
    """Say which roles are missing and which tasks are lost with them."""
    tasks: dict[str, tuple[str, ...]] = {
        **{name: _without_middle(ends) for name, ends in SEGMENTS.items()},
        **{name: (name,) for name in ("left_hand", "right_hand", "head", "neck", "chest")},
    }
    given = robot.card.sided_roles()
    seen = set()
    for role in (r for r in ROBOT_ROLES if r not in given and r != "waist" and not r.endswith("_foot")):
        bare = role.removeprefix("left_").removeprefix("right_")
        if bare in seen:
            continue
        seen.add(bare)
        lost = [t for t, needs in tasks.items() if any(n.endswith(bare) for n in needs)]
        if bare == "chest":
            yield Finding("note", "roles.chest is not given: the waist stands for it")
        elif bare == "neck":
            yield Finding("note", "roles.neck is not given; no task needs it")
        else:
            yield Finding(
                "warning", f"roles.{bare} is not given: no {', '.join(lost) or 'foot height'} for this robot"
            )


def _without_middle(ends: tuple[str, str]) -> tuple[str, ...]:
    return tuple(f"left_{end[4:]}" if end.startswith("mid_") else end for end in ends)


def check_sides(robot: RobotModel) -> Iterator[Finding]:
    """Say which roles have left and right swapped."""
    swapped = []
    for role in (r for r in robot.roles if r.startswith("left_")):
        left, right = robot.position(role), robot.position(f"right_{role[5:]}")
        if left[1] <= right[1]:
            swapped.append(role[5:])
    if swapped:
        which = (
            "all roles"
            if len(swapped) == sum(r.startswith("left_") for r in robot.roles)
            else ", ".join(swapped)
        )
        yield Finding(
            "error",
            f"{which}: left lies to the right of right (y is to the left); swap the names, or turn the "
            "model so that x is forward",
        )


def check_axes(robot: RobotModel) -> Iterator[Finding]:
    """Say whether the base link looks forward along x with z up."""
    heights = [
        (r, float(robot.position(r)[2])) for r in ("left_foot", "mid_hip", "mid_shoulder") if robot.has(r)
    ]
    for (below, low), (above, high) in pairwise(heights):
        if high <= low:
            yield Finding(
                "error", f"{above} is not above {below} when standing; the base link's z must be up"
            )
            return
    for side in SIDES:
        if not robot.has(f"{side}_knee", f"{side}_ankle"):
            continue
        i = int(robot.model.frames[robot.frame_id(f"{side}_knee")].parentJoint) - 2
        if i < 0:
            continue
        q = robot.standing.copy()
        q[7 + i] = robot.lower[i] if -robot.lower[i] > robot.upper[i] else robot.upper[i]
        straight, bent = _shank(robot, robot.standing, side), _shank(robot, q, side)
        if bent[0] - straight[0] > 0.1 * np.linalg.norm(straight):
            yield Finding(
                "warning",
                f"{side}_knee bends so that the foot goes forward (x); is the base link's x forward?",
            )
            return


def _shank(robot: RobotModel, q: Any, side: str) -> Any:
    robot.update(q)
    shank = robot.position(f"{side}_ankle") - robot.position(f"{side}_knee")
    robot.update(robot.standing)
    return shank


def check_lengths(robot: RobotModel) -> Iterator[Finding]:
    """Say which segments are unequal, without length or improbably long."""
    lengths = robot.segment_lengths()
    stature = height_m(robot, collision_or_reason(robot))
    for name, length in lengths.items():
        human = human_length_m(name, stature)
        twin = lengths.get(f"right_{name[5:]}", length) if name.startswith("left_") else length
        if length < 1e-3:
            yield Finding("error", f"{name} has no length: its two roles are one point")
        elif abs(twin - length) > UNEQUAL * max(twin, length):
            yield Finding(
                "warning", f"{name} is {length:.3f} m long, {name.replace('left', 'right')} {twin:.3f} m"
            )
        elif human and name != "ankle_height" and not RATIO[0] <= length / human <= RATIO[1]:
            yield Finding(
                "warning",
                f"{name} is {length:.3f} m long, a human as tall as the robot ({stature:.2f} m) has "
                f"{human:.3f} m; are its roles at the joints' centres?",
            )


def check_soles(robot: RobotModel) -> Iterator[Finding]:
    """Say what is odd about the soles: order, area, flatness, place under the ankle."""
    polygon = [(float(x), float(y)) for x, y in robot.card.soles.polygon_m]
    hull = convex_hull(polygon)
    x, y = np.array(polygon).T
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) <= 0:
        yield Finding(
            "warning", "soles.polygon_m: list the corners counter-clockwise, seen from above, left foot"
        )
    if len(hull) < 3:
        yield Finding("error", "soles.polygon_m: its corners lie on a line; the sole has no area")
        return
    corners = robot.sole_corners()
    for i, side in enumerate(SIDES):
        spread = float(np.ptp(corners[i, :, 2]))
        if spread > FLAT_M:
            yield Finding(
                "warning",
                f"the {side} sole is not flat when standing: its corners differ by {1000 * spread:.1f} mm in "
                "height; adjust the ankles in `standing`, or soles.translation_m",
            )
    height = corners[..., 2].mean(axis=1)
    if abs(height[0] - height[1]) > FLAT_M:
        yield Finding(
            "warning",
            f"the soles are {1000 * abs(height[0] - height[1]):.1f} mm apart in height when standing",
        )
    if not robot.has("left_ankle"):
        return
    ankle = robot.position("left_ankle")
    outline = convex_hull([(float(px), float(py)) for px, py in corners[0, :, :2]])
    if margin((float(ankle[0]), float(ankle[1])), outline) < 0:
        yield Finding(
            "warning",
            "the left ankle is not over its sole when standing; look at soles.frame and translation_m",
        )
    if ankle[2] < height[0]:
        yield Finding("error", "the left ankle lies below its sole; soles.translation_m should point down")
    front, back = corners[0, :, 0].max() - ankle[0], ankle[0] - corners[0, :, 0].min()
    if front < 0.6 * back:
        yield Finding(
            "warning",
            f"the soles reach {front:.3f} m in front of the ankle and {back:.3f} m behind it; "
            "is the base link's x forward?",
        )


def check_standing(robot: RobotModel) -> Iterator[Finding]:
    """Say whether the standing posture is within the limits and the CoM over the soles."""
    for key in ("standing", "t_pose"):
        values: Mapping[str, float] = expand(getattr(robot.card, key))
        for name, value in values.items():
            i = robot.joint_index(name)
            if not robot.lower[i] - 1e-6 <= value <= robot.upper[i] + 1e-6:
                yield Finding(
                    "warning",
                    f"{key}.{name}: {value:g} rad is outside its limits {robot.lower[i]:.3f} to "
                    f"{robot.upper[i]:.3f}",
                )
    if robot.mass_kg <= 0:
        return
    inside = margin(
        (float(robot.com[0]), float(robot.com[1])),
        convex_hull([(float(x), float(y)) for x, y in robot.sole_corners()[..., :2].reshape(-1, 2)]),
    )
    if inside < 0:
        yield Finding(
            "warning",
            f"the centre of mass is {-inside:.3f} m outside the soles when standing; adjust `standing`",
        )


def check_t_pose(robot: RobotModel) -> Iterator[Finding]:
    """Say whether the arms point sideways in the T-pose."""
    if robot.card.reference_vectors or not robot.has("left_shoulder", "left_elbow", "left_wrist"):
        return
    q = robot.standing.copy()
    q[7:] = robot.joint_values(robot.card.t_pose, "t_pose")
    robot.update(q)
    for segment in ("left_upper_arm", "left_forearm"):
        a, b = SEGMENTS[segment]
        arm = robot.position(b) - robot.position(a)
        off = float(np.arccos(np.clip(arm[1] / max(float(np.linalg.norm(arm)), 1e-9), -1.0, 1.0)))
        if off > SIDEWAYS_RAD:
            yield Finding(
                "warning",
                f"{segment} points {np.degrees(off):.0f}° away from sideways in `t_pose`; correct it or, "
                "where the robot cannot reach a T-pose, give reference_vectors",
            )
    robot.update(robot.standing)


def check_limits(robot: RobotModel) -> Iterator[Finding]:
    """Say which limits are missing or those of a motor."""
    model, limits = robot.model, robot.card.limits
    open_ended = ~(np.isfinite(model.lowerPositionLimit[7:]) & np.isfinite(model.upperPositionLimit[7:]))
    given = expand_limits(limits.position_rad)
    open_joints = [
        n for n, o in zip(robot.joint_names, open_ended, strict=True) if o and not {n, "*"} & given.keys()
    ]
    if open_joints:
        yield Finding(
            "warning", f"no position limits: {_few(open_joints)}; ±2π is assumed; give limits.position_rad"
        )
    own = expand_limits(limits.speed_rad_s)
    speed = model.velocityLimit[6:]
    known = np.isfinite(speed) & (speed > 0) & (speed <= 1e3)
    unknown = [
        n for n, k in zip(robot.joint_names, known, strict=True) if not k and not {n, "*"} & own.keys()
    ]
    if unknown:
        yield Finding(
            "note",
            f"the model has no speed limit for {_few(unknown)}; 10 rad/s is assumed; give limits.speed_rad_s",
        )
    fast = [n for n, s in zip(robot.joint_names, robot.speed, strict=True) if s > MOTOR_SPEED]
    if fast:
        yield Finding(
            "warning",
            f"speed limits above {MOTOR_SPEED:g} rad/s are those of motors without load ({_few(fast)}); "
            "give limits.speed_rad_s",
        )
    if not np.isfinite(robot.acceleration).any():
        yield Finding(
            "note",
            "there are no acceleration limits; give limits.acceleration_rad_s2 where the robot has some",
        )


def check_mass(robot: RobotModel) -> Iterator[Finding]:
    """Say whether the mass is there and fits the robot's size."""
    if robot.mass_kg <= 0:
        yield Finding(
            "error", "the model has no mass: no centre of mass, no balance; add inertials to its links"
        )
        return
    build = robot.mass_kg / height_m(robot, collision_or_reason(robot)) ** 3
    if not BUILD[0] <= build <= BUILD[1]:
        yield Finding(
            "warning",
            f"a mass of {robot.mass_kg:.2f} kg is improbable for its size; are inertials in kg and "
            "lengths in m?",
        )


def check_locked(robot: RobotModel) -> Iterator[Finding]:
    """Say which joints do not move on their own."""
    if robot.locked:
        yield Finding("note", f"{len(robot.locked)} joints are not moved: {_few(list(robot.locked))}")
    if robot.coupling is not None:
        yield Finding("note", f"{robot.n} joints, {robot.coupling.shape[1]} of them independent")


def check_collision(robot: RobotModel) -> Iterator[Finding]:
    """Say whether self-collision can be looked for, and what overlaps when standing."""
    collision = collision_or_reason(robot)
    if isinstance(collision, str):
        yield Finding("warning", f"{collision}: self-collision is neither measured nor avoided")
        return
    yield Finding("note", f"{len(collision.pairs)} pairs are looked at for self-collision, {collision.rule}")
    from imitor.metrics.collision import full_configurations

    q = full_configurations(collision.model, robot.locked, robot.joint_names, robot.standing[None])[0]
    for depth, (a, b) in collision.collisions(q):
        yield Finding(
            "warning",
            f"{a} and {b} overlap by {1000 * depth:.1f} mm when standing; add them to collision.skip",
        )


def _few(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


RULES: Final[tuple[Callable[[RobotModel], Iterator[Finding]], ...]] = (
    check_roles,
    check_sides,
    check_axes,
    check_lengths,
    check_soles,
    check_standing,
    check_t_pose,
    check_limits,
    check_mass,
    check_locked,
    check_collision,
)
