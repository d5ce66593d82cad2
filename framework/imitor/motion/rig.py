"""A file's tree with the roles placed in it: only what the roles need is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from imitor.motion.bvh_hierarchy import Node
from imitor.motion.kinematics import Poses, ancestry, forward_kinematics
from imitor.motion.normalise import middle
from imitor.motion.skeletons import RolePoint
from imitor.types import N_ROLES, ROLE_INDEX, Array


class Rig:
    """The nodes that roles need, and their ancestors.

    Attributes:
        points: Role to place in the tree.
        chain: Indices of the nodes in the file's tree, parents before children, shape (W,).
        parent: Row of each node's parent in ``chain``; -1 for the root, which is row 0.
        turn: Role to the row whose rotation is the role's.
    """

    def __init__(self, nodes: Sequence[Node], points: Mapping[str, RolePoint]) -> None:
        self._nodes = nodes
        self.points = points
        wanted = {i for p in points.values() for i in (p.start, p.end, p.turns_with)}
        self.chain = ancestry(nodes, wanted | {0})
        row = {node: i for i, node in enumerate(self.chain)}
        self.parent = [row.get(nodes[node].parent, -1) for node in self.chain]
        self.turn = {name: row[point.turns_with] for name, point in points.items()}
        self._ends = {name: (row[p.start], row[p.end], p.at) for name, p in points.items()}

    def poses(self, motion: Array, world: Array) -> Poses:
        """Return the poses of the chain over time.

        Args:
            motion: Channel values, shape (T, C).
            world: Rotation from the file's world to the one wanted, shape (3, 3).
        """
        poses = forward_kinematics(self._nodes, motion, self.chain)
        return Poses(poses.node, poses.position @ world.T, world @ poses.rotation)

    def roles(self, position: Array) -> Array:
        """Return role positions, shape (T, R, 3), from positions of the chain, shape (T, W, 3).

        The pelvis is the middle of the hips, unless its place is a line of its own.
        """
        out = np.full((len(position), N_ROLES, 3), np.nan)
        for name, (start, end, at) in self._ends.items():
            place = position[:, start]
            if start != end:
                place = place + at * (position[:, end] - place)
            out[:, ROLE_INDEX[name]] = place
        start, end, _ = self._ends["pelvis"]
        if start == end:
            out[:, ROLE_INDEX["pelvis"]] = middle(out, "hip")
        return out
