"""Human, robot, targets and balance in space, as entities of the Rerun viewer.

What does not change is sent once; frames are sent in whole columns, as many at a time as there are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from imitor.metrics.polygon import margins
from imitor.record import Motion, Reference
from imitor.robot.model import RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.types import Array
from imitor.visual import camera
from imitor.visual.clip import Clip, make_clip
from imitor.visual.geometry import Part, object_parts, robot_parts
from imitor.visual.rerun_log import RerunLog, rgb
from imitor.visual.stick import HEAD_COLOUR, HEAD_RADIUS, Stick, head_centre, stick_figure

COM_COLOUR: Final = (242, 143, 33)
SUPPORT_COLOUR: Final = (46, 158, 120)
TARGET_COLOUR: Final = (214, 60, 90)
_WORLD: Final = "tf#/world"
"""Name that Rerun gives to the frame of the entity ``world``."""


class RerunScene:
    """What is seen in space.

    Args:
        robot: The robot of the motion.
        stack: The tasks: which frame each is about and what it is relative to.
        environment: Objects around the robot.

    Attributes:
        arranged: Whether it is known where the human stands.
    """

    def __init__(
        self, robot: RobotModel, stack: TaskStack, environment: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        self._robot = robot
        self._points = [t for t in stack if t.kind in (TaskKind.POSITION, TaskKind.POSE, TaskKind.COM)]
        self._roles = sorted({t.relative_to for t in self._points if t.relative_to})
        self._parts, self._objects = robot_parts(robot), object_parts(environment)
        self._object_names = [str(item["name"]) for item in environment]
        self._moved: set[str] = set()
        self._joints = sorted({p.joint for p in self._parts})
        self._known = np.zeros(0, dtype=bool)
        self._stick: Stick | None = None
        self._shift = np.zeros(3)
        self.arranged = False

    def clip(self, motion: Motion, reference: Reference, rows: np.ndarray) -> Clip:
        """Return the chosen frames of a run with everything that is shown of them."""
        return make_clip(self._robot, motion, reference, rows, self._roles)

    def arrange(self, clip: Clip, *, beside: bool) -> None:
        """Place the human so that the two do not overlap in these frames, or over the robot."""
        robot, human = camera.robot_corners(clip, self._parts), camera.human_corners(clip)
        self._place(camera.arrange(clip, robot, human, beside=beside))

    def arrange_ahead(self, clip: Clip, human_height_m: float, *, beside: bool) -> None:
        """Place the human where the two do not overlap however they raise their arms: the frames to come are not known.

        Args:
            clip: The first frames.
            human_height_m: Stature; an arm span is as long [m].
            beside: Whether the human stands beside the robot; over it otherwise.
        """
        corners = camera.robot_corners(clip, self._parts)
        robot_height_m = float(np.ptp(corners[..., 2], axis=1).max())
        robot = camera.surrounding(clip.joint_position[:, 1], 0.5 * robot_height_m)
        human = camera.surrounding(clip.human_centre, 0.5 * human_height_m)
        self._place(camera.arrange(clip, robot, human, beside=beside))

    def _place(self, layout: camera.Layout) -> None:
        self._shift, self.arranged = layout.shift, True

    def begin(self, log: RerunLog) -> None:
        """Send what does not change: surfaces of the robot and of the objects around it."""
        rr = log.rr
        log.fixed("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for joint in self._joints:
            path = rr.new_entity_path(["world", "robot", self._robot.model.names[joint]])
            for k, part in enumerate(p for p in self._parts if p.joint == joint):
                log.fixed(f"{path}/part{k}", _mesh(rr, part), rr.CoordinateFrame(self._frame(joint)))
        for name, part in zip(self._object_names, self._objects, strict=True):
            log.fixed(_object_path(rr, name), _mesh(rr, part))

    def add(self, log: RerunLog, clip: Clip, reference: Reference, rows: np.ndarray) -> Array:
        """Send frames.

        Args:
            log: Where to.
            clip: The frames, from `clip`.
            reference: The run they are of, with the targets.
            rows: Which frames of it.

        Returns:
            Distance of the CoM from the border of the support polygon, positive inside, NaN without one, shape
            (T,) [m].
        """
        self._add_robot(log, clip)
        self._add_objects(log, clip)
        self._add_human(log, clip)
        self._add_targets(log, clip, reference, rows)
        return self._add_balance(log, clip)

    def _frame(self, joint: int) -> str:
        return f"robot/{self._robot.model.names[joint]}"

    def _add_robot(self, log: RerunLog, clip: Clip) -> None:
        """Send all joints of all frames at once: a tenth of the time that an entity a joint takes."""
        joints, n = self._joints, len(clip)
        columns = log.rr.Transform3D.columns(
            translation=clip.joint_position[:, joints].reshape(-1, 3),
            quaternion=clip.joint_quaternion[:, joints].reshape(-1, 4),
            child_frame=[self._frame(j) for j in joints] * n,
            parent_frame=[_WORLD] * (len(joints) * n),
        )
        log.columns("world/robot", np.repeat(clip.time_s, len(joints)), columns)

    def _add_objects(self, log: RerunLog, clip: Clip) -> None:
        """Send how far objects were moved; one that never was has nothing to send."""
        for name, shift in zip(
            self._object_names, clip.shifts(len(self._objects)).swapaxes(0, 1), strict=True
        ):
            if shift.any() or name in self._moved:
                self._moved.add(name)
                columns = log.rr.Transform3D.columns(translation=shift)
                log.columns(_object_path(log.rr, name), clip.time_s, columns)

    def _add_human(self, log: RerunLog, clip: Clip) -> None:
        rr, human = log.rr, clip.human + self._shift
        stick = self._stick_of(clip)
        shown = clip.human_valid[:, stick.bones].all(axis=2)
        bone = np.nonzero(shown)[1]
        columns = rr.LineStrips3D.columns(
            strips=human[:, stick.bones][shown],
            radii=stick.bone_radius[bone],
            colors=_bytes(stick.bone_colour)[bone],
        )
        log.varying("world/human/bones", clip.time_s, columns, shown.sum(axis=1))
        heads = [head_centre(p, v) for p, v in zip(human, clip.human_valid, strict=True)]
        points = np.concatenate([human[:, stick.joints], np.full((len(clip), 1, 3), np.nan)], axis=1)
        for i, head in enumerate(heads):
            if head is not None:
                points[i, -1] = head
        shown = np.isfinite(points).all(axis=2)
        shown[:, :-1] &= clip.human_valid[:, stick.joints]
        point = np.nonzero(shown)[1]
        columns = rr.Points3D.columns(
            positions=points[shown],
            radii=np.append(stick.joint_radius, HEAD_RADIUS)[point],
            colors=_bytes(np.vstack([stick.joint_colour, HEAD_COLOUR]))[point],
        )
        log.varying("world/human/joints", clip.time_s, columns, shown.sum(axis=1))

    def _stick_of(self, clip: Clip) -> Stick:
        """Return the stick figure of all points that were ever known."""
        known = clip.human_known
        if self._stick is None or not (known <= self._known).all():
            self._known = known if self._stick is None else self._known | known
            self._stick = stick_figure(self._known)
        return self._stick

    def _add_targets(self, log: RerunLog, clip: Clip, reference: Reference, rows: np.ndarray) -> None:
        """Send the points that tasks ask for, in world; a task that is switched off has none."""
        if not self._points:
            return
        points = np.empty((len(clip), len(self._points), 3))
        active = np.empty(points.shape[:2], dtype=bool)
        for k, task in enumerate(self._points):
            target = reference.target[task.name][rows]
            p = target[:, :3, 3] if task.kind is TaskKind.POSE else target
            if task.relative_to:
                base = clip.frame[task.relative_to]
                p = np.einsum("tij,tj->ti", base[:, :3, :3], p) + base[:, :3, 3]
            points[:, k], active[:, k] = p, reference.target_active[task.name][rows]
        shown = active & np.isfinite(points).all(axis=2)
        names = np.array([t.name for t in self._points])
        columns = log.rr.Points3D.columns(
            positions=points[shown], labels=names[np.nonzero(shown)[1]].tolist()
        )
        log.varying(
            "world/targets", clip.time_s, columns, shown.sum(axis=1),
            lambda: log.rr.Points3D.from_fields(radii=0.022, colors=TARGET_COLOUR, show_labels=False),
        )  # fmt: skip

    def _add_balance(self, log: RerunLog, clip: Clip) -> Array:
        rr, n = log.rr, len(clip)
        both = np.stack([clip.com, clip.com * [1.0, 1.0, 0.0]], axis=1)
        log.varying(
            "world/com", clip.time_s, rr.Points3D.columns(positions=both.reshape(-1, 3)), np.full(n, 2),
            lambda: rr.Points3D.from_fields(
                radii=[0.03, 0.02], colors=COM_COLOUR, labels=["CoM", "CoM on the floor"], show_labels=False
            ),
        )  # fmt: skip
        hulls = [clip.support_polygon(i) for i in range(n)]
        closed = [np.array([(x, y, 0.003) for x, y in [*hull, hull[0]]]) for hull in hulls if hull]
        log.varying(
            "world/support_polygon",
            clip.time_s,
            rr.LineStrips3D.columns(strips=closed),
            np.array([bool(h) for h in hulls], dtype=int),
            lambda: rr.LineStrips3D.from_fields(radii=0.006, colors=SUPPORT_COLOUR),
        )
        return np.array(margins(clip.com[:, :2], hulls))


def _object_path(rr: Any, name: str) -> str:
    return str(rr.new_entity_path(["world", "environment", name]))


def _mesh(rr: Any, part: Part) -> Any:
    surface = part.surface
    return rr.Mesh3D(
        vertex_positions=surface.vertices,
        triangle_indices=surface.faces,
        vertex_normals=_normals(surface.vertices, surface.faces),
        albedo_factor=[round(255 * c) for c in surface.rgba or (0.7, 0.7, 0.7, 1.0)],
    )


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the unit normals of the vertices, weighted by the areas of their triangles, shape (V, 3)."""
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    area = np.cross(b - a, c - a)
    out = np.zeros((len(vertices), 3))
    for k in range(3):
        np.add.at(out, faces[:, k], area)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    unit = np.divide(out, length, out=np.full_like(out, 3**-0.5), where=length > 0)
    return np.asarray(unit, dtype=np.float32)


def _bytes(colours: Array) -> np.ndarray:
    """Return colours (N, 3) of 0 to 1 in 0 to 255."""
    return np.array([rgb(c) for c in colours], dtype=np.uint8).reshape(-1, 3)


__all__ = ["RerunScene"]
