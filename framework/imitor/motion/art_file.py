"""Text tables of rigid 6-dof targets: ``x y z`` and a quaternion ``x y z w`` of every target, one frame a line.

There is no header, no name and no time stamp; a target that was lost is all zeros.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.marker_file import MAX_VALUES
from imitor.motion.text_file import read_lines
from imitor.types import Array

PER_TARGET: Final = 7
_UNIT_TOLERANCE: Final = 0.02

BODY_17: Final[tuple[str, ...]] = (
    "right_forearm", "left_forearm", "right_upper_arm", "left_upper_arm", "torso", "right_thigh", "left_thigh",
    "right_shoulder", "left_shoulder", "right_hand", "left_hand", "right_foot", "left_foot", "hip", "head",
    "right_shin", "left_shin",
)  # fmt: skip
"""The targets of the set of 17, in the order of its files."""


def is_target_table(path: Path) -> bool:
    """Tell from the first line whether a file is a table of 17 rigid targets."""
    with path.open("rb") as file:
        head = file.read(65536)
    if b"\0" in head:
        return False
    words = next((line.split() for line in head.decode("latin-1").splitlines() if line.strip()), [])
    if len(words) != PER_TARGET * len(BODY_17):
        return False
    try:
        row = np.array([float(w) for w in words]).reshape(-1, PER_TARGET)
    except ValueError:
        return False
    length = np.linalg.norm(row[:, 3:], axis=1)
    seen = length > 0.0
    return bool(seen.any() and (np.abs(length[seen] - 1.0) < _UNIT_TOLERANCE).all())


def read_targets(path: str | Path, targets: int) -> Array:
    """Read a table of targets.

    Args:
        path: The file.
        targets: How many targets a line has.

    Returns:
        World from target, shape (T, K, 4, 4) [file units]; NaN where a target is lost.

    Raises:
        SourceError: The file is broken; says where and why.
    """
    rows = []
    lines = [
        (i, line.split())
        for i, line in enumerate(read_lines(path, "a table of ART targets"), 1)
        if line.strip()
    ]
    if len(lines) * targets * PER_TARGET > MAX_VALUES:
        raise SourceError(path, f"{len(lines)} frames of {targets} targets are more than can be read")
    for k, (number, words) in enumerate(lines):
        if len(words) != targets * PER_TARGET:
            cut = ": the file is cut off" if k == len(lines) - 1 and k else ""
            raise SourceError(
                path, f"{len(words)} values, {targets} targets have {targets * PER_TARGET}{cut}", number
            )
        try:
            rows.append([float(w) for w in words])
        except ValueError:
            raise SourceError(path, "a value is no number", number) from None
    values = np.array(rows).reshape(len(rows), targets, PER_TARGET)
    if np.isinf(values).any():
        raise SourceError(
            path, "a value is not finite", lines[int(np.isinf(values).any(axis=(1, 2)).argmax())][0]
        )
    length = np.linalg.norm(values[..., 3:], axis=-1)
    lost = ~(length > 0.0)
    odd = ~lost & (np.abs(length - 1.0) > _UNIT_TOLERANCE)
    if odd.any():
        i, k = (int(v) for v in np.argwhere(odd)[0])
        raise SourceError(
            path, f"the quaternion of target {k + 1} has length {length[i, k]:.3f}, not 1", lines[i][0]
        )
    pose = np.zeros((len(rows), targets, 4, 4))
    pose[..., 3, 3] = 1.0
    pose[..., :3, 3] = values[..., :3]
    pose[..., :3, :3] = _matrices(values[..., 3:] / np.where(lost, 1.0, length)[..., None])
    pose[lost] = np.nan
    return pose


def _matrices(q: Array) -> Array:
    """Return rotations of quaternions x y z w, shape (..., 3, 3)."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
