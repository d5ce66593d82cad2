"""Tables of 22 joints as offsets in the parent and Euler angles: forward kinematics to points.

Such data come in two files: ``…positions.txt``, where only the waist is absolute, and ``…angles.txt`` in degrees. A
joint's rotation is R_z R_x R_y in its parent (found on recordings: with it planted feet stay where they are), and a
child sits at its parent's position plus the parent's rotation times its offset.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.kinect_text import OFFSET_COLUMNS
from imitor.types import Array

PARENTS: Final = (-1, 0, 1, 2, 3, 4, 2, 6, 7, 8, 2, 10, 11, 12, 0, 14, 15, 16, 0, 18, 19, 20)
"""Parent of each joint; the collars hang on the chest, the thighs on the waist."""
_WORDS: Final = (("positions", "angles"), ("Positions", "Angles"))

Table = tuple[Array, list[int]]


def chain_offsets(path: str | Path, angles_path: str | None, read: Callable[[Path], Table]) -> Array:
    """Return the joints in the sensor's world, shape (T, 22, 3) [file units].

    Args:
        path: The table of offsets, or of the angles when the offsets lie beside it.
        angles_path: The table of angles; None: found by its name.
        read: Reads a table of numbers and the line of each row.

    Raises:
        SourceError: One of the two files is missing, or they do not belong together.
    """
    given = Path(path)
    positions, angles = given, Path(angles_path) if angles_path else None
    if angles is None:
        for offset_word, angle_word in _WORDS:
            if offset_word in given.name:
                angles = given.with_name(given.name.replace(offset_word, angle_word))
            elif angle_word in given.name:
                positions, angles = given.with_name(given.name.replace(angle_word, offset_word)), given
    if angles is None:
        raise SourceError(
            path,
            "holds 22 joints as offsets in their parents, which are no points without the joint angles; "
            "give their table with --set source.angles_path=FILE",
        )
    for file in (positions, angles):
        if not file.is_file():
            raise SourceError(
                file,
                f"there is no such file; '{given.name}' holds 22 joints as offsets in their parents and needs it: "
                "put it beside, or give --set source.angles_path=FILE",
            )
    (offset, _), (angle, _) = read(positions), read(angles)
    for file, table in ((positions, offset), (angles, angle)):
        if table.shape[1] != OFFSET_COLUMNS:
            raise SourceError(file, f"has {table.shape[1]} columns; 22 joints have {OFFSET_COLUMNS}")
    if len(offset) != len(angle):
        raise SourceError(
            angles,
            f"has {len(angle)} frames, '{positions.name}' has {len(offset)}: they are of two recordings",
        )
    shape = (len(offset), len(PARENTS), 3)
    return _forward_kinematics(offset.reshape(shape), np.radians(angle.reshape(shape)))


def _forward_kinematics(offset: Array, angle: Array) -> Array:
    """Return joint positions, shape (T, J, 3), from offsets in the parents and angles about x, y, z [rad]."""
    from imitor.human.rotations import about_x, about_y, about_z

    position = np.empty_like(offset)
    rotation = np.empty((*offset.shape, 3))
    for j, parent in enumerate(PARENTS):
        x, y, z = angle[:, j].T
        own = about_z(z) @ about_x(x) @ about_y(y)
        if parent < 0:
            position[:, j], rotation[:, j] = offset[:, j], own
        else:
            position[:, j] = position[:, parent] + np.einsum("tij,tj->ti", rotation[:, parent], offset[:, j])
            rotation[:, j] = rotation[:, parent] @ own
    return position
