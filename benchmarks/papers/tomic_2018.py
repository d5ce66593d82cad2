"""The experiments of Tomic et al. (Robotica 2018), run again with the preset tomic_2018 (T10).

    python benchmarks/papers/tomic_2018.py [TASK ...]

Fits 19 builds in each task by both algorithms and writes tables and figures into ``docs/presets/tomic_2018.md``.
Without tasks named all seven are done. What ROMEO makes of the drawer task is told by ``tomic_drawer.py``.
"""

from __future__ import annotations

import sys

import numpy as np
from experiment import number
from page import DOCS, figure, table, write
from tomic_builds import ALGORITHMS, TASKS, builds, fit, survey

from imitor.robot.model import RobotModel
from imitor.types import Array
from imitor.visual.panels import BLUE, RED, Line, Panel

PRESET = "tomic_2018"
PROGRAM = f"benchmarks/papers/{PRESET}.py"


def main() -> None:
    """Run everything and write the page."""
    tasks = tuple(sys.argv[1:]) or TASKS
    unknown = set(tasks) - set(TASKS)
    if unknown:
        raise SystemExit(f"no task is called {', '.join(sorted(unknown))}; there are: {', '.join(TASKS)}")
    robot = RobotModel.load("romeo")
    command = " ".join([f"`python {PROGRAM}", *sys.argv[1:]]) + "`"
    found = survey(robot, tasks)
    own, other = (found[name] for name in ALGORITHMS)
    build_mean = {name: 1e3 * found[name]["hand_mean_m"].mean(axis=1) for name in ALGORITHMS}
    factor = build_mean[ALGORITHMS[1]] / build_mean[ALGORITHMS[0]]
    rows = [
        ["hands, mean of a build, of most and of the worst", "3 mm, 5 mm",
         f"{number(np.median(build_mean[ALGORITHMS[0]]))} mm, {number(build_mean[ALGORITHMS[0]].max())} mm"],
        ["hands, largest of any frame", "4 mm (drawer)", f"{number(1e3 * own['hand_max_m'].max())} mm"],
        ["hands against where they really are, mean", "–", f"{number(1e3 * own['true_hand_mean_m'].mean())} mm"],
        ["shoulders and elbows, largest", "25 mm", f"{number(1e3 * own['joint_max_m'].max(), 1)} mm"],
        ["hands by markers alone, mean of a build, mean and worst", "worse",
         f"{number(build_mean[ALGORITHMS[1]].mean(), 1)} mm, {number(build_mean[ALGORITHMS[1]].max(), 1)} mm"],
        ["that factor, least of all builds", "> 1", number(factor.min(), 0)],
        ["markers, mean: ours, markers alone", "worse, better",
         f"{number(1e3 * own['marker_mean_m'].mean(), 1)} mm, {number(1e3 * other['marker_mean_m'].mean(), 1)} mm"],
    ]  # fmt: skip
    text = [
        f"Tasks: {', '.join(f'`{t}`' for t in tasks)}; 19 builds.\n",
        table(["", "paper", "ours", "command"], [[*r, command] for r in rows]),
        figure_8(build_mean), figure_6(robot),
    ]  # fmt: skip
    print("\n".join(text))
    print(f"wrote {write(DOCS, PRESET, PROGRAM, chr(10).join(text))}")


def figure_8(build_mean: dict[str, Array]) -> str:
    """Draw the mean hand error of each build, as the paper's figure 8."""
    x = np.arange(1.0, 20.0)
    panels = [
        Panel(f"{name}", "build", "mean error of the hands (mm)", [Line(x, build_mean[name], colour=colour)])
        for name, colour in zip(ALGORITHMS, (BLUE, RED), strict=True)
    ]
    return figure(
        DOCS, PRESET, "figure_8", panels, (1100, 380), 2, "Mean hand error of 19 builds, both algorithms"
    )


def figure_6(robot: RobotModel) -> str:
    """Draw hand, shoulder and elbow errors of one build in the drawer task, as the paper's figure 6."""
    fits = [fit(robot, name, "open_close_drawer", builds()[0]) for name in ALGORITHMS]
    panels = []
    for title, pick in (
        ("hand joints", "hand_m"),
        ("shoulders and elbows", "joint_m"),
        ("orientation, eq. 9", "turn"),
    ):
        scale = 1.0 if pick == "turn" else 1e3
        lines = [
            Line(f.time_s, scale * getattr(f, pick).max(axis=1), name, colour)
            for f, name, colour in zip(fits, ALGORITHMS, (BLUE, RED), strict=True)
        ]
        panels.append(Panel(title, "time (s)", "largest error" + ("" if pick == "turn" else " (mm)"), lines))
    return figure(
        DOCS, PRESET, "figure_6", panels, (1300, 380), 3, "Errors in the drawer task, both algorithms"
    )


if __name__ == "__main__":
    main()
