"""Section 7.2 of Montecillo-Puente et al. (ICINCO 2010): one hand up and down ever faster, and the range of the ZMP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from experiment import Case, Played, number
from montecillo_errors import SETTLED_S
from page import table
from zmp import WAYS, zmp

from imitor.simulation.verdict import EDGE_M
from imitor.types import Array
from imitor.visual.panels import BLUE, GREEN, GREY, INK, RED, Line, Panel

SCENARIO = "hand_updown"
SPEEDS = (0.3, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0)
"""Greatest speeds of the hand in every stroke [m/s]."""
STROKES_S = (3.4, 8.6)
"""When the hand goes up and down with its whole swing, from the start of the performance [s]."""
CASES = tuple(
    Case(f"hand at {v:g} m/s", scenario=SCENARIO, sets=(f"source.hand_speed_m_s={v:g}",)) for v in SPEEDS
)


@dataclass(frozen=True)
class Stroke:
    """The ZMP in one run of the moving hand.

    Attributes:
        human_m_s, robot_m_s: Greatest speed of the human's and of the robot's wrist [m/s].
        range_m: Lowest and highest ZMP by axis, shape (2, 2) [m], by each of `WAYS`; NaN where physics was not asked.
        margin_m: Least margin of the ZMP in the polygon, by each of `WAYS` [m].
        apart_m: Distance of the executed ZMP by momentum from the centre of pressure: root mean square and most,
            while both feet carry and the floor bears at least half of the weight [m].
        polygon: Lowest and highest corner of the support polygon by axis, shape (2, 2) [m].
    """

    human_m_s: float
    robot_m_s: float
    range_m: dict[str, Array]
    margin_m: dict[str, float]
    apart_m: tuple[float, float]
    polygon: Array


def stroke(p: Played) -> Stroke:
    """Measure one run of the moving hand while it goes up and down."""
    rows = (p.time_s > SETTLED_S + STROKES_S[0]) & (p.time_s < SETTLED_S + STROKES_S[1])
    soles = p.run.path.sole[rows][0].reshape(-1, 3)[:, :2]
    found = zmp(p)
    ranges, least = {}, {}
    for way in WAYS:
        used = (
            rows & np.isfinite(found.point[way]).all(axis=1) & (found.loaded if way == "executed" else True)
        )
        seen = found.point[way][used] if used.any() else np.full((1, 2), np.nan)
        ranges[way] = np.array([seen.min(axis=0), seen.max(axis=0)])
        least[way] = float(found.margin[way][used].min()) if used.any() else float("nan")
    off = np.linalg.norm(found.difference(rows & found.loaded), axis=1)
    apart = (float(np.sqrt(np.mean(off**2))), float(off.max())) if off.size else (float("nan"), float("nan"))
    wrists = (p.reference.role("right_wrist"), p.frame("right_wrist")[:, :3, 3])
    speeds = [np.linalg.norm(np.gradient(w, p.run.period_s, axis=0), axis=1)[rows] for w in wrists]
    polygon = np.array([soles.min(axis=0), soles.max(axis=0)])
    return Stroke(float(speeds[0].max()), float(speeds[1].max()), ranges, least, apart, polygon)


def strokes(played: Sequence[Played]) -> list[Stroke]:
    """Return the runs of the moving hand in order of its speed."""
    return sorted((stroke(p) for p in played if p.case.scenario == SCENARIO), key=lambda s: s.human_m_s)


def unstable_from(found: Sequence[Stroke], way: str) -> float:
    """Return the hand speed at which the ZMP reaches the edge, between two runs; NaN if in none [m/s].

    What is executed cannot leave the polygon: with the ZMP nearer than `EDGE_M` to its edge the robot tips.
    """
    edge = EDGE_M if way in WAYS[2:] else 0.0
    for a, b in pairwise(found):
        low, high = a.margin_m[way] - edge, b.margin_m[way] - edge
        if low > 0.0 >= high:
            return a.human_m_s + (b.human_m_s - a.human_m_s) * low / (low - high)
    return float("nan")


def told_unstable(found: Sequence[Stroke]) -> str:
    """Return by each way the hand speed at which the robot becomes unstable, as text."""
    out = []
    for way in WAYS:
        if np.isfinite(found[0].margin_m[way]):
            v = unstable_from(found, way)
            last = number(found[-1].human_m_s)
            out.append(f"{way}: {number(v)} m/s" if np.isfinite(v) else f"{way}: not up to {last} m/s")
    return ", ".join(out)


def zmp_table(played: Sequence[Played]) -> str:
    """Return the range of the ZMP by hand speed."""
    found = strokes(played)
    if not found:
        return ""
    ways = [way for way in WAYS if np.isfinite(found[0].margin_m[way])]
    head = ["human's hand (m/s)", "robot's hand (m/s)"]
    head += [f"ZMP {axis}, {way} (mm)" for axis in "xy" for way in ways]
    head += [f"least margin, {way} (mm)" for way in ways]
    head += ["executed less physics: RMS, most (mm)"] if WAYS[-1] in ways else []
    rows = []
    for s in found:
        row = [number(s.human_m_s), number(s.robot_m_s)]
        for axis in range(2):
            ends = [1e3 * s.range_m[way][:, axis] for way in ways]
            row += [f"{number(a, 0)} to {number(b, 0)}" if np.isfinite(a) else "–" for a, b in ends]
        row += [number(1e3 * s.margin_m[way], 1) if np.isfinite(s.margin_m[way]) else "–" for way in ways]
        row += [", ".join(number(1e3 * v) for v in s.apart_m)] if WAYS[-1] in ways else []
        rows.append(row)
    x, y = (1e3 * found[0].polygon).T
    edges = f"x {number(x[0], 0)} to {number(x[1], 0)}, y {number(y[0], 0)} to {number(y[1], 0)} mm"
    return f"ZMP of one hand moved up and down (support polygon: {edges}):\n\n{table(head, rows)}"


def zmp_panels(found: Sequence[Stroke]) -> list[Panel]:
    """Return the lowest and highest ZMP by axis against the speed of the human's hand."""
    speed = np.array([s.human_m_s for s in found])
    out = []
    for axis, name in enumerate(("x, forward", "y, left")):
        lines = []
        for end in range(2):
            edge = np.array([s.polygon[end, axis] for s in found])
            lines.append(Line(speed, edge, "" if end else "support polygon", GREY, width_px=5.0))
            for way, colour in zip(WAYS, (BLUE, GREEN, INK, RED), strict=True):
                zmp = np.array([s.range_m[way][end, axis] for s in found])
                lines.append(Line(speed, zmp, "" if end else way, colour, dashed=way == "physics"))
        out.append(Panel(f"ZMP, {name}", "speed of the human's hand [m/s]", f"{name[0]} [m]", lines))
    return out
