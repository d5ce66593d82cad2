"""The experiments of Penna Poubel et al. (ICRA 2014), run again with the preset penna_poubel_2014 (P13).

    python benchmarks/papers/penna_poubel_2014.py [CASE ...] [--quick] [--robot R] [--frames N] [--set KEY=VALUE ...]

Writes tables and figures into ``docs/presets/penna_poubel_2014.md``; with --quick, or cases or options of your own, it
prints the tables and writes nothing unless --docs names a folder. Recordings that are not there are left out, and the
page says so.

A take-off lasts from the human's until the robot's sole is at the height rho at which it is free, a landing from the
human's until the robot's CoM is back between its feet [pennapoubel2014]. Times are CPU times of the stages; one unit
is one 30x30 SVD timed all through the same run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Case, Played, number
from page import figure, image, run_tables, strips, table
from program import Program
from supports import executed, phases

from imitor.types import SIDES, Array
from imitor.visual.panels import BLUE, GREEN, INK, PURPLE, RED, Line, Outline, Panel, mixed

PRESET = "penna_poubel_2014"
PROGRAM = f"benchmarks/papers/{PRESET}.py"
PERFORMER = [
    Case(name, scenario=name)
    for name in (
        "step_forward",
        "two_steps_and_reach",
        "walk_in_place",
        "weight_shift_foot_lift",
        "single_leg_balance",
        "slow_dance",
    )
] + [
    Case("step_forward, a step of 0.57 m", scenario="step_forward", sets=("source.step_length_m=0.57",)),
    Case("walk at a quarter of its speed", scenario="walk", sets=("speed=0.25",)),
]
RECORDED = [
    Case("Kinect, IRDS 216_18_6_1_1", recording="kinect_v2_irds/216_18_6_1_1_stand.csv"),
    Case("Kinect, IRDS 216_18_7_3_1", recording="kinect_v2_irds/216_18_7_3_1_stand.csv"),
    Case("Kinect, Precog Seq1_8", recording="kinect_v1_precog/Seq1_8.csv"),
    Case("CMU 49_18, on one leg", recording="cmu_bvh/49_18.bvh"),
    Case("CMU 07_04, slow walk", recording="cmu_bvh/07_04.bvh"),
    Case("CMU 07_04 at a quarter of its speed", recording="cmu_bvh/07_04.bvh", sets=("speed=0.25",)),
]
DRAWN = "step_forward"
LIFTED_M = 0.9 * 0.03
"""A sole this high counts as lifted to rho [m]."""
MIDDLE = 0.1
"""An offset this near 0.5 counts as between the feet [-]."""
PICTURES = 6


# ------------------------------------------------------------------ what the motion says


def landings(p: Played) -> Iterator[float]:
    """Yield for each landing the distance of the sole from where it was to go [m]."""
    for i, side in enumerate(SIDES):
        on, place = p.motion.contact[:, i], p.frame(f"{side}_foot")[:, :3, 3]
        goal = p.reference.target[f"{side}_foot"][:, :3, 3]
        for k in np.flatnonzero(on[1:] & ~on[:-1]) + 1:
            yield float(np.linalg.norm(place[k] - goal[k - 1]))


def slides(p: Played) -> Iterator[float]:
    """Yield for each stance of a foot how far its sole moved along the floor [m]."""
    for i in range(2):
        on, place = p.motion.contact[:, i], p.run.path.sole_centre[:, i, :2]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
        for first, end in edges.reshape(-1, 2):
            yield float(np.linalg.norm(place[first:end] - place[first], axis=1).max())


def take_offs(p: Played) -> Iterator[float]:
    """Yield the time of each executed take-off, from the human's until the sole is lifted [s]."""
    height = p.run.path.sole[..., 2].min(axis=2)
    for human, robot in executed(p.human_support, p.motion.contact):
        if robot is None:
            continue
        free = 1 - SIDES.index(robot.mode)
        up = np.flatnonzero(height[robot.first : robot.last + 1, free] >= LIFTED_M)
        if up.size:
            yield float(p.time_s[robot.first + up[0]] - p.time_s[human.first])


def settlings(p: Played) -> Iterator[float]:
    """Yield the time of each executed landing, from the human's until the CoM is back between the feet [s]."""
    middle = np.abs(p.robot_offset - 0.5) < MIDDLE
    for human, robot in executed(p.human_support, p.motion.contact):
        if robot is None or human.last + 1 >= len(p.run):
            continue
        there = middle & p.motion.contact.all(axis=1)
        after = np.flatnonzero(there[human.last + 1 :])
        if after.size:
            yield float(p.time_s[human.last + 1 + after[0]] - p.time_s[human.last + 1])


# ------------------------------------------------------------------ tables


def tables(played: Sequence[Played]) -> list[str]:
    """Return the tables as Markdown: against the paper, by run, in physics."""
    heads = [
        "take-offs (s)",
        "landings (s)",
        "landing error, most (mm)",
        "slide of a standing foot, most (mm)",
    ]
    return [paper_table(played), *run_tables(PRESET, played, heads, cells)]


def cells(p: Played) -> list[str]:
    """Return transition times, landing errors and slides of a run."""
    return [span(take_offs(p)), span(settlings(p)), most_mm(landings(p)), most_mm(slides(p))]


def span(values: Iterator[float]) -> str:
    """Return the least and the largest of some times [s]."""
    found = list(values)
    return f"{number(min(found))} to {number(max(found))}" if found else "–"


def most_mm(values: Iterator[float]) -> str:
    """Return the largest of some lengths [mm]."""
    found = list(values)
    return number(1e3 * max(found), 1) if found else "–"


def paper_table(played: Sequence[Played]) -> str:
    """Return 'paper | ours | command'."""
    p = next((p for p in played if p.case.scenario == DRAWN), None)
    if p is None:
        return ""
    command = f"`python {PROGRAM} {DRAWN}`"
    modes = {"double": "DS", "left": "LS", "right": "RS", "flight": "none"}
    ahead = p.run.path.sole_centre[[0, -1], 0, 0]
    solvers = [i for i, kind in enumerate(p.kinds) if kind == "solver"]
    ik = 1e3 * p.stage_s[1:, solvers].sum(axis=1)
    unit = 1e3 * p.unit_s
    rows = [
        ["phases of the step forward", "DS-RS-DS", "-".join(modes[f.mode] for f in phases(p.motion.contact))],
        ["left foot placed ahead", "137 mm", f"{number(1e3 * (ahead[1] - ahead[0]), 0)} mm"],
        ["transitions", "3 to 12 s", f"take-off {span(take_offs(p))} s, landing {span(settlings(p))} s"],
        ["landed sole from its target", "slid to its place in DS", f"{most_mm(landings(p))} mm"],
        ["slide of a standing foot", "–", f"at most {most_mm(slides(p))} mm"],
        ["IK in a time step", "42 ms, 10 % of it", f"{ik.mean():.2f} ms, at most {ik.max():.2f} "
         f"({ik.mean() / unit:.1f}, {ik.max() / unit:.1f} units)"],
        ["computing in a time step", "–", f"{p.ms().mean():.2f} ms, at most {p.ms().max():.2f}"],
        ["time step", "420 ms, 90 % of it moving", f"{1e3 * p.run.period_s:.0f} ms"],
    ]  # fmt: skip
    return table(["", "paper", "ours", "command"], [[*row, command] for row in rows])


# ------------------------------------------------------------------ figures


def figures(played: Sequence[Played], docs: Path) -> list[str]:
    """Draw the step forward as in figures 5 to 8 and return their Markdown."""
    p = next((p for p in played if p.case.scenario == DRAWN), None)
    if p is None:
        return []
    return [
        "**Poses** (figure 5), below the robot alone.\n",
        image(docs, PRESET, "poses", poses(p), "Human and robot through the step forward"),
        "**Tracked trajectories in time** (figure 6): hands, free ankle and CoM; broad and pale what is asked for.\n",
        figure(docs, PRESET, "time", in_time(p), (1800, 1300), 3, "Hands, left ankle and CoM over time"),
        "**Tracked trajectories in space** (figure 7).\n",
        figure(
            docs,
            PRESET,
            "space",
            in_space(p),
            (1800, 900),
            2,
            "Hands and left ankle from the side and from above",
        ),
        "**CoM projection and standing feet on the floor** (figure 8).\n",
        figure(
            docs, PRESET, "floor", on_the_floor(p), (1200, 900), 1, "CoM projection and feet on the floor"
        ),
    ]


def poses(p: Played) -> Any:
    """Return the film strip (figure 5): human and robot to scale, and under them the robot alone."""
    from imitor.visual.palette import reduced
    from imitor.visual.sheet import contact_sheet, tile_size
    from imitor.visual.studio import Studio

    rows = np.linspace(0, len(p.run) - 1, PICTURES).round().astype(int)
    width, height = tile_size((400, 440), PICTURES, 1500)
    unseen = np.zeros_like(p.reference.role_valid)
    nobody = replace(p.reference, role_valid=unseen, human_com_m=np.full((len(p.run), 3), np.nan))
    pictures = []
    for human in (p.reference, nobody):
        studio = Studio(p.robot, p.motion, human, rows, size=(2 * width, 2 * height))
        try:
            pictures += [studio.picture(i) for i in range(len(studio))]
        finally:
            studio.close()
    times = (p.time_s[rows]).tolist()
    return reduced(contact_sheet(pictures, 2 * times, "", PICTURES, 1500))


def tracked(p: Played) -> Iterator[tuple[str, Any, Array, Array]]:
    """Yield name, colour, and reference and robot's points in world, shape (T, 3) [m], of what is tracked."""
    for name, colour in (("left_hand", BLUE), ("right_hand", RED), ("left_ankle", GREEN)):
        if name in p.reference.target:
            asked = p.reference.target[name].copy()
            asked[~p.reference.target_active[name]] = np.nan
            yield name.replace("_", " "), colour, asked, p.run.path.point[name]


def pale(x: Array, y: Array, colour: Any, label: str = "") -> Line:
    """Return what is asked for as a broad pale line under the robot's."""
    return Line(x, y, label, mixed(colour, 0.35), width_px=7.0)


def in_time(p: Played) -> list[Panel]:
    """Return the trajectories over time (figure 6), a row of panels an axis."""
    t, bars = p.time_s, strips(p)
    com, asked = p.run.path.com, p.reference.target["com"].copy()
    asked[:, 2] = np.nan  # the CoM's height is free
    out = []
    for axis, letter in enumerate("xyz"):
        hands = [(n, c, a, r) for n, c, a, r in tracked(p) if n != "left ankle"]
        ankle = [(n, c, a, r) for n, c, a, r in tracked(p) if n == "left ankle"]
        for title, curves in (("Hands", hands), ("Left ankle", ankle), ("CoM", [("CoM", INK, asked, com)])):
            lines = []
            for name, colour, wanted, robot in curves:
                lines.append(pale(t, wanted[:, axis], colour))
                lines.append(Line(t, robot[:, axis], name, colour))
            out.append(Panel(f"{title}, {letter}", "time [s]", f"{letter} [m]", lines, strips=bars))
    return out


def in_space(p: Played) -> list[Panel]:
    """Return the trajectories from the side and from above (figure 7)."""
    out = []
    for title, (a, b) in (("From the right side", (0, 2)), ("From above", (0, 1))):
        lines = []
        for name, colour, wanted, robot in tracked(p):
            lines.append(pale(wanted[:, a], wanted[:, b], colour))
            lines.append(Line(robot[:, a], robot[:, b], name, colour))
        out.append(Panel(title, f"{'xyz'[a]} [m]", f"{'xyz'[b]} [m]", lines, equal=True))
    return out


def on_the_floor(p: Played) -> list[Panel]:
    """Return the CoM's projection and each place where a foot stood (figure 8)."""
    outlines = []
    for i, (side, colour) in enumerate(zip(SIDES, (BLUE, RED), strict=True)):
        on = p.motion.contact[:, i]
        starts = np.flatnonzero(on & ~np.concatenate([[False], on[:-1]]))
        for k, first in enumerate(starts):
            corners = p.run.path.sole[min(first + 1, len(on) - 1), i, :, :2]
            outlines.append(Outline(corners, "" if k else f"{side} foot standing", colour))
    com, asked = p.run.path.com, p.reference.target["com"]
    lines = [
        pale(asked[:, 0], asked[:, 1], PURPLE, "CoM, asked for"),
        Line(com[:, 0], com[:, 1], "CoM", INK),
    ]
    return [
        Panel("On the floor, seen from above", "x, forward [m]", "y, left [m]", lines, outlines, equal=True)
    ]


if __name__ == "__main__":
    Program(PRESET, __doc__ or "", PERFORMER, RECORDED, None, tables, figures).main()
