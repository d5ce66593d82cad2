"""The experiments of Tomic et al. (Robotica 2018), run again with the preset tomic_2018 (T10).

    python benchmarks/papers/tomic_2018.py [TASK ...]

Fits 19 builds in each task by both algorithms, runs the drawer task with the preset, in physics and from where it is
out of reach, too, and writes tables and figures into ``docs/presets/tomic_2018.md``. Without tasks named all seven are
done.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pinocchio as pin
from experiment import Case, Played, number, play
from page import DOCS, figure, table, write
from tomic_builds import ALGORITHMS, TASKS, builds, fit, survey

from imitor.kinds import Record
from imitor.pipeline import Pipeline
from imitor.robot.model import RobotModel
from imitor.types import SIDES, Array
from imitor.visual.panels import BLUE, RED, Line, Panel

PRESET = "tomic_2018"
PROGRAM = f"benchmarks/papers/{PRESET}.py"
DRAWER = Case("drawer", "open_close_drawer")
UNPLACED = Case(
    "drawer, from the person's place", "open_close_drawer", sets=("contact.placement_m=[0, 0, 0]",)
)
SEARCHED = Case(
    "drawer, placement searched for",
    "open_close_drawer",
    sets=("contact.placement_m=null", "contact.grip_rpy_rad=[-1.5708, -0.161, 0.034]", "contact.rise_m=0.1"),
)


def contact(pipeline: Pipeline, record: Record) -> Array:
    """Return for both hands share of growth, distance [m] and angle [rad] from the person's, and the target (3,).

    After these come the placement of the robot, (3,) [m], and how many frames collisions changed so far.
    """
    stage: Any = {c.name: c for _, c in pipeline.stages}
    person = stage["virtual_marker_fit"].imitation.model.robot
    share, robot = stage["contact_transition"].share, pipeline.robot
    out = []
    for i, side in enumerate(SIDES):
        role = f"{side}_hand"
        off = robot.position(role) - person.position(role)
        turn = pin.log3(person.rotation(role).T @ robot.rotation(role))
        out += [share[i], np.linalg.norm(off), np.linalg.norm(turn), *pipeline.stack[role].target[:3, 3]]
    changed = stage["fcl_collision"].correction.changed
    return np.array([*out, *stage["contact_transition"].placement, changed])


def hands(p: Played) -> tuple[str, Array]:
    """Return how far hands in contact are from the person's, in words, and what was seen of both, (T, 2, 6)."""
    seen = p.observed[:, :12].reshape(-1, 2, 6)
    held = (seen[:, :, 0] >= 1.0).all(axis=1)
    off_mm, off_deg = 1e3 * seen[held, :, 1].max(), np.degrees(seen[held, :, 2].max())
    return f"{number(off_mm)} mm, {number(off_deg)}°, {held.sum()} frames", seen


def physics_rows(p: Played) -> list[list[str]]:
    """Return rows of the table about the drawer in physics."""
    drawer = p.simulation["objects"]["drawer"]
    joint = p.simulation["joint_error_rad"]["max"]
    opened = f"{number(1e3 * drawer['opened_m'], 1)} mm of {number(1e3 * drawer['asked_m'], 1)} mm"
    command = f"`{DRAWER.command(PRESET)} --simulate`"
    return [
        ["drawer in physics: opened by the robot, pulled by the person", "done",
         f"{opened}, {number(100 * drawer['opened_share'], 1)} %", command],
        ["drawer in physics: largest difference at any time, left open", "–",
         f"{number(1e3 * drawer['error_m']['max'], 1)} mm, {number(1e3 * drawer['left_open_m'], 1)} mm", command],
        ["drawer in physics: joints, torques at their limits", "–",
         f"{number(joint, 3)} rad, {number(100 * p.simulation['torque_to_limit']['saturated_share'], 1)} %", command],
    ]  # fmt: skip


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
    p = play(PRESET, DRAWER, observe=contact, simulate=True)
    in_contact, seen = hands(p)
    unplaced, searched = (play(PRESET, case, observe=contact) for case in (UNPLACED, SEARCHED))
    found = ", ".join(number(x, 3) for x in searched.observed[-1, 12:15])
    velocity = np.diff(seen[:, :, 3:], axis=0) * p.motion.rate_hz
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
        ["ROMEO in contact: hands", "same", in_contact],
        ["hand targets: largest speed; largest change of velocity from frame to frame", "–",
         f"{number(np.linalg.norm(velocity, axis=2).max())} m/s, "
         f"{number(np.linalg.norm(np.diff(velocity, axis=0), axis=2).max(), 3)} m/s"],
        ["joint limits passed, self-collisions", "none",
         f"{p.figures['joint_limit_violation_frames']['count']}, {p.figures['self_collision_frames']['count']} frames"],
        ["frames changed by `fcl_collision`", "–", f"{p.observed[-1, 15]:.0f} of {len(p.run)}"],
    ]  # fmt: skip
    more = [
        ["the same, robot at the person's place", "–", hands(unplaced)[0], f"`{UNPLACED.command(PRESET)}`"],
        [f"the same, placement searched for: {found} m", "–", hands(searched)[0], f"`{SEARCHED.command(PRESET)}`"],
        *physics_rows(p),
    ]  # fmt: skip
    text = [
        f"Tasks: {', '.join(f'`{t}`' for t in tasks)}; 19 builds.\n",
        table(["", "paper", "ours", "command"], [*([*r, command] for r in rows), *more]),
        figure_drawer(p), figure_8(build_mean), figure_6(robot),
    ]  # fmt: skip
    print("\n".join(text))
    print(f"wrote {write(DOCS, PRESET, PROGRAM, chr(10).join(text))}")


def figure_drawer(p: Played) -> str:
    """Draw how far the drawer is open, pulled by the person and by the robot in physics."""
    asked, opened = (
        1e3 * np.linalg.norm(s[:, 0], axis=1) for s in (p.trace.object_shift_asked, p.trace.object_shift)
    )
    lines = [Line(p.time_s, asked, "person", BLUE), Line(p.time_s, opened, "robot in physics", RED)]
    panel = Panel("drawer", "time (s)", "open (mm)", lines)
    return figure(
        DOCS,
        PRESET,
        "drawer",
        [panel],
        (800, 380),
        1,
        "How far the drawer is open, person and simulated robot",
    )


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
