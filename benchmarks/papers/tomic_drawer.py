"""The drawer task of Tomic et al. (Robotica 2018) with ROMEO: preset tomic_2018 as it is, and in physics (T6 to T11).

    python benchmarks/papers/tomic_drawer.py

Runs the preset where it stands, where the drawer is out of reach, and where the search for a placement puts it, and
writes tables and a figure into ``docs/presets/tomic_2018.md``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from experiment import Case, Played, number, play
from page import DOCS, figure, table, write

from imitor.kinds import Record
from imitor.pipeline import Pipeline
from imitor.types import SIDES, Array
from imitor.visual.panels import BLUE, RED, Line, Panel

PRESET = "tomic_2018"
PROGRAM = "benchmarks/papers/tomic_drawer.py"
DRAWER = Case("drawer", "open_close_drawer")
UNPLACED = Case("from the person's place", "open_close_drawer", sets=("contact.placement_m=[0,0,0]",))
SEARCHED = Case(
    "placement searched for",
    "open_close_drawer",
    sets=("contact.placement_m=null", "contact.grip_rpy_rad=[-1.5708,-0.161,0.034]", "contact.rise_m=0.1"),
)


def contact(pipeline: Pipeline, record: Record) -> Array:
    """Return for both hands share of growth, distance [m] and angle [rad] from the person's, and the target (3,).

    After these come the placement of the robot, (3,) [m], and how many frames collisions changed so far.
    """
    stage: Any = {c.name: c for _, c in pipeline.stages}
    person = stage["virtual_marker_fit"].imitation.model.robot
    share, robot = stage["contact_transition"].share, pipeline.robot
    out: list[float] = []
    for i, side in enumerate(SIDES):
        role = f"{side}_hand"
        off = robot.position(role) - person.position(role)
        turn = pin.log3(person.rotation(role).T @ robot.rotation(role))
        out += [share[i], np.linalg.norm(off), np.linalg.norm(turn), *pipeline.stack[role].target[:3, 3]]
    return np.array([*out, *stage["contact_transition"].placement, stage["fcl_collision"].correction.changed])


def row(p: Played) -> list[str]:
    """Return how near the hands in contact are to the person's, how they move, and what else is kept."""
    seen = p.observed[:, :12].reshape(-1, 2, 6)
    full = (seen[:, :, 0] >= 1.0).all(axis=1)
    velocity = np.diff(seen[:, :, 3:], axis=0) * p.motion.rate_hz
    count = {
        name: p.figures[f"{name}_frames"]["count"] for name in ("joint_limit_violation", "self_collision")
    }
    return [
        ", ".join(number(x, 3) for x in p.observed[-1, 12:15]),
        f"{number(1e3 * seen[full, :, 1].max())} mm, {number(np.degrees(seen[full, :, 2].max()))}°, {full.sum()}",
        number(np.linalg.norm(velocity, axis=2).max()),
        number(np.linalg.norm(np.diff(velocity, axis=0), axis=2).max(), 3),
        f"{count['joint_limit_violation']}, {count['self_collision']}",
        f"{p.observed[-1, 15]:.0f} of {len(p.run)}",
        f"`{p.case.command(PRESET)}`",
    ]


def physics(p: Played) -> str:
    """Return the table of what the drawer did in physics."""
    drawer, verdict = p.simulation["objects"]["drawer"], p.simulation
    share = number(100 * drawer["opened_share"], 1)
    rows = [
        ["pulled by the person", f"{number(1e3 * drawer['asked_m'], 1)} mm"],
        ["opened by the robot", f"{number(1e3 * drawer['opened_m'], 1)} mm, {share} %"],
        ["largest difference at any time", f"{number(1e3 * drawer['error_m']['max'], 1)} mm"],
        ["left open at the end", f"{number(1e3 * drawer['left_open_m'], 1)} mm"],
        ["hands on the handle, of what was asked (hand-frames)",
         f"{drawer['held_hand_frames']} of {drawer['asked_held_hand_frames']}"],
        ["largest joint error", f"{number(verdict['joint_error_rad']['max'], 3)} rad"],
        ["pelvis off its place, largest", f"{number(1e3 * verdict['base_error_m']['max'], 3)} mm"],
        ["largest torque by its limit", f"{number(100 * verdict['torque_to_limit']['max'], 0)} %"],
    ]  # fmt: skip
    return table([f"`{p.case.command(PRESET)} --simulate`", "`simulation` of metrics.json"], rows)


def main() -> None:
    """Run everything and write the page."""
    runs = [
        play(PRESET, case, observe=contact, simulate=case is DRAWER) for case in (DRAWER, UNPLACED, SEARCHED)
    ]
    head = [
        "", "robot shifted by (m)", "hands in full size: off, turned, frames", "targets: largest speed (m/s)",
        "largest change of it in a frame (m/s)", "frames beyond joint limits, with self-collision",
        "changed by `fcl_collision`", "command",
    ]  # fmt: skip
    titles = ("the preset", "from the person's place", "placement searched for")
    text = [
        "ROMEO in the drawer task. Hands in full size have the person's path:\n",
        table(head, [[title, *row(p)] for title, p in zip(titles, runs, strict=True)]),
        "The drawer in physics:\n", physics(runs[0]), figure_drawer(runs[0]),
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


if __name__ == "__main__":
    main()
