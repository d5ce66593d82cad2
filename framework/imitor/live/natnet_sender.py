"""Messages of NatNet for human frames: frames, and the answers to what a client asks."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imitor.live.natnet import (
    CONNECT,
    FRAME,
    KEEPALIVE,
    MODELDEF,
    REQUEST_MODELDEF,
    SERVERINFO,
    UNRECOGNIZED,
    Version,
    message,
    opened,
    who,
)
from imitor.live.natnet_frame import BODY, TRACKED
from imitor.live.quaternions import quaternions
from imitor.live.sample import BadDatagram
from imitor.motion.normalise import UP_AXES
from imitor.types import N_ROLES, ROLE_INDEX, SIDES, Array, HumanFrame, Skeleton

_TRUNK: Final = (
    ("Hip", "", "pelvis"),
    ("Ab", "Hip", ""),
    ("Chest", "Ab", "chest"),
    ("Neck", "Chest", "neck"),
    ("Head", "Neck", "head"),
)
_ARM: Final = (("Shoulder", ""), ("UArm", "shoulder"), ("FArm", "elbow"), ("Hand", "wrist"))
_LEG: Final = (("Thigh", "hip"), ("Shin", "knee"), ("Foot", "ankle"), ("Toe", "toe"))


def _limbs() -> list[tuple[str, str, str]]:
    out = []
    for begin, limb in (("Chest", _ARM), ("Hip", _LEG)):
        for side in SIDES:
            above = begin
            for bone, role in limb:
                name = side[0].upper() + bone
                out.append((name, above, f"{side}_{role}" if role else ""))
                above = name
    return out


_BONES: Final = (*_TRUNK, *_limbs())
"""Motive's bones: name, parent and role of each; those without a role are put between others."""
_NAMES: Final = [name for name, _, _ in _BONES]
_PARENT: Final = [_NAMES.index(above) if above else -1 for _, above, _ in _BONES]
_ROLE: Final = [ROLE_INDEX[role] if role else -1 for _, _, role in _BONES]
_AB, _COLLARS, _COLLAR = _NAMES.index("Ab"), (_NAMES.index("LShoulder"), _NAMES.index("RShoulder")), 0.2
NUMBER: Final = 1
"""Number of the skeleton."""
_FROM_OURS: Final = np.array(UP_AXES["y"], dtype=np.float64).T
_NONE: Final = (0, b"")
_LATER: Final = ((2, 3), (2, 9), (2, 11), (4, 1))
"""Versions from which on a frame has labelled markers, force plates, devices, assets."""
_CENTRE_HZ: Final = 10_000_000
_PORT: Final = 1511


class NatNetEncoder:
    """Makes the messages of a server with one skeleton of Motive's bones, and its markers, y up, in the world's axes.

    A frame is preceded once a second by version and model, for those who cannot ask. A bone that a frame does
    not know is sent as not tracked.

    Args:
        skeleton: The person.
        rate_hz: Instants a second [Hz].
        version: The version to speak, from 2.6 on.
        bones: Whether the skeleton is sent, or the markers alone.
    """

    def __init__(
        self, skeleton: Skeleton, rate_hz: float, version: Version = (3, 1), *, bones: bool = True
    ) -> None:
        self._version, self._every = version, max(round(rate_hz), 1)
        self._name, self._labels = skeleton.name, skeleton.marker_names
        rest = _FROM_OURS @ _places(skeleton.rest_position)[..., None]
        self._kept = [i for i in range(len(_NAMES)) if bones and np.isfinite(rest[i]).all()]
        self._info = message(SERVERINFO, _server_info(version))
        self._model = message(MODELDEF, self._description(skeleton.name, rest[..., 0]))
        self._ids = np.array([NUMBER << 16 | i + 1 for i in self._kept])

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return the datagrams of one instant.

        Args:
            frame: The person, with orientations.
            counter: The sender's count of instants.
        """
        told = [] if counter % self._every else [self._info, self._model]
        return [*told, message(FRAME, self._frame(frame, counter))]

    def answer(self, datagram: bytes) -> Sequence[bytes]:
        """Return what is to be sent back to a client that sent this datagram; nothing to what is no request."""
        try:
            number, _ = opened(datagram)
        except BadDatagram:
            return ()
        known = {CONNECT: (self._info,), REQUEST_MODELDEF: (self._model,), KEEPALIVE: (), -1: ()}
        return known.get(number, (message(UNRECOGNIZED),))

    def _frame(self, frame: HumanFrame, counter: int) -> bytes:
        turn = np.full((N_ROLES, 3, 3), np.nan) if frame.orientation is None else frame.orientation
        place, turn = _places(frame.position), turn[_ROLE]
        turn[_AB] = turn[0]
        for i in range(1, len(turn)):  # collars turn with the chest, toes of some recordings with the foot
            if _ROLE[i] < 0 or np.isnan(turn[i, 0, 0]):
                turn[i] = turn[_PARENT[i]]
        q = quaternions(_FROM_OURS @ turn @ _FROM_OURS.T)[self._kept]
        place = (_FROM_OURS @ place[self._kept][..., None])[..., 0]
        lost = ~(np.isfinite(place).all(axis=1) & np.isfinite(q).all(axis=1))
        place[lost], q[lost] = 0.0, (1.0, 0.0, 0.0, 0.0)
        bodies = np.zeros(len(place), BODY)
        bodies["id"], bodies["position"], bodies["params"] = self._ids, place, np.where(lost, 0, TRACKED)
        bodies["quaternion"] = q[:, [1, 2, 3, 0]]
        one = struct.pack("<ii", NUMBER, len(bodies)) + self._bodies(bodies)
        skeletons = (1, one) if self._kept else _NONE
        sets = (1, self._marker_set(frame)) if self._labels else _NONE
        # Marker sets, unlabelled markers, rigid bodies, skeletons; then of later versions what is never sent.
        sections = [sets, _NONE, _NONE, skeletons]
        sections += [_NONE for since in _LATER if self._version >= since]
        out = struct.pack("<i", counter & 0x7FFFFFFF)
        for n, content in sections:
            out += (
                struct.pack("<i", n)
                + (struct.pack("<I", len(content)) if self._version >= (4, 1) else b"")
                + content
            )
        return out + self._suffix(frame.time_s)

    def _marker_set(self, frame: HumanFrame) -> bytes:
        place = (
            np.full((len(self._labels), 3), np.nan) if frame.marker is None else frame.marker @ _FROM_OURS.T
        )
        told = np.nan_to_num(place, nan=0.0).astype("<f4")  # a lost marker is at the origin
        return self._name.encode() + b"\0" + struct.pack("<i", len(told)) + told.tobytes()

    def _bodies(self, bodies: NDArray[np.void]) -> bytes:
        if self._version >= (3, 0):
            return bodies.tobytes()
        # Before 3.0 the markers of a body come before its error.
        split = BODY.itemsize - 6
        pieces = (raw for b in bodies for raw in (b.tobytes(),))
        return b"".join(raw[:split] + struct.pack("<i", 0) + raw[split:] for raw in pieces)

    def _suffix(self, time_s: float) -> bytes:
        v = self._version
        out = struct.pack("<II", 0, 0) + struct.pack("<d" if v >= (2, 7) else "<f", time_s)
        ticks = round(time_s * _CENTRE_HZ)
        out += struct.pack("<QQQ", ticks, ticks, ticks) if v >= (3, 0) else b""
        out += struct.pack("<II", 0, 0) if v >= (4, 1) else b""
        return out + struct.pack("<hi", 0, 0)

    def _description(self, name: str, rest: Array) -> bytes:
        v = self._version
        bones = b""
        for i in self._kept:
            above = _PARENT[i]
            offset = rest[i] - rest[above] if above >= 0 else rest[i]
            bones += _NAMES[i].encode() + b"\0" + struct.pack("<ii3f", i + 1, above + 1, *offset)
            bones += struct.pack("<4f", 0, 0, 0, 1) if v >= (4, 2) else b""
            bones += struct.pack("<i", 0) if v >= (3, 0) else b""
        sets = name.encode() + b"\0" + struct.pack("<i", len(self._labels))
        sets += b"".join(label.encode() + b"\0" for label in self._labels)
        skeleton = name.encode() + b"\0" + struct.pack("<ii", NUMBER, len(self._kept)) + bones
        told = [(0, sets)] * bool(self._labels) + [(2, skeleton)] * bool(self._kept)
        out = struct.pack("<i", len(told))
        for kind, content in told:
            out += (
                struct.pack("<i", kind) + (struct.pack("<I", len(content)) if v >= (4, 1) else b"") + content
            )
        return out


def _server_info(version: Version) -> bytes:
    out = who("imitor", version)
    if version >= (3, 0):
        out += struct.pack("<QHB4B", _CENTRE_HZ, _PORT, 0, 0, 0, 0, 0)
    return out


def _places(position: Array) -> Array:
    """Return origins of the bones, shape (B, 3), from role positions."""
    out = position[_ROLE]
    pelvis, chest, neck = (position[ROLE_INDEX[r]] for r in ("pelvis", "chest", "neck"))
    out[_AB] = 0.5 * (pelvis + chest)
    for i, side in zip(_COLLARS, SIDES, strict=True):
        out[i] = neck + _COLLAR * (position[ROLE_INDEX[f"{side}_shoulder"]] - neck)
    return out


__all__ = ["NatNetEncoder"]
