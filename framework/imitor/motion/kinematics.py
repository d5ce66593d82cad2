"""Forward kinematics of a whole clip, vectorised over time, one joint after the other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from imitor.motion.bvh_hierarchy import Node
from imitor.types import Array

_AXIS = {"X": 0, "Y": 1, "Z": 2}


@dataclass(frozen=True)
class Poses:
    """Positions and rotations of some nodes over time, in the file's world.

    Attributes:
        node: Indices of the nodes, shape (W,).
        position: Shape (T, W, 3) [file units].
        rotation: World from node axes, shape (T, W, 3, 3). An End Site turns with its parent.
    """

    node: Sequence[int]
    position: Array
    rotation: Array


def ancestry(nodes: Sequence[Node], wanted: Iterable[int]) -> list[int]:
    """Return the nodes wanted and all their ancestors, parents before children."""
    needed = set[int]()
    for node in wanted:
        i = node
        while i >= 0 and i not in needed:
            needed.add(i)
            i = nodes[i].parent
    return sorted(needed)


def forward_kinematics(nodes: Sequence[Node], motion: Array, wanted: Iterable[int] | None = None) -> Poses:
    """Return the poses of nodes over time.

    Rotation channels are intrinsic in the listed order: ``Zrotation Xrotation Yrotation`` means R_z R_x R_y.
    Position channels replace the offset, each its own axis.

    Args:
        nodes: The tree, parents before children.
        motion: Channel values, shape (T, C) [file units, degrees].
        wanted: The nodes asked for; all by default. Only they and their ancestors are computed.
    """
    chosen = list(range(len(nodes)) if wanted is None else wanted)
    first = np.cumsum([0, *(len(n.channels) for n in nodes)])
    frames = len(motion)
    # Time is the last axis here: every product below then runs over contiguous memory.
    position: dict[int, Array] = {}
    rotation: dict[int, Array] = {}
    for i in ancestry(nodes, chosen):
        node = nodes[i]
        values = np.ascontiguousarray(motion[:, first[i] : first[i + 1]].T)
        place = np.repeat(node.offset[:, None], frames, axis=1)
        turn = rotation[node.parent] if node.parent >= 0 else np.repeat(np.eye(3)[:, :, None], frames, axis=2)
        turned = turn
        for channel, value in zip(node.channels, values, strict=True):
            axis = _AXIS[channel[0]]
            if channel.endswith("position"):
                place[axis] = value
            else:
                turned = _turn(turned, axis, np.deg2rad(value))
        if node.parent >= 0:
            place = position[node.parent] + np.einsum("ijt,jt->it", turn, place)
        position[i], rotation[i] = place, turned
    return Poses(
        chosen,
        np.ascontiguousarray(np.stack([position[i] for i in chosen]).transpose(2, 0, 1)),
        np.ascontiguousarray(np.stack([rotation[i] for i in chosen]).transpose(3, 0, 1, 2)),
    )


def _turn(rotation: Array, axis: int, angle: Array) -> Array:
    """Return R · R_axis(angle), shape (3, 3, T): the product mixes the two columns beside the axis."""
    c, s = np.cos(angle), np.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    out = np.empty_like(rotation)
    out[:, axis] = rotation[:, axis]
    out[:, j] = c * rotation[:, j] + s * rotation[:, k]
    out[:, k] = c * rotation[:, k] - s * rotation[:, j]
    return out
