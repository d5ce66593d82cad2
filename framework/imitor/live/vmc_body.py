"""The person in a stream of the VMC protocol: bones in their parents to bones in our world, and the way back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from imitor.errors import ImitorError
from imitor.live.forward import Chain
from imitor.live.osc import OscWriter, bundles
from imitor.live.quaternions import quaternions, rotations
from imitor.live.vmc import BONE, BONES, PARENT, ROOT, STATE, TIME, VmcPose
from imitor.motion.bvh_hierarchy import Node
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, BoolArray, HumanFrame, Skeleton

FROM_UNITY: Final = np.array(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
"""Our axes from Unity's (x right, y up, z forward; left-handed): a reflection, under which R becomes M R Mᵀ."""
_XYZW: Final = [6, 3, 4, 5]
"""Columns of w x y z in a pose."""


class BoneTree:
    """The bones that a sender tells, and their poses in our world.

    Args:
        poses: The first instants.

    Attributes:
        nodes: The tree, parents before children; offsets in our axes [m].
    """

    def __init__(self, poses: Sequence[VmcPose]) -> None:
        all_bones = np.stack([p.bones for p in poses])
        seen: BoolArray = np.asarray(np.isfinite(all_bones).all(axis=2).any(axis=0))
        if not seen[BONES.index("Hips")]:
            raise ImitorError(
                "no bone 'Hips' was told: does the sender send an avatar's bones? Load an avatar there"
            )
        self._rows = [i for i, there in enumerate(seen) if there]
        index = {BONES[i]: k for k, i in enumerate(self._rows)}
        self._parent = [_above(BONES[i], index) for i in self._rows]
        offset = np.nanmedian(all_bones[:, self._rows, :3], axis=0) @ FROM_UNITY.T
        self.nodes = [
            Node(BONES[i], parent, offset[k])
            for k, (i, parent) in enumerate(zip(self._rows, self._parent, strict=True))
        ]
        self._chain = Chain(self._parent)

    def poses(self, pose: VmcPose) -> tuple[Array, Array]:
        """Return origins, shape (S, 3) [m], and world from bone, shape (S, 3, 3), in our world.

        Args:
            pose: One instant; what hangs on a bone that is lost is NaN.
        """
        local = np.vstack([pose.bones[self._rows], pose.root])
        turn = FROM_UNITY @ rotations(local[:, _XYZW]) @ FROM_UNITY.T
        place = local[:, :3] @ FROM_UNITY.T
        root, root_place = turn[-1], place[-1]
        turn, place = turn[:-1], place[:-1]
        place[0] = root_place + root @ place[0]
        turn[0] = root @ turn[0]
        self._chain.to_world(place, turn)
        return place, turn


def _above(name: str, index: dict[str, int]) -> int:
    above = PARENT[name]
    while above and above not in index:
        above = PARENT[above]
    return index.get(above, -1)


_ROLE: Final = {
    "Hips": "pelvis", "Chest": "chest", "Neck": "neck", "Head": "head",
    **{
        f"{s.capitalize()}{bone}": f"{s}_{name}"
        for s in SIDES
        for bone, name in (
            ("UpperArm", "shoulder"), ("LowerArm", "elbow"), ("Hand", "wrist"), ("MiddleProximal", "hand"),
            ("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toes", "toe"),
        )
    },
}  # fmt: skip
"""Bones that are sent, besides the spine, and the role of each."""


class VmcEncoder:
    """Makes the datagrams of an avatar that has the person's bones: root, bones, state and time.

    Bones that a frame does not know are not sent.

    Args:
        skeleton: The person.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self._writer = OscWriter()
        sent = ["Hips", "Spine", *(b for b in BONES if b in _ROLE and b != "Hips" and skeleton.has(_ROLE[b]))]
        index = {b: i for i, b in enumerate(sent)}
        self._names = sent
        self._parent = np.array([_above(b, index) for b in sent])
        self._role = np.array([ROLE_INDEX[_ROLE.get(b, "pelvis")] for b in sent])
        self._spine, self._chest = sent.index("Spine"), ROLE_INDEX["chest"]

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return the datagrams of one instant.

        Args:
            frame: The person, with orientations.
            counter: The sender's count of instants; the protocol has none.
        """
        turn = np.full((N_ROLES, 3, 3), np.nan) if frame.orientation is None else frame.orientation
        place, turn = frame.position[self._role], turn[self._role]
        place[self._spine] = 0.5 * (place[0] + frame.position[self._chest])
        for i in np.flatnonzero(np.isnan(turn[:, 0, 0])):
            turn[i] = turn[self._parent[i]]
        above = np.swapaxes(turn[self._parent], -1, -2)
        local = (above @ (place - place[self._parent])[..., None])[..., 0]
        bend = above @ turn
        local[0], bend[0] = place[0], turn[0]  # the hips in the root, which stays at the origin
        q = quaternions(FROM_UNITY.T @ bend @ FROM_UNITY)
        told = np.hstack([local @ FROM_UNITY, q[:, 1:], q[:, :1]])
        write = self._writer.message
        messages = [write(ROOT, "sfffffff", "root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)]
        for name, values in zip(self._names, told.tolist(), strict=True):
            if np.isfinite(values).all():
                messages.append(write(BONE, "sfffffff", name, *values))
        messages += [write(STATE, "i", 1), write(TIME, "f", frame.time_s)]
        return bundles(messages)


__all__ = ["FROM_UNITY", "BoneTree", "VmcEncoder"]
