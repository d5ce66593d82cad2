"""Task stacks of the kit: canonical tasks, targets that a robot can reach, and rules that targets must keep."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.kinds import Component
from imitor.tasks import Task, TaskKind, TaskStack
from imitor.testing.expect import AnyComponent, Snapshot, expect, fail, is_rotation, short
from imitor.types import SEGMENTS, Array

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

K = TaskKind
_WHOLE_BODY: Final = {"com": K.COM, "posture": K.POSTURE, "limits": K.LIMITS}
CANONICAL: Final[dict[str, TaskKind]] = {
    **dict.fromkeys(("left_foot", "right_foot"), K.POSE),
    **dict.fromkeys(("left_hand", "right_hand", "head"), K.POSITION),
    **dict.fromkeys(("waist", "chest"), K.ORIENTATION),
    **dict.fromkeys(SEGMENTS, K.DIRECTION),
    "waist_vector": K.VECTOR,
    **_WHOLE_BODY,
}
"""The kinds that canonical tasks usually have."""


def declare_canonical(stack: TaskStack, robot: RobotModel, leave_out: Collection[str] = ()) -> None:
    """Declare the canonical tasks that the robot has frames for."""
    for name, kind in CANONICAL.items():
        if name in leave_out:
            continue
        proximal, distal = SEGMENTS.get(
            name, ("", "" if name in _WHOLE_BODY else name.removesuffix("_vector"))
        )
        if robot.has(*(r for r in (proximal, distal) if r)):
            stack.declare(name, kind, frame=distal, relative_to=proximal)


def aim(stack: TaskStack, robot: RobotModel, q: Array) -> None:
    """Write the targets that a configuration meets; moves the robot there."""
    robot.update(q)
    for task in stack:
        task.target[...] = now(task, robot, q)


def now(task: Task, robot: RobotModel, q: Array) -> Array:
    """Return the target that the robot's configuration meets."""
    match task.kind:
        case K.POSITION:
            value = robot.position(task.frame)
        case K.ORIENTATION:
            value = robot.rotation(task.frame)
        case K.VECTOR:
            value = robot.rotation(task.frame)[:, 0]
        case K.POSE:
            value = robot.pose(task.frame)
        case K.DIRECTION:
            d = robot.position(task.frame) - robot.position(task.relative_to)
            value = d / np.linalg.norm(d)
        case K.COM:
            value = robot.com
        case K.POSTURE:
            value = q[7:]
        case _:
            value = np.zeros(0)
    return np.array(value)


def error_of(task: Task, robot: RobotModel, q: Array) -> float:
    """Return how far the robot is from a target [m, rad, or root of their squares]."""
    there, target = now(task, robot, q), task.target
    if task.kind is K.LIMITS:
        middle = 0.5 * (robot.lower + robot.upper)
        return float(np.linalg.norm((q[7:] - middle) / (robot.upper - robot.lower)))
    if task.kind is K.ORIENTATION:
        return angle(there, target)
    if task.kind is K.POSE:
        return float(
            np.hypot(np.linalg.norm(there[:3, 3] - target[:3, 3]), angle(there[:3, :3], target[:3, :3]))
        )
    if task.kind in (K.DIRECTION, K.VECTOR):
        return float(np.arctan2(np.linalg.norm(np.cross(there, target)), there @ target))
    return float(np.linalg.norm(there - target))


def angle(A: Array, B: Array) -> float:
    """Return the angle between two rotations [rad]."""
    R = A.T @ B
    sine = 0.5 * np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(sine, 0.5 * (np.trace(R) - 1.0)))


def snapshot(stack: TaskStack) -> Snapshot:
    """Return copies of everything that may change from frame to frame."""
    return {
        "targets": stack.flat_target.copy(),
        "masks and active flags": stack.flat_switch.copy(),
        "gains": stack.flat_gain.copy(),
        "anchor": np.array(stack.anchor),
        "anchor_pose": stack.anchor_pose.copy(),
        "contact": np.array(stack.contact),
    }


def activate(stack: TaskStack, names: Iterable[str]) -> None:
    """Switch the tasks with these names on and all others off."""
    chosen = set(names)
    for task in stack:
        task.active[0] = task.name in chosen


def set_writable(stack: TaskStack, *, writable: bool) -> None:
    """Let the arrays of a stack be written, or not: solvers and post-processors read them only."""
    flats = (stack.flat_target, stack.flat_switch, stack.flat_gain)
    views = [a for task in stack for a in (task.target, task.mask, task.gain, task.active)]
    for array in (*flats, *views, stack.anchor_pose, stack.contact):
        array.flags.writeable = writable


def check_declared(component: Component[Any], stack: TaskStack, before: Collection[str]) -> None:
    """Check that a mapper or stabilizer declares what its class says, for frames that the robot has."""
    cls = type(component)
    declares = getattr(cls, "declares", {})
    robot: RobotModel = component.robot  # type: ignore[attr-defined]
    for task in stack:
        if task.name in before:
            continue
        name = task.name
        expect(name in declares, cls, f"it declares the task '{name}', which `declares` does not name")
        expect(
            task.kind is declares[name],
            cls,
            f"it declares '{name}' as {task.kind}, but `declares` says {declares[name]}",
        )
        for role in (task.frame, task.relative_to):
            expect(
                not role or robot.has(role), cls, f"task '{name}': robot '{robot.name}' has no frame '{role}'"
            )
        needs_frame = task.kind in (K.POSITION, K.ORIENTATION, K.DIRECTION, K.VECTOR, K.POSE)
        expect(not needs_frame or task.frame, cls, f"task '{name}' of kind {task.kind} names no frame")
        expect(task.kind is not K.DIRECTION or task.relative_to, cls, f"task '{name}' points from no frame")


def check_targets(cls: AnyComponent, stack: TaskStack, robot: RobotModel, which: str) -> None:
    """Check that all targets are finite, and those of active tasks what their kind says."""
    for task in stack:
        target, name = task.target, f"{which}: task '{task.name}'"
        if not np.isfinite(target).all():
            fail(cls, f"{name} has the target {short(target)}")
        expect(np.isfinite(task.gain[0]) and task.gain[0] >= 0, cls, f"{name} has the gain {task.gain[0]}")
        if not task.active[0]:
            continue
        if task.kind in (K.DIRECTION, K.VECTOR):
            length = float(np.linalg.norm(target))
            expect(abs(length - 1) < 1e-6, cls, f"{name} has a direction of length {length:.6g}, not 1")
        elif task.kind in (K.ORIENTATION, K.POSE) and not is_rotation(target[:3, :3]):
            fail(cls, f"{name}: the rotation of its target is none: {short(target)}")
        if task.kind is K.POSE:
            expect(
                (target[3] == (0, 0, 0, 1)).all(), cls, f"{name}: the last row of its target is {target[3]}"
            )
    expect(
        not stack.anchor or robot.has(stack.anchor),
        cls,
        f"{which}: the anchor '{stack.anchor}' is no frame of the robot",
    )
    pose = stack.anchor_pose
    if stack.anchor and not (is_rotation(pose[:3, :3]) and np.isfinite(pose).all()):
        fail(cls, f"{which}: the anchor's pose is none: {short(pose)}")
    contact = np.asarray(stack.contact)
    expect(
        contact.shape == (2,) and contact.dtype == np.bool_,
        cls,
        f"{which}: contact is {contact}, not two flags",
    )
