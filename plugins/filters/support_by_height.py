"""Support of the feet from their height over the floor, and from their speed where asked."""

from __future__ import annotations

from collections import deque
from math import dist, inf
from typing import Any, Literal

from pydantic import Field

from imitor import Component, Config, Filter, HumanFrame, Support, hookimpl
from imitor.types import ROLE_INDEX, SIDES


class SupportByHeightConfig(Config):
    """Options of the support filter."""

    threshold_m: float = Field(
        0.04, gt=0, description="A foot lower than this over its standing height may be in contact [m]."
    )
    points: Literal["flat", "lowest"] = Field(
        "flat", description="Which points must be low: flat, ankle and toes; lowest, one of them is enough."
    )
    hysteresis_m: float = Field(
        0.01, ge=0, description="A foot in contact must rise this much further to leave [m]."
    )
    speed_m_s: float | None = Field(
        None,
        gt=0,
        description="A foot must also be slower than this to come into contact [m/s]; none: any speed.",
    )
    speed_hysteresis: float = Field(
        1.5, ge=1, description="A foot in contact leaves at this multiple of speed_m_s [-]."
    )
    window_s: float = Field(
        0.06, ge=0, description="Time over which the speed is taken, so that noise is not speed [s]."
    )
    dwell_s: float = Field(
        0.05,
        ge=0,
        description="A foot that has come into contact or left it stays so for at least this long [s].",
    )
    keep: bool = Field(True, description="Keep a support that the source knows.")


class SupportByHeight(Filter[SupportByHeightConfig]):
    """Mark a foot as in contact while its points are near the heights they have when standing flat.

    The speed is that of the lower one of ankle and toes. Height alone is [pennapoubel2014] section III-A, height
    and speed [montecillo2010].
    """

    name = "support_by_height"
    gives = frozenset({"support"})

    def start(self) -> None:
        """Look up the points."""
        heights = {"ankle": self.skeleton.ankle_height_m, "toe": self.skeleton.toe_height_m}
        self._points = [
            [
                (ROLE_INDEX[f"{side}_{role}"], h)
                for role, h in heights.items()
                if self.skeleton.has(f"{side}_{role}")
            ]
            for side in SIDES
        ]
        self.reset()

    def reset(self) -> None:
        """Forget the last contact."""
        self._contact, self._seen = [False, False], [False, False]
        self._since = [inf, inf]
        frames = max(1, round(self.config.window_s / self.dt_s))
        self._past: list[deque[list[list[float]]]] = [deque(maxlen=frames), deque(maxlen=frames)]

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Bind the frame's support."""
        if self.config.keep and frame.support is not None:
            return frame
        for i, points in enumerate(self._points):
            if points and all(frame.valid[k] for k, _ in points):  # else not seen: as in the last frame
                now = [frame.position[k].tolist() for k, _ in points]
                stands = self._stands(i, now, [p[2] - h for p, (_, h) in zip(now, points, strict=True)])
                self._since[i] += self.dt_s
                self._seen[i] = True
                if stands != self._contact[i] and self._since[i] >= self.config.dwell_s:
                    self._contact[i], self._since[i] = stands, 0.0
                self._past[i].append(now)
        left, right = (stands or not seen for stands, seen in zip(self._contact, self._seen, strict=True))
        frame.support = Support(left, right)  # a foot that was never seen stands
        return frame

    def _stands(self, foot: int, now: list[list[float]], heights: list[float]) -> bool:
        """Decide for one foot from its points, shape (K, 3) [m], and their heights over standing [m]."""
        config, stood = self.config, self._contact[foot]
        height = max(heights) if config.points == "flat" else min(heights)
        if height >= config.threshold_m + (config.hysteresis_m if stood else 0.0):
            return False
        past = self._past[foot]
        if config.speed_m_s is None or not past:
            return True
        lowest = heights.index(min(heights))
        speed = dist(now[lowest], past[0][lowest]) / (len(past) * self.dt_s)
        return speed < config.speed_m_s * (config.speed_hysteresis if stood else 1.0)


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the filter."""
    return [SupportByHeight]
