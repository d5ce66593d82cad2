"""The experiments of Montecillo-Puente et al. (ICINCO 2010), run again with the preset montecillo_2010 (M8 to M10).

    python benchmarks/papers/montecillo_2010.py [CASE ...] [--quick] [--robot R] [--frames N] [--set KEY=VALUE ...]

Writes tables and figures into ``docs/presets/montecillo_2010.md``; with --quick, or cases or options of your own, it
prints the tables and writes nothing unless --docs names a folder.

Errors are those of table 1: the root mean square over time of each axis, and its mean over the axes. The ZMP is that of
the cart-table model on the robot's CoM, that of the whole body's momentum (an arm that is moved quickly turns the body
though the CoM stays), and the centre of pressure of the same motion executed in physics. Times are
CPU times of the stages; one unit is one 30x30 SVD timed all through the same run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Case, Played, number
from page import figure, image, run_tables, strips, table
from program import Program
from supports import executed
from zmp import physics_zmp, whole_body_zmp

from imitor.kinds import Record
from imitor.metrics.balance import cart_table_zmp
from imitor.metrics.polygon import convex_hull, margins
from imitor.pipeline import Pipeline
from imitor.simulation.verdict import EDGE_M
from imitor.types import SIDES, Array
from imitor.visual.panels import BLUE, GREEN, GREY, INK, RED, Line, Panel, mixed

PRESET = "montecillo_2010"
PROGRAM = f"benchmarks/papers/{PRESET}.py"
WAYS = ("cart-table", "whole body", "physics")
PARTS = ("head", "chest", "waist")
SETTLED_S = 2.0
"""The robot goes to the human's first pose in this time: it counts for nothing [s]."""
SPEEDS = (0.3, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0)
"""Greatest speeds of the hand in every stroke [m/s]."""
STROKES_S = (3.4, 8.6)
"""When the hand goes up and down with its whole swing, from the start of the performance [s]."""
OVER_M = 0.025
"""The robot's CoM this far inside a sole is over the foot [m]."""
PAPER = {
    "CoM": ("0", ""),
    "head": ("0 m; 4.09°", "R 11.8, P 0.22, Y 0.26°"),
    "left wrist": ("0.02 m", "X 0.013, Y 0.02, Z 0.3 (0.03) m"),
    "right wrist": ("0.05 m", "X 0.05, Y 0.017, Z 0.08 m"),
    "chest": ("4.2°", "R 1.1, P 6.7, Y 4.8°"),
    "waist": ("6.4°", "R 1.1, P 4.62, Y 0.52°"),
}
PERFORMER = [
    Case("slow_dance", scenario="slow_dance"),
    Case("weight_shift_foot_lift", scenario="weight_shift_foot_lift"),
    *(
        Case(f"hand at {v:g} m/s", scenario="hand_updown", sets=(f"source.hand_speed_m_s={v:g}",))
        for v in SPEEDS
    ),
]
MORE = [
    *(
        Case(
            f"foot lift at {v:g} of the pace",
            scenario="weight_shift_foot_lift",
            sets=(f"source.speed={v:g}",),
        )
        for v in (0.5, 2.0, 3.0)
    ),
    Case("walk_in_place", scenario="walk_in_place"),
    Case("single_leg_balance", scenario="single_leg_balance"),
    *(
        Case(f"weight_shift_foot_lift on {robot}", scenario="weight_shift_foot_lift", robot=robot)
        for robot in ("nao_v4", "unitree_g1", "romeo", "talos")
    ),
    Case("CMU 02_01, walk, at a quarter of its speed", recording="cmu_c3d/02_01.c3d", sets=("speed=0.25",)),
]


def observe(pipeline: Pipeline, record: Record) -> Array:
    """Return the HN model of a frame: head (3), wrists (2 x 16), turns of head, chest and waist (3 x 9)."""
    model = next(c for _, c in pipeline.stages if c.name == "normalized_model").model  # type: ignore[attr-defined]
    turns = [model.turn[part].ravel() for part in PARTS]
    return np.concatenate([model.head, *(pose.ravel() for pose in model.wrist), *turns])


# ------------------------------------------------------------------ what the motion says


def roll_pitch_yaw(R: Array) -> Array:
    """Return the angles about x, y and z of rotations, shape (..., 3) [deg]."""
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    pitch = np.arcsin(-np.clip(R[..., 2, 0], -1.0, 1.0))
    return np.degrees(np.stack([roll, pitch, np.arctan2(R[..., 1, 0], R[..., 0, 0])], axis=-1))


def turn_of(p: Played, part: str) -> Array:
    """Return how a part of the HN model is turned, shape (T, 3, 3)."""
    first = 35 + 9 * PARTS.index(part)
    return p.observed[:, first : first + 9].reshape(-1, 3, 3)


def settled(p: Played) -> Array:
    """Return which frames count, shape (T,)."""
    return np.asarray(p.time_s >= SETTLED_S)


def errors(p: Played, name: str) -> Array:
    """Return the errors of a row of table 1 over the frames that count, shape (T', axes) [m or deg]."""
    rows = settled(p)
    if name == "CoM":
        return np.asarray((p.run.path.com - p.reference.target["com"])[rows, :2])
    if name.endswith("wrist"):
        side = name.removesuffix(" wrist")
        asked = p.observed[:, 3 + 16 * SIDES.index(side) :][:, :16].reshape(-1, 4, 4)
        return np.asarray((p.frame(f"{side}_wrist")[:, :3, 3] - asked[:, :3, 3])[rows])
    if name == "head position":
        return np.asarray((p.frame("head")[:, :3, 3] - p.observed[:, :3])[rows])
    off = roll_pitch_yaw(p.frame(name)[:, :3, :3]) - roll_pitch_yaw(turn_of(p, name))
    return np.asarray((off + 180.0) % 360.0 - 180.0)[rows]


def rms(values: Array) -> Array:
    """Return the root mean square over time, by axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


@dataclass(frozen=True)
class Stroke:
    """The ZMP in one run of the moving hand.

    Attributes:
        human_m_s, robot_m_s: Greatest speed of the human's and of the robot's wrist [m/s].
        range_m: Lowest and highest ZMP by axis, shape (2, 2) [m], by each of `WAYS`; NaN where physics was not asked.
        margin_m: Least margin of the ZMP in the polygon, by each of `WAYS` [m].
        polygon: Lowest and highest corner of the support polygon by axis, shape (2, 2) [m].
    """

    human_m_s: float
    robot_m_s: float
    range_m: dict[str, Array]
    margin_m: dict[str, float]
    polygon: Array


def stroke(p: Played) -> Stroke:
    """Measure one run of the moving hand while it goes up and down."""
    rows = (p.time_s > SETTLED_S + STROKES_S[0]) & (p.time_s < SETTLED_S + STROKES_S[1])
    soles = p.run.path.sole[rows][0].reshape(-1, 3)[:, :2]
    hull = convex_hull([(float(x), float(y)) for x, y in soles])
    physics, edge = physics_zmp(p)
    found = {
        "cart-table": cart_table_zmp(p.run.path.com, p.run.period_s)[0],
        "whole body": whole_body_zmp(p),
        "physics": physics,
    }
    ranges, least = {}, {}
    for way, zmp in found.items():
        used = rows & np.isfinite(zmp).all(axis=1)
        seen = zmp[used]
        if not len(seen):
            ranges[way], least[way] = np.full((2, 2), np.nan), float("nan")
            continue
        ranges[way] = np.array([seen.min(axis=0), seen.max(axis=0)])
        inside = (
            np.nan_to_num(edge[used]) if way == "physics" else np.array(margins(seen, [hull] * len(seen)))
        )
        least[way] = float(inside.min())
    wrists = (p.reference.role("right_wrist"), p.frame("right_wrist")[:, :3, 3])
    speeds = [np.linalg.norm(np.gradient(w, p.run.period_s, axis=0), axis=1)[rows] for w in wrists]
    polygon = np.array([soles.min(axis=0), soles.max(axis=0)])
    return Stroke(float(speeds[0].max()), float(speeds[1].max()), ranges, least, polygon)


def strokes(played: Sequence[Played]) -> list[Stroke]:
    """Return the runs of the moving hand in order of its speed."""
    return sorted((stroke(p) for p in played if p.case.scenario == "hand_updown"), key=lambda s: s.human_m_s)


def unstable_from(found: Sequence[Stroke], way: str) -> float:
    """Return the hand speed at which the ZMP reaches the edge, between two runs; NaN if in none [m/s].

    In physics the centre of pressure cannot leave the polygon: nearer than `EDGE_M` to its edge the robot tips.
    """
    edge = EDGE_M if way == "physics" else 0.0
    for a, b in pairwise(found):
        low, high = a.margin_m[way] - edge, b.margin_m[way] - edge
        if low > 0.0 >= high:
            return a.human_m_s + (b.human_m_s - a.human_m_s) * low / (low - high)
    return float("nan")


def anticipations(p: Played) -> list[tuple[float, float]]:
    """Return how long before each lift the head and the robot's CoM were over the support foot [s]."""
    out = []
    contact, soles = p.motion.contact, p.run.path.sole
    for _, robot in executed(p.human_support, contact):
        if robot is None or robot.first == 0:
            continue
        lift, stance = robot.first, SIDES.index(robot.mode)
        hull = convex_hull([(float(x), float(y)) for x, y in soles[lift, stance, :, :2]])
        inner = np.array([hull]).reshape(-1, 2)
        com = np.array(margins(p.run.path.com[:lift, :2], [hull] * lift)) >= OVER_M
        head = np.abs(p.observed[:lift, 1] - inner[:, 1].mean()) <= 0.5 * np.ptp(inner[:, 1])
        out.append((_last_run(head) * p.run.period_s, _last_run(com) * p.run.period_s))
    return out


def _last_run(flags: Array) -> int:
    """Return how many flags at the end are set [frames]."""
    off = np.flatnonzero(~flags)
    return int(len(flags) - 1 - off[-1]) if off.size else len(flags)


# ------------------------------------------------------------------ tables


def tables(played: Sequence[Played]) -> list[str]:
    """Return the tables as Markdown: table 1, what else the paper tells, the ZMP, every run."""
    heads = [
        "CoM RMS (mm)",
        "head median, RMS (mm)",
        "wrists RMS (mm)",
        "CoM over the foot before a lift (s)",
    ]
    runs = [p for p in played if p.case.scenario != "hand_updown"]
    return [
        table_1(played),
        said(played),
        zmp_table(played),
        *(run_tables(PRESET, runs, heads, cells) if runs else []),
    ]


def table_1(played: Sequence[Played]) -> str:
    """Return table 1 with the dance and the foot lift beside the paper's."""
    found = {p.case.title: p for p in played if p.case.title in ("slow_dance", "weight_shift_foot_lift")}
    if not found:
        return ""
    rows = []
    for name, (mean, axes) in PAPER.items():
        cells_ = [name, mean, axes]
        for p in found.values():
            cells_ += list(_row(p, name))
        rows.append(cells_)
    head = ["mean RMS error", "paper", "by axis"]
    for title in found:
        head += [title, "by axis"]
    commands = ", ".join(f"`python {PROGRAM} {title}`" for title in found)
    return f"Table 1 ({commands}):\n\n{table(head, rows)}"


def _row(p: Played, name: str) -> tuple[str, str]:
    if name == "CoM" or name.endswith("wrist"):
        e = 1e3 * rms(errors(p, name))
        return f"{number(e.mean(), 1)} mm", ", ".join(
            f"{a} {number(v, 1)}" for a, v in zip("XYZ", e, strict=False)
        ) + " mm"
    e = rms(errors(p, name))
    mean = f"{number(e.mean(), 1)}°"
    if name == "head":
        mean = f"{number(1e3 * rms(errors(p, 'head position')).mean(), 1)} mm; {mean}"
    return mean, ", ".join(f"{a} {number(v, 2)}" for a, v in zip("RPY", e, strict=True)) + "°"


def said(played: Sequence[Played]) -> str:
    """Return what the paper tells beside its table."""
    by_title = {p.case.title: p for p in played}
    rows = []
    lift = by_title.get("weight_shift_foot_lift")
    if lift is not None:
        for head, com in anticipations(lift):
            rows.append(
                ["head, and robot's CoM, over the support foot before the lift", "head about 1 s",
                 f"{number(head)} s, {number(com)} s", "weight_shift_foot_lift"]
            )  # fmt: skip
    for title in ("slow_dance", "weight_shift_foot_lift"):
        if title in by_title:
            ms, unit = by_title[title].ms(), 1e3 * by_title[title].unit_s
            rows.append(
                ["time of HN model, anticipation and stack of tasks, mean, most", "30 ms",
                 f"{ms.mean():.2f}, {ms.max():.2f} ms ({ms.mean() / unit:.1f}, {ms.max() / unit:.1f} units)", title]
            )  # fmt: skip
    found = strokes(played)
    if len(found) > 1:
        told = []
        for way in WAYS:
            v = unstable_from(found, way)
            known = np.isfinite(found[0].margin_m[way])
            text = f"{number(v)} m/s" if np.isfinite(v) else f"not up to {number(found[-1].human_m_s)} m/s"
            told += [f"{way}: {text}"] if known else []
        rows.append(["hand speed at which the robot becomes unstable", "1 m/s", ", ".join(told), ""])
    if not rows:
        return ""
    return table(
        ["", "paper", "ours", "command"],
        [[*row[:3], f"`python {PROGRAM} {row[3]}`".replace(" `", "`")] for row in rows],
    )


def zmp_table(played: Sequence[Played]) -> str:
    """Return the range of the ZMP by hand speed."""
    found = strokes(played)
    if not found:
        return ""
    ways = [way for way in WAYS if np.isfinite(found[0].margin_m[way])]
    head = ["human's hand (m/s)", "robot's hand (m/s)"]
    head += [f"ZMP {axis}, {way} (mm)" for axis in "xy" for way in ways]
    head += [f"least margin, {way} (mm)" for way in ways]
    rows = []
    for s in found:
        row = [number(s.human_m_s), number(s.robot_m_s)]
        for axis in range(2):
            ends = [1e3 * s.range_m[way][:, axis] for way in ways]
            row += [f"{number(a, 0)} to {number(b, 0)}" if np.isfinite(a) else "–" for a, b in ends]
        row += [number(1e3 * s.margin_m[way], 1) if np.isfinite(s.margin_m[way]) else "–" for way in ways]
        rows.append(row)
    x, y = (1e3 * found[0].polygon).T
    edges = f"x {number(x[0], 0)} to {number(x[1], 0)}, y {number(y[0], 0)} to {number(y[1], 0)} mm"
    return f"ZMP of one hand moved up and down (support polygon: {edges}):\n\n{table(head, rows)}"


def cells(p: Played) -> list[str]:
    """Return errors and anticipation of a run."""
    head = 1e3 * np.linalg.norm(errors(p, "head position"), axis=1)
    wrists = [1e3 * float(rms(errors(p, f"{side} wrist")).mean()) for side in SIDES]
    before = [com for _, com in anticipations(p)]
    return [
        ", ".join(number(v, 1) for v in 1e3 * rms(errors(p, "CoM"))),
        f"{number(np.median(head), 1)}, {number(float(np.sqrt(np.mean(head**2))), 1)}",
        ", ".join(number(v, 1) for v in wrists),
        f"{number(min(before))} to {number(max(before))}" if before else "–",
    ]


# ------------------------------------------------------------------ figures


def figures(played: Sequence[Played], docs: Path) -> list[str]:
    """Draw figures 4, 5 and 6 of the paper and return their Markdown."""
    by_title, out = {p.case.title: p for p in played}, []
    if (p := by_title.get("slow_dance")) is not None:
        out += [
            "**Dance** (figure 4): roll, pitch and yaw of head and chest, black the HN model.\n",
            image(docs, PRESET, "dance_poses", poses(p), "Human and robot through the dance"),
            figure(docs, PRESET, "dance", angles(p), (1800, 900), 3, "Angles of head and chest over time"),
        ]
    if (p := by_title.get("weight_shift_foot_lift")) is not None:
        out += [
            "**Foot lift** (figure 5): head, CoM and its target sideways, and the height of the soles.\n",
            image(docs, PRESET, "lift_poses", poses(p), "Human and robot through the foot lift"),
            figure(docs, PRESET, "lift", lift_panels(p), (1500, 900), 1, "Head, CoM and foot over time"),
        ]
    found = strokes(played)
    if found:
        out += [
            "**ZMP against hand speed** (figure 6): grey the support polygon.\n",
            figure(
                docs, PRESET, "zmp", zmp_panels(found), (1600, 700), 2, "Range of the ZMP against hand speed"
            ),
        ]
    return out


def poses(p: Played) -> Any:
    """Return human and robot side by side at six times."""
    from imitor.visual.palette import reduced
    from imitor.visual.sheet import contact_sheet, tile_size
    from imitor.visual.studio import Studio

    rows = np.linspace(len(p.run) // 6, len(p.run) - 1, 6).round().astype(int)
    width, height = tile_size((400, 440), 6, 1500)
    studio = Studio(p.robot, p.motion, p.reference, rows, size=(2 * width, 2 * height))
    try:
        pictures = [studio.picture(i) for i in range(len(studio))]
    finally:
        studio.close()
    return reduced(contact_sheet(pictures, p.time_s[rows].tolist(), "", 6, 1500))


def angles(p: Played) -> list[Panel]:
    """Return roll, pitch and yaw of head and chest over time."""
    out = []
    for part in ("head", "chest"):
        asked, robot = (roll_pitch_yaw(R) for R in (turn_of(p, part), p.frame(part)[:, :3, :3]))
        for axis, name in enumerate(("roll", "pitch", "yaw")):
            lines = [
                Line(p.time_s, asked[:, axis], "HN model", INK),
                Line(p.time_s, robot[:, axis], "robot", RED, dashed=True),
            ]
            out.append(Panel(f"{part}, {name}", "time [s]", "[deg]", lines))
    return out


def lift_panels(p: Played) -> list[Panel]:
    """Return head, CoM and its target sideways, and the heights of both feet."""
    t, soles = p.time_s, p.run.path.sole
    sideways = [
        Line(t, p.observed[:, 1], "head of the HN model", INK),
        Line(t, p.reference.target["com"][:, 1], "CoM, target", mixed(BLUE, 0.4), width_px=6.0),
        Line(t, p.run.path.com[:, 1], "CoM of the robot", BLUE, dashed=True),
        *(Line(t, soles[:, i, :, 1].mean(axis=1), f"{SIDES[i]} sole", GREY, dashed=True) for i in range(2)),
    ]
    heights = [
        Line(t, soles[:, i, :, 2].min(axis=1), f"{SIDES[i]} sole", colour)
        for i, colour in enumerate((RED, GREEN))
    ]
    return [
        Panel("Sideways", "time [s]", "y [m]", sideways, strips=strips(p)),
        Panel("Lowest corner of the soles", "time [s]", "z [m]", heights, strips=strips(p)),
    ]


def zmp_panels(found: Sequence[Stroke]) -> list[Panel]:
    """Return the lowest and highest ZMP by axis against the speed of the human's hand."""
    speed = np.array([s.human_m_s for s in found])
    out = []
    for axis, name in enumerate(("x, forward", "y, left")):
        lines = []
        for end in range(2):
            edge = np.array([s.polygon[end, axis] for s in found])
            lines.append(Line(speed, edge, "" if end else "support polygon", GREY, width_px=5.0))
            for way, colour in zip(WAYS, (BLUE, GREEN, RED), strict=True):
                zmp = np.array([s.range_m[way][end, axis] for s in found])
                lines.append(Line(speed, zmp, "" if end else way, colour, dashed=way == "physics"))
        out.append(Panel(f"ZMP, {name}", "speed of the human's hand [m/s]", f"{name[0]} [m]", lines))
    return out


if __name__ == "__main__":
    Program(PRESET, __doc__ or "", PERFORMER, MORE, observe, tables, figures).main()
