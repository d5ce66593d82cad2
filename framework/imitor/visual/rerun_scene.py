"""A run as entities of the Rerun viewer.

Whole columns are sent, never single frames: that is a hundred times faster.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from imitor.metrics.polygon import margins
from imitor.record import Motion, Reference
from imitor.robot.model import BASE_NV, RobotModel
from imitor.tasks import TaskKind, TaskStack
from imitor.types import Array
from imitor.visual import camera
from imitor.visual.clip import make_clip
from imitor.visual.geometry import Part, object_parts, robot_parts
from imitor.visual.stick import HEAD_COLOUR, HEAD_RADIUS, SIDE_COLOUR, head_centre, stick_figure

TIMELINE: Final = "time"
COM_COLOUR: Final = (242, 143, 33)
SUPPORT_COLOUR: Final = (46, 158, 120)
TARGET_COLOUR: Final = (214, 60, 90)


class RerunScene:
    """What is sent to a recording stream.

    Args:
        robot: The robot of the motion.
        motion, reference: The recorded run.
        stack: The tasks: which frame each is about and what it is relative to.
        rows: The frames that are shown in space.
        beside: Whether the human stands beside the robot.
        environment: Objects around the robot.
    """

    def __init__(
        self,
        robot: RobotModel,
        motion: Motion,
        reference: Reference,
        stack: TaskStack,
        rows: np.ndarray,
        *,
        beside: bool,
        environment: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        self._robot, self._motion, self._reference, self._rows = robot, motion, reference, rows
        self._points = [t for t in stack if t.kind in (TaskKind.POSITION, TaskKind.POSE, TaskKind.COM)]
        roles = sorted({t.relative_to for t in self._points if t.relative_to})
        self._clip = make_clip(robot, motion, reference, rows, roles)
        self._parts, self._objects = robot_parts(robot), object_parts(environment)
        self._object_names = [str(item["name"]) for item in environment]
        layout = camera.arrange(
            self._clip,
            camera.robot_corners(self._clip, self._parts),
            camera.human_corners(self._clip),
            beside=beside,
        )
        self._human = self._clip.human + layout.shift
        self._groups = joint_groups(robot)

    def send(self, stream: Any) -> None:
        """Send everything to a recording stream."""
        import rerun as rr

        self._stream, self._rr = stream, rr
        self._time = [rr.TimeColumn(TIMELINE, duration=self._clip.time_s)]
        stream.send_blueprint(self._blueprint())
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._send_robot()
        self._send_objects()
        self._send_human()
        self._send_targets()
        self._send_balance()
        self._send_plots()

    # ------------------------------------------------------------------ in space

    def _send_robot(self) -> None:
        rr, stream, clip = self._rr, self._stream, self._clip
        names = self._robot.model.names
        for joint in sorted({p.joint for p in self._parts}):
            path = rr.new_entity_path(["world", "robot", names[joint]])
            for k, part in enumerate(p for p in self._parts if p.joint == joint):
                stream.log(f"{path}/part{k}", self._mesh(part), static=True)
            columns = rr.Transform3D.columns(
                translation=clip.joint_position[:, joint], quaternion=clip.joint_quaternion[:, joint]
            )
            stream.send_columns(path, self._time, columns)

    def _send_objects(self) -> None:
        shifts = self._clip.shifts(len(self._objects)).swapaxes(0, 1)
        for name, part, shift in zip(self._object_names, self._objects, shifts, strict=True):
            path = self._rr.new_entity_path(["world", "environment", name])
            self._stream.log(path, self._mesh(part), static=True)
            if shift.any():
                self._stream.send_columns(path, self._time, self._rr.Transform3D.columns(translation=shift))

    def _mesh(self, part: Part) -> Any:
        surface = part.surface
        return self._rr.Mesh3D(
            vertex_positions=surface.vertices,
            triangle_indices=surface.faces,
            vertex_normals=_normals(surface.vertices, surface.faces),
            albedo_factor=[round(255 * c) for c in surface.rgba or (0.7, 0.7, 0.7, 1.0)],
        )

    def _send_human(self) -> None:
        rr, clip, human = self._rr, self._clip, self._human
        stick = stick_figure(clip.human_known)
        for side, colour in SIDE_COLOUR.items():
            mine = np.array([s == side for s in stick.bone_side], dtype=bool)
            if not mine.any():
                continue
            pairs = stick.bones[mine]
            shown = clip.human_valid[:, pairs].all(axis=2)
            self._send_varying(
                f"world/human/bones/{side}",
                rr.LineStrips3D.columns(strips=list(human[:, pairs][shown])),
                shown.sum(axis=1),
                rr.LineStrips3D.from_fields(
                    radii=float(stick.bone_radius[mine].mean()), colors=_bytes(colour)
                ),
            )
            joints = stick.joints[[s == side for s in stick.joint_side]]
            shown = clip.human_valid[:, joints]
            self._send_varying(
                f"world/human/joints/{side}",
                rr.Points3D.columns(positions=human[:, joints][shown]),
                shown.sum(axis=1),
                rr.Points3D.from_fields(radii=float(stick.joint_radius.mean()), colors=_bytes(colour)),
            )
        heads = [head_centre(p, v) for p, v in zip(human, clip.human_valid, strict=True)]
        self._send_points("world/human/head", heads, HEAD_RADIUS, _bytes(HEAD_COLOUR))

    def _send_targets(self) -> None:
        """Send the points that tasks ask for, in world; a task that is switched off has none."""
        for task in self._points:
            target = self._reference.target[task.name][self._rows]
            points = target[:, :3, 3] if task.kind is TaskKind.POSE else target
            if task.relative_to:
                base = self._clip.frame[task.relative_to]
                points = np.einsum("tij,tj->ti", base[:, :3, :3], points) + base[:, :3, 3]
            active = self._reference.target_active[task.name][self._rows]
            shown = [p if on else None for p, on in zip(points, active, strict=True)]
            path = self._rr.new_entity_path(["world", "targets", task.name])
            self._send_points(path, shown, 0.022, TARGET_COLOUR, label=task.name)

    def _send_balance(self) -> None:
        rr, clip = self._rr, self._clip
        on_floor = clip.com * [1.0, 1.0, 0.0]
        self._send_points("world/com", list(clip.com), 0.03, COM_COLOUR, label="CoM")
        self._send_points("world/com_on_floor", list(on_floor), 0.02, COM_COLOUR)
        self._hulls = [clip.support_polygon(i) for i in range(len(clip))]
        closed = [np.array([(x, y, 0.003) for x, y in [*hull, hull[0]]]) for hull in self._hulls if hull]
        self._send_varying(
            "world/support_polygon",
            rr.LineStrips3D.columns(strips=closed),
            np.array([bool(h) for h in self._hulls], dtype=int),
            rr.LineStrips3D.from_fields(radii=0.006, colors=SUPPORT_COLOUR),
        )

    def _send_points(
        self, path: str, points: Sequence[Array | None], radius: float, colour: Any, label: str = ""
    ) -> None:
        """Send one point a frame; ``None`` where there is none."""
        rr = self._rr
        present = [p for p in points if p is not None and np.isfinite(p).all()]
        counts = np.array([p is not None and bool(np.isfinite(p).all()) for p in points], dtype=int)
        style = rr.Points3D.from_fields(
            radii=radius, colors=colour, labels=[label] if label else None, show_labels=False
        )
        self._send_varying(
            path, rr.Points3D.columns(positions=np.array(present).reshape(-1, 3)), counts, style
        )

    def _send_varying(self, path: str, columns: Any, counts: np.ndarray, style: Any) -> None:
        """Send columns with another number of elements in each frame; nothing where there are none at all."""
        if counts.sum():
            self._stream.log(path, style, static=True)
            self._stream.send_columns(path, self._time, columns.partition(counts))

    # ------------------------------------------------------------------ plots

    def _send_plots(self) -> None:
        motion = self._motion
        q = motion.joint_position_rad
        speed = np.gradient(q, motion.time_s, axis=0) if len(motion) > 1 else np.zeros_like(q)
        for group, joints in self._groups:
            names = [motion.joint_names[j] for j in joints]
            self._send_series(f"plots/position_rad/{group}", motion.time_s, q[:, joints], names)
            self._send_series(f"plots/speed_rad_s/{group}", motion.time_s, speed[:, joints], names)
        inside = np.array(margins(self._clip.com[:, :2], self._hulls))
        known = np.isfinite(inside)
        self._send_series(
            "plots/com_margin_m", self._clip.time_s[known], inside[known, None], ["CoM margin [m]"]
        )
        times_ms = 1e3 * self._reference.compute_s[:, None]
        self._send_series("plots/frame_time_ms", motion.time_s, times_ms, ["time per frame [ms]"])

    def _send_series(self, path: str, time_s: Array, values: Array, names: Sequence[str]) -> None:
        rr = self._rr
        if not len(values):
            return
        self._stream.log(path, rr.SeriesLines(names=list(names)), static=True)
        columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values).ravel())
        counts = np.full(len(values), values.shape[1])
        self._stream.send_columns(path, [rr.TimeColumn(TIMELINE, duration=time_s)], columns.partition(counts))

    def _blueprint(self) -> Any:
        import rerun.blueprint as rrb

        def plots(quantity: str, name: str) -> Any:
            views = [
                rrb.TimeSeriesView(origin=f"plots/{quantity}/{group}", name=group.replace("_", " "))
                for group, _ in self._groups
            ]
            return rrb.Tabs(*views, name=name)

        return rrb.Blueprint(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="world", name="human and robot"),
                rrb.Vertical(
                    plots("position_rad", "joint positions [rad]"),
                    plots("speed_rad_s", "joint speeds [rad/s]"),
                    rrb.TimeSeriesView(origin="plots/com_margin_m", name="CoM margin [m]"),
                    rrb.TimeSeriesView(origin="plots/frame_time_ms", name="time per frame [ms]"),
                ),
                column_shares=[3, 2],
            ),
            collapse_panels=True,
        )


def joint_groups(robot: RobotModel) -> list[tuple[str, list[int]]]:
    """Return the joints of each limb, and those of trunk and head, as (name, joint numbers)."""
    below = {}
    for role in ("left_hand", "right_hand", "left_foot", "right_foot"):
        if robot.has(role):
            below[role] = robot.ancestors(role)[BASE_NV:] > 0
    shared = np.sum(list(below.values()), axis=0) > 1 if below else np.zeros(robot.n, dtype=bool)
    groups: list[tuple[str, list[int]]] = []
    rest = np.ones(robot.n, dtype=bool)
    for role, mask in below.items():
        own = mask & ~shared
        rest &= ~own
        groups.append((role.replace("hand", "arm").replace("foot", "leg"), np.flatnonzero(own).tolist()))
    groups.append(("trunk_and_head", np.flatnonzero(rest).tolist()))
    return [(name, joints) for name, joints in groups if joints]


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


def _bytes(colour: Sequence[float] | Array) -> tuple[int, int, int]:
    r, g, b = (round(255 * float(c)) for c in colour)
    return (r, g, b)
