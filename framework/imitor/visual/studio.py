"""The studio: robot, human, floor, light and camera of a recorded run, one picture a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imitor.record import Motion, Reference
from imitor.robot.model import RobotModel
from imitor.types import Array
from imitor.visual import camera
from imitor.visual.clip import make_clip
from imitor.visual.geometry import object_parts, robot_parts
from imitor.visual.mujoco_scene import Pencil, Scene
from imitor.visual.offscreen import Offscreen
from imitor.visual.stick import head_centre, stick_figure

SUPPORT_COLOUR: Final = (0.18, 0.62, 0.47)
COM_COLOUR: Final = (0.95, 0.56, 0.13)
HUMAN_COM_COLOUR: Final = (0.38, 0.48, 0.62)

_OVER_THE_FLOOR: Final = 0.004
"""Height of marks on the floor, so that they hide it [m]."""
_SHADOW_ROOM: Final = 0.8
"""How much farther than the figures their shadows reach [m]."""


class Studio:
    """Renders the chosen frames of a run.

    Args:
        robot: The robot of the motion.
        motion, reference: The recorded run.
        rows: Indices of the frames to show.
        size: Width and height of the pictures [px].
        beside: Whether the human stands beside the robot; over it, half transparent, otherwise.
        balance: Whether CoM and support polygon are marked on the floor.
        shadows: Whether the figures cast shadows.
        environment: Objects around the robot; the camera does not look for them.

    Attributes:
        time_s: Times of the pictures, shape (T,) [s].
        view: The camera.

    Raises:
        SinkError: No picture can be rendered here.
    """

    def __init__(
        self,
        robot: RobotModel,
        motion: Motion,
        reference: Reference,
        rows: np.ndarray,
        *,
        size: tuple[int, int],
        beside: bool = True,
        balance: bool = True,
        shadows: bool = True,
        environment: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        self._clip = clip = make_clip(robot, motion, reference, rows)
        self.time_s: Array = clip.time_s
        self._balance, self._shadows = balance, shadows
        self._alpha = 1.0 if beside else 0.45
        self._stick = stick_figure(clip.human_known)
        parts = robot_parts(robot)
        robot_points, human_points = camera.robot_corners(clip, parts), camera.human_corners(clip)
        layout = camera.arrange(clip, robot_points, human_points, beside=beside)
        self._shift = layout.shift
        self._human = clip.human + layout.shift
        human_points = human_points + layout.shift
        self.view = view = camera.frame_all(clip, robot_points, human_points, layout, size[0] / size[1])
        objects = object_parts(environment)
        self._shifts = clip.shifts(len(objects))
        self._scene = Scene(
            parts, objects, size, camera.FIELD_OF_VIEW, view.azimuth, view.reach + _SHADOW_ROOM
        )
        self._offscreen = self._new_offscreen(size)

    def __len__(self) -> int:
        return len(self._clip)

    def resize(self, size: tuple[int, int]) -> None:
        """Render the next pictures larger or smaller, width and height [px]; the shape should stay."""
        self._offscreen.close()
        self._scene.allow(size)
        self._offscreen = self._new_offscreen(size)

    def _new_offscreen(self, size: tuple[int, int]) -> Offscreen:
        offscreen = Offscreen(self._scene.model, size, shadows=self._shadows)
        cam = offscreen.camera
        cam.azimuth, cam.elevation = np.degrees(self.view.azimuth), np.degrees(self.view.elevation)
        cam.distance = self.view.distance
        return offscreen

    def picture(self, i: int) -> NDArray[np.uint8]:
        """Render one frame, shape (height, width, 3)."""
        clip, target = self._clip, self.view.target[i]
        self._scene.pose(clip.joint_position[i], clip.joint_quaternion[i], target, self._shifts[i])
        self._offscreen.camera.lookat[:] = target
        self._offscreen.look(self._scene.data)
        pencil = Pencil(self._offscreen.scene)
        valid = clip.human_valid[i]
        head = head_centre(self._human[i], valid)
        pencil.human(self._stick, self._human[i], valid, head, self._alpha)
        if self._balance:
            self._mark_balance(pencil, i)
        return self._offscreen.picture()

    def close(self) -> None:
        """Free the graphics memory; safe to call again."""
        self._offscreen.close()

    def _mark_balance(self, pencil: Pencil, i: int) -> None:
        """Draw the support polygon and the CoM's projection on the floor."""
        clip = self._clip
        corners = [np.array([x, y, _OVER_THE_FLOOR]) for x, y in clip.support_polygon(i)]
        for a, b in zip(corners, [*corners[1:], *corners[:1]], strict=True):
            pencil.capsule(a, b, 0.007, SUPPORT_COLOUR)
        pencil.projection(clip.com[i], COM_COLOUR)
        if np.isfinite(clip.human_com[i]).all():
            pencil.projection(clip.human_com[i] + self._shift, HUMAN_COM_COLOUR, self._alpha)
