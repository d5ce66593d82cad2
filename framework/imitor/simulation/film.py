"""Pictures and arrays of what the simulated robot did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.record import Motion, Reference, write_arrays
from imitor.robot.model import BASE_NQ, RobotModel
from imitor.simulation.playback import Trace
from imitor.types import BoolArray

if TYPE_CHECKING:
    from imitor.visual.studio import Studio

_SHEET: Final = (4, 2)
"""Columns and rows of the contact sheet."""
_SHEET_WIDTH: Final = 1600
_MOST_PICTURES: Final = 1500
"""Of a .gif, whose pictures are all in memory while it is written."""


def executed_motion(trace: Trace, robot: RobotModel, contact: BoolArray) -> Motion:
    """Return what the robot did in the form of what it was told.

    Args:
        trace: The simulated run.
        robot: The robot.
        contact: The feet that carried weight, shape (T, 2).
    """
    return Motion(
        robot=robot.name,
        time_s=trace.time_s,
        joint_names=robot.joint_names,
        joint_position_rad=trace.q[:, BASE_NQ:],
        root_position_m=trace.q[:, :3],
        root_quaternion_wxyz=trace.q[:, [6, 3, 4, 5]],
        contact=contact,
        status=["ok"] * len(trace.time_s),
    )


def save_arrays(path: Path, trace: Trace, robot: RobotModel) -> None:
    """Write ``simulation.npz``: state, torques, forces and ZMP at the times of the commands, without pickles."""
    write_arrays(
        path,
        {
            "schema": np.array("imitor-simulation-1"),
            "robot": np.array(robot.name),
            "time_s": trace.time_s,
            "joint_names": np.array(list(robot.joint_names)),
            "joint_position_rad": trace.q[:, BASE_NQ:],
            "root_position_m": trace.q[:, :3],
            "root_quaternion_wxyz": trace.q[:, [6, 3, 4, 5]],
            "torque_nm": trace.torque,
            "peak_torque_nm": trace.peak_torque,
            "zmp_m": trace.zmp,
            "vertical_force_n": trace.force,
            "object_shift_m": trace.object_shift,
            "held_object": trace.held,
            "fallen": np.arange(len(trace.time_s))
            >= (len(trace.time_s) if trace.fall is None else trace.fall.frame),
        },
    )


class Film:
    """Renders the executed motion beside the human.

    Args:
        robot: The robot.
        motion: What it did.
        reference: The human, frame by frame as the motion.
        size: Width and height of the pictures [px].
        fps: Pictures per second, at most those of the motion [Hz].
        environment: Objects around the robot.

    Raises:
        SinkError: No picture can be rendered here.
    """

    def __init__(
        self,
        robot: RobotModel,
        motion: Motion,
        reference: Reference,
        size: tuple[int, int],
        fps: float,
        environment: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        from imitor.visual.clip import rows_at
        from imitor.visual.studio import Studio

        rows = rows_at(motion.time_s, fps)[:_MOST_PICTURES]
        self._size = size
        self._studio: Studio = Studio(robot, motion, reference, rows, size=size, environment=environment)

    def save_gif(self, path: Path) -> None:
        """Write all pictures, with the colours of three of them for all."""
        from PIL import Image

        studio = self._studio
        chosen = sorted({0, len(studio) // 2, len(studio) - 1})
        palette = Image.fromarray(np.concatenate([studio.picture(i) for i in chosen])).quantize(256)
        images: list[Any] = [
            Image.fromarray(studio.picture(i)).quantize(palette=palette, dither=Image.Dither.NONE)
            for i in range(len(studio))
        ]
        images[0].save(
            path,
            save_all=True,
            append_images=images[1:],
            duration=self._durations_ms(),
            loop=0,
            optimize=False,
        )

    def _durations_ms(self) -> list[int]:
        """Return how long each picture stays; a .gif counts in hundredths of a second."""
        times = self._studio.time_s - self._studio.time_s[0]
        step = float(times[-1]) / (len(times) - 1) if len(times) > 1 else 1.0
        return [10 * int(d) for d in np.diff(np.round(100.0 * np.append(times, times[-1] + step)))]

    def save_sheet(self, path: Path, title: str) -> None:
        """Write a few pictures side by side."""
        from imitor.visual.sheet import contact_sheet, tile_size

        studio, (columns, rows) = self._studio, _SHEET
        count = min(columns * rows, len(studio))
        columns = min(columns, count)
        studio.resize(tile_size(self._size, columns, _SHEET_WIDTH))
        chosen: Sequence[int] = np.linspace(0, len(studio) - 1, count).round().astype(int).tolist()
        pictures, times = [studio.picture(i) for i in chosen], [float(studio.time_s[i]) for i in chosen]
        contact_sheet(pictures, times, title, columns, _SHEET_WIDTH).save(path)

    def close(self) -> None:
        """Free the graphics memory; safe to call again."""
        self._studio.close()
