"""From datagrams of NatNet to one skeleton's instants, and what is still to be asked of the sender."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imitor.live.natnet import (
    CONNECT,
    FRAME,
    KEEPALIVE,
    MODELDEF,
    NEWEST_VERSION,
    REQUEST_MODELDEF,
    SERVERINFO,
    Version,
    message,
    opened,
    server_version,
    who,
)
from imitor.live.natnet_frame import read_frame, read_marker_sets
from imitor.live.natnet_model import Model, SkeletonModel, read_model
from imitor.live.sample import Foreign, Sample
from imitor.types import Array

ALL_MARKERS: Final = "all"
"""Motive's set of every marker there is."""
FARTHEST_M: Final = 1000.0
"""A marker beyond this is lost [m]."""


@dataclass(frozen=True, slots=True)
class NatNetPose:
    """One instant of one skeleton.

    Attributes:
        model: Its bones.
        bodies: Their poses, items of `imitor.live.natnet_frame.BODY`; numbers may have the skeleton's above 16 bits.
    """

    model: SkeletonModel
    bodies: NDArray[np.void]


@dataclass(frozen=True, slots=True)
class NatNetMarkers:
    """One instant of one marker set.

    Attributes:
        labels: Names of its markers, the same object as long as they do not change.
        position: Where they are, shape (M, 3) [m], in the sender's axes; NaN where lost.
    """

    labels: tuple[str, ...]
    position: Array


class NatNetDecoder:
    """Decodes frames once version and model are told; both may be asked for, or come by themselves.

    Args:
        wanted: Name of the skeleton or marker set to take; empty: the first.
        version: The sender's version, where it cannot be asked; ``None``: as it tells.
        markers: Whether a marker set is taken, not a skeleton.

    Attributes:
        version: What the sender told or was given.
        model: What the sender told.
        unread: Frames that came before that.
    """

    def __init__(self, wanted: str = "", version: Version | None = None, *, markers: bool = False) -> None:
        self._wanted, self._given, self._markers = wanted, version, markers
        self.version = version
        self.model: Model | None = None
        self.unread = 0
        self._changed = False
        self._chosen: SkeletonModel | None = None
        self._set = ""

    def reset(self) -> None:
        """Nothing is collected: an instant is one datagram."""

    def decode(self, datagram: bytes) -> Sample | None:
        """Return the instant in a datagram; see `imitor.live.sample.Decoder`."""
        number, content = opened(datagram)
        if number < 0:
            raise Foreign
        if number == SERVERINFO:
            told = server_version(content)
            self.version = self._given or told
        elif number == MODELDEF and self.version is not None:
            self.model = read_model(content, self.version)
            self._changed = False
            self._choose(self.model)
        elif number == FRAME:
            return self._frame(content)
        return None

    def _choose(self, model: Model) -> None:
        of_name = [s for s in model.skeletons if self._wanted in ("", s.name)]
        self._chosen = of_name[0] if of_name else None
        sets = [s for s in model.marker_sets if self._wanted == s or not (self._wanted or s == ALL_MARKERS)]
        self._set = sets[0] if sets else ""

    def _frame(self, content: bytes) -> Sample | None:
        if self.version is None or self.model is None:
            self.unread += 1
            return None
        frame = read_frame(content, self.version)
        self._changed |= frame.models_changed
        if self._markers:
            body = self._marker_set(content, self.model, self.version)
            return None if body is None else Sample(frame.number, frame.time_s, body)
        if self._chosen is None or self._chosen.number not in frame.skeletons:
            self.unread += 1
            return None
        bodies = frame.skeletons[self._chosen.number]
        return Sample(frame.number, frame.time_s, NatNetPose(self._chosen, bodies))

    def _marker_set(self, content: bytes, model: Model, version: Version) -> NatNetMarkers | None:
        told, labels = read_marker_sets(content, version).get(self._set), model.marker_sets.get(self._set, ())
        if told is None or len(told) != len(labels):
            self.unread += 1
            return None
        with np.errstate(invalid="ignore"):
            position = told.astype(np.float64)
            lost = ~(np.abs(position) < FARTHEST_M).all(axis=1) | (position == 0.0).all(axis=1)
        position[lost] = np.nan
        return NatNetMarkers(labels, position)

    def requests(self) -> Sequence[bytes]:
        """Return what is to be sent to the sender now: what is not known is asked for, and that somebody listens."""
        if self.version is None:
            return (message(CONNECT, who("imitor", NEWEST_VERSION)),)
        alive = message(KEEPALIVE)
        return (alive, message(REQUEST_MODELDEF)) if self.model is None or self._changed else (alive,)

    def lacking(self) -> str:
        """Return why frames that came could not be read, and a remedy; empty when none came in vain."""
        if not self.unread:
            return ""
        came = f"{self.unread} frames came, but "
        if self.version is None:
            return (
                came + "the sender did not tell its version: set server to the address of Motive, or version"
            )
        if self.model is None:
            return came + "the sender did not describe its skeletons: set server to the address of Motive"
        if self._markers:
            sets = ", ".join(f"'{s}'" for s in self.model.marker_sets) or "none"
            return (
                came
                + f"without markers of a set that is described ({sets}): tick Labeled Markers in Motive, or set asset"
            )
        names = ", ".join(f"'{s.name}'" for s in self.model.skeletons)
        if not names:
            return came + "without a skeleton: create one in Motive, and tick Skeletons under Streaming"
        if self._chosen is None:
            return came + f"no skeleton is called '{self._wanted}'; there are {names}"
        return came + f"without the skeleton '{self._chosen.name}': tick Skeletons under Streaming in Motive"


__all__ = ["NatNetDecoder", "NatNetMarkers", "NatNetPose"]
