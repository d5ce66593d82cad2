"""The experiments of Koenemann, Burget and Bennewitz (ICRA 2014), run again with the preset koenemann_2014 (K7, K8).

    python benchmarks/papers/koenemann_2014.py [CASE ...] [--quick] [--robot R] [--frames N] [--set KEY=VALUE ...]

Writes tables and figures into ``docs/presets/koenemann_2014.md``; with --quick, or cases or options of your own, it
prints the tables and writes nothing unless --docs names a folder. Recordings that are not there are left out, and the
page says so.

Errors are distances to the targets of eq. 5 after all stages [koenemann2014], in the axes of the link that carries the
limb. Times are CPU times of the stages; one unit is one 30x30 SVD timed all through the same run.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Case, Played, number
from page import figure, run_tables, strips, table
from program import Program

from imitor.kinds import Record
from imitor.pipeline import Pipeline
from imitor.types import Array
from imitor.visual.panels import BLUE, GREY, INK, RED, Line, Panel

PRESET = "koenemann_2014"
PROGRAM = f"benchmarks/papers/{PRESET}.py"
PERFORMER = [
    Case(name, scenario=name)
    for name in (
        "single_leg_balance",
        "two_steps_and_reach",
        "step_forward",
        "weight_shift_foot_lift",
        "slow_dance",
    )
]
OTHER_ROBOTS = [
    Case(f"two_steps_and_reach on {robot}", scenario="two_steps_and_reach", robot=robot)
    for robot in ("unitree_g1", "romeo", "talos")
]
RECORDED = [
    Case("CMU 49_18, on one leg", recording="cmu_bvh/49_18.bvh"),
    Case("CMU 07_04, slow walk", recording="cmu_bvh/07_04.bvh"),
    Case("CMU 07_04 at a quarter of its speed", recording="cmu_bvh/07_04.bvh", sets=("speed=0.25",)),
    Case("Kinect, IRDS 216_18_6_1_1", recording="kinect_v2_irds/216_18_6_1_1_stand.csv"),
    Case("Kinect, IRDS 216_18_7_3_1", recording="kinect_v2_irds/216_18_7_3_1_stand.csv"),
    Case("Kinect, Precog Seq1_8", recording="kinect_v1_precog/Seq1_8.csv"),
]
DRAWN = {
    "single_leg_balance": "one leg stretched back, arms raised: figures 7, 8 and 9 of the paper",
    "two_steps_and_reach": "two steps and a reach",
    "CMU 49_18, on one leg": "a real person standing on one leg",
}
LIMBS = (("left_hand", "chest"), ("right_hand", "chest"), ("left_foot", "waist"), ("right_foot", "waist"))


def observe(pipeline: Pipeline, record: Record) -> Array:
    """Return the errors of both hands and both feet [m] and the iterations of this frame."""
    robot = pipeline.robot
    mapper: Any = next(c for _, c in pipeline.stages if c.kind == "mapper")
    ends = []
    for name, carrier in LIMBS:
        end = pipeline.stack[name].frame
        ends.append((robot.position(end) - robot.position(carrier)) @ robot.rotation(carrier))
    errors = np.linalg.norm(np.array(ends) - mapper.limb_targets, axis=1)
    spent = sum(getattr(c, "spent", 0) for _, c in pipeline.stages)
    return np.array([*errors, spent])


# ------------------------------------------------------------------ tables


def tables(played: Sequence[Played]) -> list[str]:
    """Return the tables as Markdown: against the paper, by run, in physics."""
    heads = ["hands mean, max (mm)", "feet mean, max (mm)"]
    return [paper_table(played), *run_tables(PRESET, played, heads, errors)]


def paper_table(played: Sequence[Played]) -> str:
    """Return 'paper | ours | command'."""
    mine = [p for p in played if p.case.scenario and not p.case.robot]
    rows = []
    first = next((p for p in mine if p.case.scenario == "single_leg_balance"), None)
    if first is not None:
        mm = 1e3 * first.observed[1:, :4].mean(axis=0)
        worst = 1e3 * first.observed[1:, :4].max(axis=0)
        command = f"`python {PROGRAM} single_leg_balance`"
        for name, paper, a, b in (("hands", "14 mm", 0, 2), ("feet", "16 mm", 2, 4)):
            ours = f"{mm[a:b].mean():.1f} mm (at most {worst[a:b].max():.0f})"
            rows.append([f"mean error of the {name}, on one leg with arms raised", paper, ours, command])
        single = first.motion.contact.sum(axis=1) == 1
        if single.any():
            offset = first.robot_offset[single]
            ours = f"{number(offset.mean())}, from {number(offset.min())} to {number(offset.max())}"
            rows.append(["offset on the left foot", "0", ours, command])
    if not mine:
        return table(["", "paper", "ours", "command"], rows)
    stages = mine[0].stages
    cut = stages.index("posture") + 1
    command, frames = f"`python {PROGRAM} --quick`", sum(len(p.run) for p in mine)
    for name, told, a, b in (
        ("posture mapping", "1.04 ± 0.35, 1.73", 0, cut),
        ("stabilisation", "1.85 ± 3.50, 27.08", cut, len(stages)),
        ("all", "3.30 ± 3.57, 29.21", 0, len(stages)),
    ):
        ms = np.concatenate([p.ms(a, b) for p in mine])
        unit = 1e3 * float(np.median([p.unit_s for p in mine]))
        ours = f"{spread(ms)} ms ({ms.mean() / unit:.1f}, {ms.max() / unit:.1f} units)"
        rows.append([f"time of {name}, mean ± deviation, most", f"{told} ms", ours, command])
    spent = np.concatenate([p.observed[1:, 4] for p in mine])
    rows.append(
        [
            "IK iterations, mean ± deviation, most",
            "54 ± 178, 1784",
            f"{spent.mean():.0f} ± {spent.std():.0f}, {spent.max():.0f}",
            command,
        ]
    )
    late = sum(int((p.ms() > 1e3 * p.run.period_s).sum()) for p in mine)
    rows.append(["frames later than 30 Hz allows", "none", f"{late} of {frames}", command])
    return table(["", "paper", "ours", "command"], rows)


def spread(values: Array) -> str:
    """Return mean, standard deviation and maximum, as the paper's table I has them."""
    return f"{values.mean():.2f} ± {values.std():.2f}, {values.max():.2f}"


def errors(p: Played) -> list[str]:
    """Return mean and largest errors of hands and of feet of a run [mm]."""
    mm = 1e3 * p.observed[1:]
    return [f"{part.mean():.1f}, {part.max():.0f}" for part in (mm[:, :2], mm[:, 2:4])]


# ------------------------------------------------------------------ figures


def figures(played: Sequence[Played], docs: Path) -> list[str]:
    """Draw the chosen runs and return their Markdown."""
    out = []
    for p in played:
        if p.case.title in DRAWN:
            name = p.case.scenario or Path(p.case.recording).stem
            text = f"{p.case.title}: {DRAWN[p.case.title]}"
            out.append(f"**{p.case.title}** — {DRAWN[p.case.title]}.\n")
            out.append(figure(docs, PRESET, name, panels(p), (1500, 1900), 1, text))
    return out


def panels(p: Played) -> list[Panel]:
    """Return CoM and feet, offset, and errors over time."""
    t, path = p.time_s, p.run.path
    bars = strips(p)
    out = []
    for axis, name in ((0, "forward, x"), (1, "sideways, y")):
        lines = [
            Line(t, path.com[:, axis], "CoM", INK),
            Line(t, path.sole_centre[:, 0, axis], "left sole", BLUE),
            Line(t, path.sole_centre[:, 1, axis], "right sole", RED),
        ]
        out.append(
            Panel(f"Centre of mass and feet, {name}", "time [s]", f"{name[-1]} [m]", lines, strips=bars)
        )
    lines = [
        Line(t, p.human_offset, "human", GREY, dashed=True),
        Line(t, p.robot_offset, "robot", INK),
    ]
    title = "Offset of the CoM between the feet: 0 left, 1 right"
    out.append(Panel(title, "time [s]", "offset [-]", lines, strips=bars, y_range=(-0.25, 1.25)))
    mm = 1e3 * p.observed
    for title, a in (("hands", 0), ("feet", 2)):
        lines = [Line(t, mm[:, a], "left", BLUE), Line(t, mm[:, a + 1], "right", RED)]
        top = max(5.5, 1.1 * float(mm[1:, a : a + 2].max()))
        out.append(
            Panel(f"Errors of the {title}", "time [s]", "error [mm]", lines, strips=bars, y_range=(0.0, top))
        )
    return out


if __name__ == "__main__":
    Program(PRESET, __doc__ or "", PERFORMER, [*OTHER_ROBOTS, *RECORDED], observe, tables, figures).main()
