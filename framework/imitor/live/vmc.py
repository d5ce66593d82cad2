"""The VMC protocol: poses of an avatar's bones in OSC messages, several datagrams an instant.

Nothing marks an instant's last bone. Senders tell their clock or state once an instant (``/VMC/Ext/T``,
``/VMC/Ext/OK``): what came since the last time is an instant. Of a sender that does neither, or that tells its
clock before the bones, one ends also when every bone ever told has come, and of the former with the next root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from imitor.live.osc import OscReader
from imitor.live.sample import Foreign, Sample
from imitor.types import Array

BONE: Final = "/VMC/Ext/Bone/Pos"
ROOT: Final = "/VMC/Ext/Root/Pos"
TIME: Final = "/VMC/Ext/T"
STATE: Final = "/VMC/Ext/OK"

PARENT: Final[dict[str, str]] = {
    "Hips": "", "Spine": "Hips", "Chest": "Spine", "UpperChest": "Chest", "Neck": "UpperChest", "Head": "Neck",
    **{
        f"{s}{name}": above if above in ("Hips", "UpperChest") else f"{s}{above}"
        for s in ("Left", "Right")
        for name, above in (
            ("Shoulder", "UpperChest"), ("UpperArm", "Shoulder"), ("LowerArm", "UpperArm"), ("Hand", "LowerArm"),
            ("MiddleProximal", "Hand"), ("UpperLeg", "Hips"), ("LowerLeg", "UpperLeg"), ("Foot", "LowerLeg"),
            ("Toes", "Foot"),
        )
    },
}  # fmt: skip
"""Bones of Unity's humanoid that are read, and the parent of each, or where that is not told, its nearest ancestor."""
BONES: Final = tuple(PARENT)
_ROW: Final = {name: i for i, name in enumerate(BONES)}
_POSE: Final = 7


@dataclass(frozen=True, slots=True)
class VmcPose:
    """One instant, in Unity's axes: left-handed, y up, an avatar at rest faces z.

    Attributes:
        bones: Of each of `BONES` position [m] and quaternion x y z w in its parent, shape (B, 7); NaN where not told.
        root: The same of the root in the world, shape (7,).
    """

    bones: Array
    root: Array


class VmcDecoder:
    """Collects the bones of an instant."""

    def __init__(self) -> None:
        self._reader = OscReader((BONE, ROOT, TIME, STATE))
        self._root = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        self._bones: dict[int, list[float]] = {}
        self._ever: set[int] = set()
        self._clocked = False
        self._rooted = False
        self._leads = False
        self._told = False
        self._time_s = math.nan
        self._last_s = math.nan
        self._count = 0

    def reset(self) -> None:
        """Forget the bones of an instant that has not ended."""
        self._bones.clear()

    def decode(self, datagram: bytes) -> Sample | None:
        """Return the instant that ends with a datagram; see `imitor.live.sample.Decoder`.

        Messages of wrong or too few arguments are passed over, as the protocol asks.
        """
        messages = self._reader.read(datagram)
        if not messages and b"/VMC/" not in datagram:
            raise Foreign
        kinds = [address for address, _ in messages]
        clocks = [i for i, kind in enumerate(kinds) if kind in (TIME, STATE)]
        bones = [i for i, kind in enumerate(kinds) if kind == BONE]
        if clocks and bones:
            self._leads = clocks[0] < bones[0]
        last_bone = bones[-1] if bones else -1
        for i in clocks:
            if (
                i > last_bone
            ):  # this time is of the bones before it, which end with the first message of this kind
                self._set_time(*messages[i])
        sample = None
        for address, values in messages:
            sample = self._take(address, values) or sample
        return sample

    def _set_time(self, address: str, values: list[Any]) -> None:
        if address == TIME and values and isinstance(values[0], float):
            self._time_s = values[0]

    def _take(self, address: str, values: list[Any]) -> Sample | None:
        if address in (TIME, STATE):
            self._clocked = True
            sample = self._end()
            self._told = False
            self._set_time(address, values)
            return sample
        if address == ROOT:
            pose = _numbers(values[1:] if values and isinstance(values[0], str) else values)
            if pose is None:
                return None
            self._rooted = True
            sample = None if self._clocked else self._end()
            self._told = False
            self._root = np.array(pose)
            return sample
        row, pose = _ROW.get(values[0] if values and isinstance(values[0], str) else ""), _numbers(values[1:])
        early = self._leads or not self._clocked
        if row is None or pose is None or (self._told and early):
            return None
        sample = self._end() if row in self._bones and not (self._clocked or self._rooted) else None
        self._bones[row] = pose
        self._ever.add(row)
        if early and self._count and len(self._bones) == len(self._ever):
            sample = self._end()
            self._told = self._clocked or self._rooted  # what comes before the next of these is a repetition
        return sample

    def _end(self) -> Sample | None:
        """End an instant, if there is one. By the sender's clock an old one is told under an old count."""
        if not self._bones:
            return None
        bones = np.full((len(BONES), _POSE), np.nan)
        for row, pose in self._bones.items():
            bones[row] = pose
        self._bones = {}
        late_s = self._last_s - self._time_s
        if 0.0 <= late_s < 1.0:
            return Sample(self._count - (late_s > 0.0), self._time_s, VmcPose(bones, self._root))
        self._count += 1
        self._last_s = self._time_s
        return Sample(self._count, self._time_s, VmcPose(bones, self._root))


def _numbers(values: list[Any]) -> list[float] | None:
    """Return the seven numbers of a pose; ``None`` when they are not there."""
    pose = values[:_POSE]
    if len(pose) < _POSE or not all(type(v) in (float, int) for v in pose):
        return None
    return pose


__all__ = ["BONE", "BONES", "PARENT", "ROOT", "STATE", "TIME", "VmcDecoder", "VmcPose"]
