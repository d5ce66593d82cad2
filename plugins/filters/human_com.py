"""Centre of mass of the human from segment masses and whatever roles are known."""

from __future__ import annotations

from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from imitor import Config, Filter, HumanFrame, hookimpl
from imitor.human import masses
from imitor.types import SIDES, Array, BoolArray, read_only

_REMEMBERED: Final = 4096
"""Patterns of validity whose weights are kept; a capture with random losses makes many."""


class HumanComConfig(Config):
    """Which mass table."""

    model: Literal["auto", "deleva", "winter"] = Field(
        "auto",
        description="Mass table: deleva (de Leva 1996, for skeletons with wrists and toes), winter "
        "(Winter's, for the 15 points of a depth camera), or auto by the skeleton's roles [-].",
    )
    keep: bool = Field(True, description="Keep a CoM that the source delivers itself [-].")


class HumanCom(Filter[HumanComConfig]):
    """Add the human's CoM from segment masses of the roles that are known.

    The CoM is linear in the role positions, ``w @ position`` [deleva1996, winter2009]; the weights depend
    only on which roles are known and are computed when that changes. While the trunk is lost the last CoM is
    held.
    """

    name = "human_com"
    gives: ClassVar[frozenset[str]] = frozenset({"com"})

    model: str
    """The table in use, ``deleva`` or ``winter``; set by `start`."""

    def start(self) -> None:
        """Choose the mass table."""
        model = self.config.model
        if model == "auto":
            full = any(
                self.skeleton.has(f"{s}_wrist")
                and (self.skeleton.has(f"{s}_toe") or self.skeleton.has(f"{s}_toe_tip"))
                for s in SIDES
            )
            model = "deleva" if full else "winter"
        self.model = model
        self._segments = masses.deleva(self.skeleton.sex) if model == "deleva" else masses.winter()
        self.reset()

    def reset(self) -> None:
        """Forget the last CoM."""
        self._weights: dict[bytes, tuple[NDArray[np.intp], Array] | None] = {}
        self._last: Array | None = None

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Return the frame with its CoM [m]."""
        if frame.com is not None and self.config.keep:
            return frame
        key = frame.valid.tobytes()
        try:
            known = self._weights[key]
        except KeyError:
            known = self._prepare(key, frame.valid)
        if known is not None:
            roles, weights = known
            self._last = weights @ frame.position[roles]
            read_only(self._last)
        frame.com = self._last
        return frame

    def _prepare(self, key: bytes, valid: BoolArray) -> tuple[NDArray[np.intp], Array] | None:
        """Compute the weights for a pattern of validity, without zeros: those roles' positions may be NaN."""
        w = masses.weights(self._segments, valid)
        known = None
        if w is not None:
            roles = np.flatnonzero(w)
            known = (roles, w[roles])
        if len(self._weights) >= _REMEMBERED:
            self._weights.clear()
        self._weights[key] = known
        return known


@hookimpl
def imitor_components() -> list[type[HumanCom]]:
    """Register the filter."""
    return [HumanCom]
