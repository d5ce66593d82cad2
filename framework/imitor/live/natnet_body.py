"""The bones of a NatNet skeleton in our world."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.live.forward import Chain
from imitor.live.natnet_decoder import NatNetPose
from imitor.live.natnet_frame import TRACKED
from imitor.live.natnet_model import SkeletonModel
from imitor.live.quaternions import rotations
from imitor.motion.bvh_hierarchy import Node
from imitor.motion.normalise import UP_AXES
from imitor.types import Array


class NatNetBones:
    """The bones of one skeleton.

    Args:
        model: What the sender told of it.
        up: Axis of the sender that points up.
        local: Whether bones are told in their parents, not in the world.
    """

    def __init__(self, model: SkeletonModel, up: str, *, local: bool) -> None:
        numbers = [b.number for b in model.bones]
        self.names = [b.name for b in model.bones]
        self.parent = [
            numbers.index(b.parent) if b.parent in numbers and b.parent != b.number else -1
            for b in model.bones
        ]
        self._row = {number: i for i, number in enumerate(numbers)}
        self._world = np.array(UP_AXES[up], dtype=np.float64)
        self._chain = Chain(self.parent) if local else None

    def poses(self, pose: NatNetPose) -> tuple[Array, Array]:
        """Return origins, shape (S, 3) [m], and world from bone, shape (S, 3, 3); NaN where a bone is not tracked."""
        n, bodies = len(self.names), pose.bodies
        place, q = np.full((n, 3), np.nan), np.full((n, 4), np.nan)
        found = [(self._row.get(number & 0xFFFF, -1), k) for k, number in enumerate(bodies["id"].tolist())]
        rows = np.array([(row, k) for row, k in found if row >= 0], dtype=np.int_).reshape(-1, 2)
        here = rows[(bodies["params"][rows[:, 1]] & TRACKED) != 0]
        with np.errstate(invalid="ignore", over="ignore"):
            place[here[:, 0]] = bodies["position"][here[:, 1]]
            q[here[:, 0]] = bodies["quaternion"][here[:, 1]][:, [3, 0, 1, 2]]
        place[~np.isfinite(place).all(axis=1)] = np.nan
        turn = rotations(q)
        if self._chain is not None:
            self._chain.to_world(place, turn)
        return place @ self._world.T, self._world @ turn @ self._world.T

    def nodes(self, position: Array, rotation: Array) -> list[Node]:
        """Return the tree with the offsets that some instants show: the median in the parent's axes.

        Args:
            position: Origins, shape (T, S, 3) [m].
            rotation: World from bone, shape (T, S, 3, 3).
        """
        out = []
        for i, (name, above) in enumerate(zip(self.names, self.parent, strict=True)):
            offset = np.zeros(3)
            if above >= 0:
                arm = (
                    np.swapaxes(rotation[:, above], -1, -2) @ (position[:, i] - position[:, above])[..., None]
                )
                known = np.isfinite(arm[..., 0]).all(axis=1)
                offset = np.median(arm[known, :, 0], axis=0) if known.any() else np.full(3, np.nan)
            out.append(Node(name, above, offset))
        return out


def of_skeleton(poses: Sequence[NatNetPose]) -> Sequence[NatNetPose]:
    """Return the poses of the newest description, for one that changed while the person was learned."""
    return [p for p in poses if p.model.bones == poses[-1].model.bones]


__all__ = ["NatNetBones", "of_skeleton"]
