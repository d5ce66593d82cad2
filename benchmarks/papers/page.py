"""The page of a paper: tables, figures, and the part of it that a program writes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Played, number, support_summary
from supports import phases

from imitor.atomic import atomic
from imitor.types import BoolArray
from imitor.visual.panels import Strip
from imitor.visual.plot import draw

DOCS = Path(__file__).resolve().parents[2] / "docs"
MODE_COLOUR = {
    "double": (222, 226, 231),
    "left": (143, 196, 232),
    "right": (246, 190, 140),
    "flight": (255, 255, 255),
}
_END = "<!-- End of the written part. -->"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "".join(f"| {' | '.join(line)} |\n" for line in [head, ["---"] * len(head), *rows])


def image(docs: Path, preset: str, name: str, picture: Any, text: str) -> str:
    """Save a figure beside the page and return its Markdown."""
    path = docs / "img" / "papers" / f"{preset}_{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic(path) as temporary:
        picture.save(temporary, format="PNG", optimize=True)
    return f"![{text}](../img/papers/{path.name})\n"


def figure(
    docs: Path, preset: str, name: str, panels: Sequence[Any], size: tuple[int, int], columns: int, text: str
) -> str:
    """Draw panels, save them and return their Markdown."""
    return image(docs, preset, name, draw(panels, size, columns), text)


def strips(played: Played) -> list[Strip]:
    """Return the bars of support of human and robot over time; the robot's shades the axes."""
    return [
        Strip("human", spans(played, played.human_support)),
        Strip("robot", spans(played, played.motion.contact), shade=True),
    ]


def spans(played: Played, support: BoolArray) -> list[tuple[float, float, tuple[int, int, int], str]]:
    """Return (begin, end, colour, text) of each phase of support [s]."""
    edges = np.append(played.time_s, played.time_s[-1])
    return [
        (
            float(edges[p.first]),
            float(edges[p.last + 1]),
            MODE_COLOUR[p.mode],
            p.mode if p.mode != "flight" else "",
        )
        for p in phases(support)
    ]


def write(docs: Path, preset: str, program: str, text: str) -> Path:
    """Put the written part into the preset's page, between its markers or at the end; return the page."""
    path = docs / "presets" / f"{preset}.md"
    begin = f"<!-- Written by: python {program} -->"
    part = f"{begin}\n\n{text.strip()}\n\n{_END}"
    page = path.read_text(encoding="utf-8") if path.is_file() else f"# {preset}\n"
    old = re.compile(re.escape(begin) + r".*?" + re.escape(_END), re.DOTALL)
    page = old.sub(lambda _: part, page) if old.search(page) else f"{page.rstrip()}\n\n{part}\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def run_tables(
    preset: str, played: Sequence[Played], heads: Sequence[str], cells: Callable[[Played], list[str]]
) -> list[str]:
    """Return the table of all runs, and the verdict of physics on each.

    Args:
        heads, cells: Columns of this paper alone, between the length and the support.
    """
    head = [
        "run", "frames", *heads, "single supports executed", "delay mean, max (s)",
        "single support: CoM inside, least margin (mm)", "double support", "self-collision (frames)",
        "ms (units) a frame",
    ]  # fmt: skip
    rows = []
    for p in played:
        hit = p.figures.get("self_collision_frames", {})
        name = f"`{p.case.title}`" if p.case.title == p.case.scenario else p.case.title
        ms = p.ms().mean()
        time = f"{ms:.2f} ({1e-3 * ms / p.unit_s:.1f})"
        rows.append(
            [
                name,
                str(len(p.run)),
                *cells(p),
                *support_summary(p),
                *_balance(p),
                str(hit.get("count", "–")),
                time,
            ]
        )
    out = ["Each run, at its real speed unless said otherwise:\n", table(head, rows)]
    if any(p.simulation for p in played):
        head = ["command", "fell", "largest joint error (rad)", "ZMP inside", "a torque at its limit"]
        rows = [[f"`{p.case.command(preset)} --simulate`", *_physics(p)] for p in played if p.simulation]
        out += ["Executed by simulated servos, without any controller:\n", table(head, rows)]
    return out


def _balance(played: Played) -> list[str]:
    """Return share of frames with the CoM inside and its least margin [mm], in single and in double support."""
    out = []
    for support in ("single", "double"):
        found = played.figures.get(f"com_margin_{support}_support_m")
        if found is None:
            out.append("–")
            continue
        share = f"{100 * found['inside_share']:.4g} % of {found['frames']}"
        out.append(f"{share}, {number(1e3 * found['min'], 1)}")
    return out


def _physics(played: Played) -> list[str]:
    """Return what physics found: whether and when it fell, joint error, ZMP, torque."""
    v = played.simulation
    inside = v.get("zmp_inside_share")
    return [
        f"after {v['fall_time_s']:.2f} s" if v["fell"] else "no",
        number(v["joint_error_rad"]["max"], 3),
        "–" if inside is None else f"{100 * inside:.4g} %",
        f"{100 * v['torque_to_limit']['saturated_share']:.2g} % of the time",
    ]
