"""The experiments of Montecillo-Puente et al. (ICINCO 2010), run again with the preset montecillo_2010 (M8 to M10).

    python benchmarks/papers/montecillo_2010.py [CASE ...] [--quick] [--robot R] [--frames N] [--set KEY=VALUE ...]

Writes tables and figures into ``docs/presets/montecillo_2010.md``; with --quick, or cases or options of your own, it
prints the tables and writes nothing unless --docs names a folder.

The ZMP of what was commanded is that of the cart-table model, a point mass at the robot's CoM, and that of the whole
body's momentum (an arm that is moved quickly turns the body though the CoM stays). That of what a simulated robot
executed is computed from its momentum, and measured as the floor's centre of pressure. Times are CPU times of the
stages; one unit is one 30x30 SVD timed all through the same run.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from experiment import Case, Played, number
from montecillo_errors import DANCE, LIFT, errors, observe, rms, table_1
from montecillo_figures import angles, lift_panels, poses
from montecillo_strokes import CASES, SCENARIO, strokes, told_unstable, zmp_panels, zmp_table
from page import figure, image, run_tables, table
from program import Program
from supports import executed

from imitor.metrics.polygon import convex_hull, margins
from imitor.types import SIDES, BoolArray

PRESET = "montecillo_2010"
PROGRAM = f"benchmarks/papers/{PRESET}.py"
OVER_M = 0.025
"""The robot's CoM this far inside a sole is over the foot [m]."""
PERFORMER = [
    Case(DANCE, scenario=DANCE),
    Case(LIFT, scenario=LIFT),
    *CASES,
]
MORE = [
    *(
        Case(
            f"foot lift at {v:g} of the pace",
            scenario=LIFT,
            sets=(f"source.speed={v:g}",),
        )
        for v in (0.5, 2.0, 3.0)
    ),
    Case("walk_in_place", scenario="walk_in_place"),
    Case("single_leg_balance", scenario="single_leg_balance"),
    *(
        Case(f"weight_shift_foot_lift on {robot}", scenario=LIFT, robot=robot)
        for robot in ("nao_v4", "unitree_g1", "romeo", "talos")
    ),
    Case("CMU 02_01, walk, at a quarter of its speed", recording="cmu_c3d/02_01.c3d", sets=("speed=0.25",)),
]


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


def _last_run(flags: BoolArray) -> int:
    """Return how many flags at the end are set [frames]."""
    off = np.flatnonzero(~flags)
    return int(len(flags) - 1 - off[-1]) if off.size else len(flags)


def tables(played: Sequence[Played]) -> list[str]:
    """Return the tables as Markdown: table 1, what else the paper tells, the ZMP, every run."""
    heads = [
        "CoM RMS (mm)",
        "head median, RMS (mm)",
        "wrists RMS (mm)",
        "CoM over the foot before a lift (s)",
    ]
    runs = [p for p in played if p.case.scenario != SCENARIO]
    return [
        table_1(played, PROGRAM),
        said(played),
        zmp_table(played),
        *(run_tables(PRESET, runs, heads, cells) if runs else []),
    ]


def said(played: Sequence[Played]) -> str:
    """Return what the paper tells beside its table."""
    by_title = {p.case.title: p for p in played}
    rows = []
    lift = by_title.get(LIFT)
    if lift is not None:
        for head, com in anticipations(lift):
            rows.append(
                ["head, and robot's CoM, over the support foot before the lift", "head about 1 s",
                 f"{number(head)} s, {number(com)} s", LIFT]
            )  # fmt: skip
    for title in (DANCE, LIFT):
        if title in by_title:
            ms, unit = by_title[title].ms(), 1e3 * by_title[title].unit_s
            rows.append(
                ["time of HN model, anticipation and stack of tasks, mean, most", "30 ms",
                 f"{ms.mean():.2f}, {ms.max():.2f} ms ({ms.mean() / unit:.1f}, {ms.max() / unit:.1f} units)", title]
            )  # fmt: skip
    found = strokes(played)
    if len(found) > 1:
        rows.append(["hand speed at which the robot becomes unstable", "1 m/s", told_unstable(found), ""])
    if not rows:
        return ""
    return table(
        ["", "paper", "ours", "command"],
        [[*row[:3], f"`python {PROGRAM} {row[3]}`".replace(" `", "`")] for row in rows],
    )


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


def figures(played: Sequence[Played], docs: Path) -> list[str]:
    """Draw figures 4, 5 and 6 of the paper and return their Markdown."""
    by_title, out = {p.case.title: p for p in played}, []
    if (p := by_title.get(DANCE)) is not None:
        out += [
            "**Dance** (figure 4): roll, pitch and yaw of head and chest, black the HN model.\n",
            image(docs, PRESET, "dance_poses", poses(p), "Human and robot through the dance"),
            figure(docs, PRESET, "dance", angles(p), (1800, 900), 3, "Angles of head and chest over time"),
        ]
    if (p := by_title.get(LIFT)) is not None:
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


if __name__ == "__main__":
    Program(PRESET, __doc__ or "", PERFORMER, MORE, observe, tables, figures).main()
