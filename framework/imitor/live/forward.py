"""Forward kinematics of one instant: all bones of a depth at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.types import Array


class Chain:
    """A tree of bones.

    Args:
        parent: Index of each bone's parent, shape (S,); -1 for roots. Parents stand before children.
    """

    def __init__(self, parent: Sequence[int]) -> None:
        depth = [0] * len(parent)
        for i, above in enumerate(parent):
            depth[i] = depth[above] + 1 if above >= 0 else 0
        levels = [
            [i for i, d in enumerate(depth) if d == level] for level in range(1, max(depth, default=0) + 1)
        ]
        self._levels = [(np.array(here), np.array([parent[i] for i in here])) for here in levels]

    def to_world(self, position: Array, rotation: Array) -> None:
        """Turn poses in the parent's axes, which roots have in the world's, into poses in the world, in place.

        Args:
            position: Origins, shape (S, 3).
            rotation: Parent from bone, shape (S, 3, 3).
        """
        for here, above in self._levels:
            turn = rotation[above]
            position[here] = position[above] + (turn @ position[here][..., None])[..., 0]
            rotation[here] = turn @ rotation[here]


__all__ = ["Chain"]
