"""Support of the feet from their height over the floor, and from their speed where asked."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from imitor import Component, Config, Filter, HumanFrame, Support, hookimpl
from imitor.types import ROLE_INDEX, SIDES, Array


_BOTH = np.arange(2)


class SupportByHeightConfig(Config):
    """Options of the support filter."""

    threshold_m: float = Field(
        0.04, gt=0, description="A foot lower than this over its standing height may be in contact [m]."
    )
    points: Literal["flat", "lowest"] = Field(
        "flat", description="Which points must be low: flat, ankle and toes; lowest, one of them is enough."
    )
    hysteresis_m: float = Field(0.01, ge=0, description="A foot in contact must rise this much further to leave [m].")
    speed_m_s: float | None = Field(
        None, gt=0, description="A foot must also be slower than this to come into contact [m/s]; none: any speed."
    )
    speed_hysteresis: float = Field(
        1.5, ge=1, description="A foot in contact leaves at this multiple of speed_m_s [-]."
    )
    keep: bool = Field(True, description="Keep a support that the source knows.")


class SupportByHeight(Filter[SupportByHeightConfig]):
    """Mark a foot as in contact while its points are near the heights they have when standing flat.

    The speed is that of the lower one of ankle and toes. [pennapoubel2014] P3 (height alone), [montecillo2010] M6 (height and speed).
    """

    name = "support_by_height"
    gives = frozenset({"support"})

    def start(self) -> None:
        """Look up the points."""
        self._points = [
            [
                (ROLE_INDEX[f"{side}_{role}"], height)
                for role, height in (
                    ("ankle", self.skeleton.ankle_height_m),
                    ("toe", self.skeleton.toe_height_m),
                )
                if self.skeleton.has(f"{side}_{role}")
            ]
            for side in SIDES
        ]
        self._index = np.array([[i for i, _ in points] for points in self._points])
        self._height = np.array([[h for _, h in points] for points in self._points])
        self.reset()

    def reset(self) -> None:
        """Forget the last contact."""
        self._contact = [False, False]
        self._last: Array | None = None

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Bind the frame's support."""
        if self.config.keep and frame.support is not None:
            return frame
        config = self.config
        points = frame.position[self._index]  # (2, K, 3)
        heights = points[..., 2] - self._height
        which = heights.argmax(axis=1) if config.points == "flat" else heights.argmin(axis=1)
        height = heights[_BOTH, which]
        speed = (0.0, 0.0)
        if config.speed_m_s is not None:
            if self._last is not None:
                moved = (points - self._last)[_BOTH, heights.argmin(axis=1)]
                speed = tuple(np.sqrt((moved * moved).sum(axis=1)) / self.dt_s)
            self._last = points
        for i in range(2):
            if np.isnan(height[i]):
                continue  # not seen: as in the last frame
            stood = self._contact[i]
            low = height[i] < config.threshold_m + (config.hysteresis_m if stood else 0.0)
            slow = config.speed_m_s is None or speed[i] < config.speed_m_s * (
                config.speed_hysteresis if stood else 1.0
            )
            self._contact[i] = bool(low and slow)
        frame.support = Support(*self._contact)
        return frame


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the filter."""
    return [SupportByHeight]
