"""The person that markers from a socket show: learned once as a recording is, then applied to each instant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from imitor.live.body_options import as_received
from imitor.motion.frame_centres import FrameCentres, heel_down
from imitor.motion.marker_recording import MarkerLearning
from imitor.motion.marker_sets import MarkerSetFit
from imitor.motion.triples import Vector
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, SIDES, Array, BoolArray, HumanFrame, read_only


class MarkerPerson:
    """A person told as markers on the skin.

    Args:
        labels: The sender's labels.
        fit: The marker set in them.
        learned: What the first instants showed.
        first: Those instants, shape (T, M, 3) [sender's unit]; they show how the elbows bend.
    """

    def __init__(
        self, labels: Sequence[str], fit: MarkerSetFit, learned: MarkerLearning, first: Array
    ) -> None:
        self.skeleton = as_received(learned.clip.skeleton)
        self._labels, self._fit, self._learned = tuple(labels), fit, learned
        self._rotation = (learned.scale * learned.world).T
        self._centres = FrameCentres(learned.centres, learned.landmarks)
        self._known: BoolArray = np.array([r in self.skeleton.roles for r in ROLES])
        self._told: Sequence[str] = ()
        self._heels = [(s, d.tolist()) for s, d in zip(SIDES, learned.heels, strict=True) if d is not None]
        self._listen(self._labels)
        for position in first:
            self.frame(0.0, self._labels, position)
        self._first = self._centres.memory

    def reset(self) -> None:
        """Forget every instant but the first."""
        self._centres.memory = self._first

    def _listen(self, labels: Sequence[str]) -> None:
        """Find the markers in other labels; those that are not there any more are lost."""
        where = {label: i for i, label in enumerate(labels)}
        column = [where.get(label, len(labels)) for label in self._labels]
        self._told = labels
        self._columns = np.array([column[i] for i in self._fit.columns])
        self._marks = {
            n: [column[i] for i in columns]
            for n, columns in self._fit.landmarks.items()
            if n in self._learned.landmarks
        }

    def frame(self, time_s: float, labels: Sequence[str], position: Array) -> HumanFrame:
        """Return the human frame of one instant.

        Args:
            time_s: Its time [s].
            labels: The labels of the markers; the same object as before when they did not change.
            position: Where they are, shape (M, 3) [sender's unit]; NaN where lost.
        """
        if labels is not self._told:
            self._listen(labels)
        placed = np.full((len(position) + 1, 3), np.nan)  # the last row stands for markers that are not told
        placed[:-1] = position @ self._rotation
        placed[:, 2] -= self._learned.floor_m
        rows: Sequence[Vector] = placed.tolist()
        roles = self._centres.place({n: _middle(rows, at) for n, at in self._marks.items()})
        for side, down in self._heels:
            names = f"{side}_heel", f"{side}_toe", f"{side}_ankle"
            if names[0] in roles and names[1] in roles:
                heel, toe, ankle = (roles[n] for n in names)
                roles[names[0]] = heel_down(heel, toe, ankle, down)
        out = np.full((N_ROLES, 3), np.nan)
        out[[ROLE_INDEX[n] for n in roles]] = list(roles.values())
        valid: BoolArray = np.asarray(np.isfinite(out).all(axis=1) & self._known)
        out[~valid] = np.nan
        marker: Any = placed[self._columns]
        seen: BoolArray = np.asarray(np.isfinite(marker).all(axis=1))
        marker[~seen] = np.nan
        frame = HumanFrame(time_s, read_only(out), read_only(valid))
        frame.marker, frame.marker_valid = read_only(marker), read_only(seen)
        return frame


def _middle(rows: Sequence[Vector], at: Sequence[int]) -> Vector:
    if len(at) == 1:
        return rows[at[0]]
    n, points = len(at), [rows[i] for i in at]
    return sum(p[0] for p in points) / n, sum(p[1] for p in points) / n, sum(p[2] for p in points) / n


__all__ = ["MarkerPerson"]
