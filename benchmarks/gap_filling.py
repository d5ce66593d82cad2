"""How well the filter kalman_gap_fill bridges losses, cut into complete recordings of markers:

    python benchmarks/gap_filling.py [--starts N] [--model MODEL] walk.c3d walk.trc ...

One marker after the other is lost for 0.4 s: alone (with it all markers that share a segment with it) or in company
(three or more markers of its segment stay seen). The table has the mean distance to the true place after a while, and
that of holding the last place. Without a file the performer walks.
"""

from __future__ import annotations

import argparse
import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imitor.kinds import Source
from imitor.motion.point_tracker import MODELS, PointTracker, TrackerOptions
from imitor.plugins.filters.kalman_gap_fill import companions_of
from imitor.registry import Registry
from imitor.types import Array, Skeleton

AFTER_S = (0.1, 0.2, 0.3, 0.4)
WARM_UP_S = 0.6
COMPANY = 3


@dataclass
class Errors:
    """Distances to the true places by time after the loss began, shape (N, 4) [m]."""

    filled: list[list[float]]
    held: list[list[float]]

    def row(self, name: str) -> str:
        """Return a row of the table."""
        if not self.filled:
            return f"| {name} | 0 | " + " | ".join("–" for _ in AFTER_S) + " |"
        cells = [
            f"{100 * f:.1f} ({100 * h:.1f})"
            for f, h in zip(np.mean(self.filled, axis=0), np.mean(self.held, axis=0), strict=True)
        ]
        return f"| {name} | {len(self.filled)} | " + " | ".join(cells) + " |"


def read(path: str | None) -> tuple[Skeleton, float, Array]:
    """Return skeleton, rate [Hz] and markers (T, M, 3) [m] of a recording, NaN where lost."""
    registry = Registry()
    name = "performer" if path is None else Path(path).suffix[1:].lower()
    component = registry.get("source", name)
    given = {"scenario": "walk", "markers": "41"} if path is None else {"path": path}
    source = component(component.config_type.model_validate(given))
    assert isinstance(source, Source)
    source.start()
    frames = list(source.frames())
    marker = np.array([np.where(f.marker_valid[:, None], f.marker, np.nan) for f in frames])  # type: ignore[index]
    return source.skeleton, source.rate_hz, marker


def lose(
    marker: Array, rate_hz: float, companions: list[list[list[int]]], options: TrackerOptions, starts: int
) -> tuple[Errors, Errors]:
    """Lose every marker at several times; return the errors alone and in company."""
    frames, n = marker.shape[:2]
    warm, loss = round(WARM_UP_S * rate_hz), round(max(AFTER_S) * rate_hz)
    at = [round(s * rate_hz) - 1 for s in AFTER_S]
    alone, company = Errors([], []), Errors([], [])
    everything = np.ones(n, dtype=np.bool_)
    for start in np.linspace(warm, frames - loss - 1, starts).astype(int):
        if start < warm or not np.isfinite(marker[start - warm : start + loss]).all():
            continue
        ready = PointTracker(n, 1.0 / rate_hz, companions, options)
        for k in range(start - warm, start):
            ready.update(marker[k], everything)
        for i in range(n):
            for errors, lost in (
                (alone, [i, *(j for group in companions[i] for j in group)]),
                (company, [i]),
            ):
                if errors is company and max(map(len, companions[i]), default=0) < COMPANY:
                    continue
                seen = everything.copy()
                seen[lost] = False
                tracker = copy.deepcopy(ready)
                places = [tracker.update(marker[k], seen)[0][i] for k in range(start, start + loss)]
                true = marker[start : start + loss, i]
                errors.filled.append([float(np.linalg.norm(places[a] - true[a])) for a in at])
                errors.held.append([float(np.linalg.norm(marker[start - 1, i] - true[a])) for a in at])
    return alone, company


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Errors of kalman_gap_fill in losses cut into recordings.")
    parser.add_argument("files", nargs="*", help="complete .c3d and .trc recordings")
    parser.add_argument("--starts", type=int, default=3, help="losses a marker and recording")
    parser.add_argument("--model", choices=MODELS, default=TrackerOptions().model)
    given = parser.parse_args()
    options = TrackerOptions(model=given.model)
    total = {"alone": Errors([], []), "in company": Errors([], [])}
    print(
        "| recording, mean error and (last place held) [cm] | losses | "
        + " | ".join(f"{1000 * s:.0f} ms" for s in AFTER_S)
        + " |"
    )
    print("| --- | --- | " + " | ".join("---" for _ in AFTER_S) + " |")
    for path in given.files or [None]:
        skeleton, rate_hz, marker = read(path)
        companions = companions_of(skeleton)[: marker.shape[1]]
        found = lose(marker, rate_hz, companions, options, given.starts)
        for (name, sum_), errors in zip(total.items(), found, strict=True):
            print(errors.row(f"{Path(path).name if path else 'performer'}, {name}"), flush=True)
            sum_.filled += errors.filled
            sum_.held += errors.held
    for name, errors in total.items():
        print(errors.row(f"**all, {name}**"))


if __name__ == "__main__":
    main()
