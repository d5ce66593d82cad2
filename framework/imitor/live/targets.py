"""The person that rigid targets from a socket show: learned once as a recording is, then applied to each instant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.human.markers import TARGETS
from imitor.live.body_options import as_received
from imitor.motion.target_joints import place_joints
from imitor.motion.target_recording import TargetLearning
from imitor.types import ROLES, Array, BoolArray, HumanFrame, read_only


class TargetPerson:
    """A person told as rigid targets worn on the body.

    Args:
        names: Names of the targets in the order of the sender.
        learned: What the first instants showed.
    """

    def __init__(self, names: Sequence[str], learned: TargetLearning) -> None:
        self.skeleton = as_received(learned.clip.skeleton)
        self._learned = learned
        self._order = [names.index(name) for name in TARGETS]
        self._known: BoolArray = np.array([r in self.skeleton.roles for r in ROLES])

    def frame(self, time_s: float, pose: Array) -> HumanFrame:
        """Return the human frame of one instant.

        Args:
            time_s: Its time [s].
            pose: Sender's world from target, shape (K, 4, 4) [sender's unit]; NaN where lost.
        """
        learned = self._learned
        placed = pose.copy()
        placed[:, :3, :3] = learned.world @ pose[:, :3, :3]
        placed[:, :3, 3] = learned.scale * pose[:, :3, 3] @ learned.world.T
        placed[:, 2, 3] -= learned.floor_m
        seen: BoolArray = np.asarray(np.isfinite(placed).all(axis=(1, 2)))
        placed[~seen] = np.nan
        position = place_joints(placed[self._order], learned.joints)
        valid: BoolArray = np.asarray(np.isfinite(position).all(axis=1) & self._known)
        position[~valid] = np.nan
        frame = HumanFrame(time_s, read_only(position), read_only(valid))
        frame.target, frame.target_valid = read_only(placed), read_only(seen)
        return frame


__all__ = ["TargetPerson"]
