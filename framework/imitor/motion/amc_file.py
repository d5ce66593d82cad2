"""Acclaim motions (AMC) on their skeleton, as a tree with channels: the form in which BVH files are read too."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError, did_you_mean
from imitor.motion.asf_file import ROOT, Asf, extrinsic, read_asf
from imitor.motion.bvh_file import Bvh
from imitor.motion.text_file import read_lines
from imitor.types import Array

MAX_FRAMES: Final = 1_000_000


def find_asf(path: str | Path, asf: str | None = None) -> Path:
    """Return the skeleton of a motion file.

    Args:
        path: The motion file.
        asf: The skeleton, when it is given; else it lies beside the motion: the one whose name the motion's name begins
            with (``02.asf`` of ``02_01.amc``), or the only one.

    Raises:
        SourceError: There is none, or several and none fits.
    """
    if asf is not None:
        return Path(asf)
    motion = Path(path)
    found = sorted(p for p in motion.parent.glob("*") if p.suffix.lower() == ".asf")
    fitting = [p for p in found if motion.stem.casefold().startswith(p.stem.casefold())]
    if fitting:
        return max(fitting, key=lambda p: len(p.stem))
    if len(found) == 1:
        return found[0]
    there = f"there are {', '.join(p.name for p in found[:6])}" if found else "there is no .asf file"
    raise SourceError(path, f"its skeleton is not beside it ({there}); set asf to the .asf file")


def read_amc(path: str | Path, asf_path: str | Path, rate_hz: float) -> Bvh:
    """Read a motion and its skeleton; lengths in metres.

    Args:
        path: The motion file.
        asf_path: Its skeleton.
        rate_hz: Frames per second, which the file does not tell [Hz].

    Raises:
        SourceError: A file is broken; says where and why.
    """
    asf = read_asf(asf_path)
    values, degrees = _frames(path, asf)
    nodes, place = asf.nodes()
    first = np.cumsum([0, *(len(n.channels) for n in nodes)])
    motion = np.zeros((len(values), int(first[-1])))
    column = 0
    for i, bone in enumerate(asf.bones):
        own = values[:, column : column + len(bone.dof)]
        column += len(bone.dof)
        at = first[place[i]]
        angles = np.zeros((len(values), 3))
        for k, dof in enumerate(bone.dof):
            if dof.startswith("r"):
                angles[:, "xyz".index(dof[1])] = np.deg2rad(own[:, k]) if degrees else own[:, k]
            else:
                axis = "xyz".index(dof[1])
                motion[:, at + axis] = asf.metres * (own[:, k] + asf.root_position[axis])
        if i == 0:
            at += 3
        if nodes[place[i]].channels:
            turn = bone.axis @ extrinsic(bone.order, angles) @ bone.axis.T
            motion[:, at : at + 3] = np.rad2deg(_zyx(turn))
    return Bvh(nodes, motion, 1.0 / rate_hz)


def _frames(path: str | Path, asf: Asf) -> tuple[Array, bool]:
    """Return the values of all bones in their order, shape (T, N), and whether angles are in degrees."""
    lines = read_lines(path, "an AMC file")
    wanted = {bone.name: len(bone.dof) for bone in asf.bones if bone.dof}
    rows: list[list[float]] = []
    frame: dict[str, list[float]] = {}
    begun, degrees, last = 0, asf.degrees, None

    def finish() -> None:
        if begun:
            missing = [name for name in wanted if name not in frame]
            if missing:
                raise SourceError(
                    path, f"the frame that begins here has no values of '{missing[0]}'"
                    + (f" and {len(missing) - 1} more bones: it is cut off" if len(missing) > 1 else ""), begun,
                )  # fmt: skip
            rows.append([v for name in wanted for v in frame[name]])

    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0].startswith(":"):
            if words[0].lower() in {":degrees", ":radians"}:
                degrees = words[0].lower() == ":degrees"
            continue
        if len(words) == 1 and words[0].isdigit():
            finish()
            if last is not None and int(words[0]) <= last:
                raise SourceError(path, f"frame {words[0]} comes after frame {last}", number)
            if len(rows) >= MAX_FRAMES:
                raise SourceError(path, f"more than {MAX_FRAMES} frames", number)
            frame, begun, last = {}, number, int(words[0])
            continue
        if not begun:
            raise SourceError(path, f"a frame begins with its number, found '{words[0][:20]}'", number)
        name = words[0]
        if name not in wanted:
            hint = did_you_mean(name, wanted)
            raise SourceError(
                path,
                f"the skeleton has no bone '{name[:30]}' that moves" + (f"; {hint}" if hint else ""),
                number,
            )
        if len(words) - 1 != wanted[name]:
            raise SourceError(
                path, f"'{name}' has {len(words) - 1} values, the skeleton says {wanted[name]}", number
            )
        try:
            frame[name] = [float(w) for w in words[1:]]
        except ValueError:
            raise SourceError(path, f"'{name}': a value is no number", number) from None
    finish()
    if not rows:
        raise SourceError(path, "the file holds no frame")
    values = np.array(rows)
    if not np.isfinite(values).all():
        raise SourceError(
            path, f"frame {int(np.argmin(np.isfinite(values).all(axis=1))) + 1}: a value is not finite"
        )
    if ROOT not in wanted:
        raise SourceError(path, "the skeleton's root does not move")
    return values, degrees


def _zyx(turn: Array) -> Array:
    """Return the angles about z, y, x of rotations R_z R_y R_x, shape (..., 3) [rad]."""
    across = np.hypot(turn[..., 0, 0], turn[..., 1, 0])
    y = np.arctan2(-turn[..., 2, 0], across)
    locked = across < 1e-9
    z = np.where(locked, 0.0, np.arctan2(turn[..., 1, 0], turn[..., 0, 0]))
    x = np.where(
        locked, np.arctan2(-turn[..., 1, 2], turn[..., 1, 1]), np.arctan2(turn[..., 2, 1], turn[..., 2, 2])
    )
    return np.stack([z, y, x], axis=-1)
