"""DTrack's ASCII datagrams: lines of rigid bodies and human models to numbers, and back.

A datagram is text: lines of a name and values, the values in blocks ``[...]``. Lengths are millimetres, a matrix stands
column by column and leads from the body to the room, angles are degrees with R = Rx(η) Ry(θ) Rz(φ).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from imitor.live.sample import Foreign, Malformed
from imitor.types import Array

_BLOCK: Final = re.compile(r"\[([^\[\]]*)\]")
_ROTATION: Final = 0.02
"""How far a matrix may be from a rotation: it was rounded on the way [-]."""
FARTHEST_MM: Final = 1e6


@dataclass(frozen=True, slots=True)
class ArtFrame:
    """What one datagram tells; what was not tracked is not there.

    Attributes:
        counter: Frame counter.
        time_s: Seconds since midnight or 1970 [s]; NaN when not told.
        bodies: Room from body by id, shape (4, 4) [mm].
        humans: Room from joint by id, of human models by their id [mm].
    """

    counter: int
    time_s: float
    bodies: Mapping[int, Array]
    humans: Mapping[int, Mapping[int, Array]]


def read_art(datagram: bytes) -> ArtFrame:
    """Read a datagram. Lines of other names, and surplus values in a block, are left out.

    Raises:
        Foreign: It is no text with a frame counter.
        Malformed: A line contradicts itself, or a value is no number.
    """
    try:
        text = datagram.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError:
        raise Foreign from None
    parted = (line.strip().partition(" ") for line in text.split("\n"))
    lines = {name: rest for name, _, rest in parted if name}
    if "fr" not in lines:
        raise Foreign
    counter = _whole(lines["fr"])
    bodies = dict(_poses(_blocks(lines["6d"]), _count(lines["6d"], 0))) if "6d" in lines else {}
    humans = dict(_humans(lines["6dj"])) if "6dj" in lines else {}
    return ArtFrame(counter, _time(lines), bodies, humans)


def _time(lines: Mapping[str, str]) -> float:
    if "ts2" in lines:
        words = lines["ts2"].split()
        if len(words) < 2:
            raise Malformed
        return _whole(words[0]) + 1e-6 * _whole(words[1])
    return _floats(lines["ts"], 1)[0] if "ts" in lines else math.nan


def _count(rest: str, which: int) -> int:
    """Return one of the counts that stand before the blocks of a line."""
    words = rest.partition("[")[0].split()
    if len(words) <= which:
        raise Malformed
    return _whole(words[which])


def _blocks(rest: str) -> list[str]:
    return _BLOCK.findall(rest)


def _humans(rest: str) -> Iterator[tuple[int, dict[int, Array]]]:
    blocks, at = _blocks(rest), 0
    for _ in range(min(_count(rest, 1), len(blocks) + 1)):
        if at >= len(blocks):
            raise Malformed
        human, joints = (_whole(w) for w in _words(blocks[at], 2))
        at += 1
        if 3 * joints > len(blocks) - at:
            raise Malformed
        yield human, dict(_poses(blocks[at : at + 3 * joints], joints))
        at += 3 * joints


def _poses(blocks: Sequence[str], count: int) -> Iterator[tuple[int, Array]]:
    """Yield id and pose of what is tracked, of ``[id quality][x y z ...][9 values]`` each."""
    if len(blocks) != 3 * count:
        raise Malformed
    ids, places, turns = [], [], []
    for i in range(0, len(blocks), 3):
        name, quality = _words(blocks[i], 2)
        ident = _whole(name)
        place, turn = _floats(blocks[i + 1], 3), _floats(blocks[i + 2], 9)
        if _floats(quality, 1)[0] >= 0.0 and max(map(abs, place)) < FARTHEST_MM:
            ids.append(ident)
            places.append(place)
            turns.append(turn)
    if not ids:
        return
    pose = np.zeros((len(ids), 4, 4))
    pose[:, 3, 3] = 1.0
    pose[:, :3, 3] = places
    # Column by column.
    pose[:, :3, :3], sound = _rotations(np.swapaxes(np.array(turns).reshape(-1, 3, 3), 1, 2))
    for i in np.flatnonzero(sound).tolist():
        yield ids[i], pose[i]


def _rotations(R: Array) -> tuple[Array, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    """Return the nearest rotations of matrices that were rounded, and which of them are rotations at all."""
    eye = np.eye(3)
    with np.errstate(over="ignore", invalid="ignore"):
        sound = (np.abs(np.swapaxes(R, 1, 2) @ R - eye).max(axis=(1, 2)) < _ROTATION) & (np.linalg.det(R) > 0)
    R = np.where(sound[:, None, None], R, eye)
    for _ in range(3):  # Newton's steps to the polar factor: each squares the error
        R = 1.5 * R - 0.5 * R @ np.swapaxes(R, 1, 2) @ R
    return R, sound


def _words(text: str, n: int) -> list[str]:
    words = text.split(None, n)[:n]
    if len(words) < n:
        raise Malformed
    return words


def _whole(text: str) -> int:
    text = text.strip()
    if not text.isdecimal() or len(text) > 18:
        raise Malformed
    return int(text)


def _floats(text: str, n: int) -> list[float]:
    try:
        values = [float(w) for w in _words(text, n)]
    except ValueError:
        raise Malformed from None
    if not math.isfinite(sum(values)):
        raise Malformed
    return values


def write_art(frame: ArtFrame, bodies: int = 0) -> bytes:
    """Write a datagram with bodies, or with human models when there are any.

    Args:
        frame: What to tell.
        bodies: How many bodies are calibrated.
    """
    lines = [f"fr {frame.counter}", f"ts {frame.time_s:.6f}"]
    if not frame.humans:
        lines.append(f"6dcal {bodies}")
        lines.append(f"6d {len(frame.bodies)} " + " ".join(_written(frame.bodies)))
    else:
        told = [f"[{h} {len(joints)}]" + "".join(_written(joints)) for h, joints in frame.humans.items()]
        lines.append(f"6dj {len(told)} {len(told)} " + " ".join(told))
    return ("\r\n".join(lines) + "\r\n").encode("ascii")


def _written(poses: Mapping[int, Array]) -> Iterator[str]:
    for ident, pose in poses.items():
        R = pose[:3, :3]
        eta, theta, phi = (
            math.degrees(a)
            for a in (
                math.atan2(-R[1, 2], R[2, 2]),
                math.asin(min(max(R[0, 2], -1.0), 1.0)),
                math.atan2(-R[0, 1], R[0, 0]),
            )
        )
        place = " ".join(f"{v:.3f}" for v in pose[:3, 3].tolist())
        turn = " ".join(f"{v:.6f}" for v in R.T.ravel().tolist())
        yield f"[{ident} 1.000][{place} {eta:.4f} {theta:.4f} {phi:.4f}][{turn}]"


__all__ = ["ArtFrame", "read_art", "write_art"]
