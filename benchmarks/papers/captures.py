"""Every shared recording with markers, through the presets that work from markers: what runs, how well, what does not.

    python benchmarks/papers/captures.py [--preset P]... [--frames N] [--jobs N] [--docs DIR] [--set X=Y]... [FILE ...]

Runs each C3D, TRC, AMC and ART file as ``imitor run PRESET --input FILE`` does, and writes a table into the page of
each preset; with files or options of your own it prints the tables and writes nothing unless --docs names a folder.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from experiment import number, shared_folder
from page import DOCS, table, write

import imitor  # noqa: F401  (sets one BLAS thread before numpy is used)
from imitor.errors import ImitorError, SpecError
from imitor.metrics.run import Run
from imitor.pipeline import Pipeline
from imitor.record import MOTION_FILE, REFERENCE_FILE, Motion, Reference
from imitor.registry import Registry
from imitor.run import run
from imitor.spec import load_pipeline
from imitor.types import SIDES

PROGRAM = "benchmarks/papers/captures.py"
PATTERNS = ("*/*.c3d", "*/*.trc", "*/*.amc", "art_*/*-*.txt")


@dataclass
class Attempt:
    """A recording in a preset.

    Attributes:
        file: Path in the folder of captures.
        card: Marker set or skeleton that was recognised; empty when the file was refused before that.
        length_s: Of the recording [s].
        status: ``done``, ``stopped``, ``failed``, or ``refused`` when nothing was run.
        message: Why it is not ``done``.
        figures: As in ``metrics.json``.
        cells: Its columns of the table; none when no frame was finished.
    """

    file: str
    card: str = ""
    length_s: float = 0.0
    status: str = "refused"
    message: str = ""
    figures: dict[str, Any] = field(default_factory=dict)
    cells: list[str] = field(default_factory=list)


def attempt(file: str, preset: str, sets: Sequence[str], captures: Path, frames: int | None) -> Attempt:
    """Run a recording and measure it."""
    out = Attempt(file)
    registry = Registry(entry_points=False)

    def started(pipeline: Pipeline) -> None:
        out.card = pipeline.skeleton.name
        out.length_s = ((pipeline.source.n_frames or 1) - 1) / pipeline.source.rate_hz
        robots.append(pipeline.robot)

    robots: list[Any] = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            spec = load_pipeline(preset, registry, input=captures / file, sets=sets)
            result = run(spec, registry, out_dir=Path(folder), max_frames=frames, started=started)
        except SpecError as error:
            out.message = "; ".join(f"{p.where}: {p.message}" for p in error.problems)
            return out
        except ImitorError as error:
            out.message = shortened(str(error).replace(f"{captures}/", ""))
            return out
        out.status, out.message = result.status, shortened(result.message.replace(f"{captures}/", ""))
        if result.metrics:
            out.figures = result.metrics["figures"]
            motion = Motion.load(result.out_dir / MOTION_FILE)
            done = Run(motion, Reference.load(result.out_dir / REFERENCE_FILE), robots[0], 0)
            out.cells = [column(out, done) for column in COLUMNS[preset].values()]
    return out


def shortened(text: str, most: int = 240) -> str:
    """Return the first words of a message on one line."""
    words = " ".join(text.split())
    return words if len(words) <= most else words[:most].rsplit(" ", 1)[0] + " …"


# ------------------------------------------------------------------ columns

Column = Callable[[Attempt, Run], str]


def value(found: Attempt, name: str, key: str = "mean", scale: float = 1.0, digits: int = 1) -> str:
    """Return a figure as text, or a dash where it was not measured."""
    measured = found.figures.get(name, {}).get(key)
    return "–" if measured is None else number(scale * measured, digits)


def count(found: Attempt, *names: str) -> str:
    """Return a sum of counted frames."""
    return str(sum(found.figures.get(name, {}).get("count", 0) for name in names))


def direction(found: Attempt, done: Run) -> str:
    """Return the mean direction error and that of the worst segment [deg]."""
    worst = found.figures.get("direction_error_deg", {}).get("worst_segment", "–").replace("_", " ")
    key = "worst_segment_mean"
    return f"{value(found, 'direction_error_deg')}; {worst} {value(found, 'direction_error_deg', key)}"


def com(found: Attempt, done: Run) -> str:
    """Return how far the robot's CoM is from its target over the floor, root mean square and most [mm]."""
    off = 1e3 * np.linalg.norm((done.path.com - done.reference.target["com"])[:, :2], axis=1)
    off = off[done.reference.target_active["com"]]
    return f"{number(np.sqrt(np.mean(off**2)), 1)}, {number(off.max(), 1)}" if off.size else "–"


def feet(found: Attempt, done: Run) -> str:
    """Return the mean error of the left and right foot from its hip [mm]."""
    return ", ".join(value(found, f"end_effector_error_{side}_foot_m", scale=1e3, digits=0) for side in SIDES)


def hands(found: Attempt, done: Run) -> str:
    """Return the mean error of the left and right hand from its shoulder [mm]."""
    return ", ".join(value(found, f"end_effector_error_{side}_hand_m", scale=1e3, digits=0) for side in SIDES)


def arms(found: Attempt, done: Run) -> str:
    """Return the mean direction error of the upper arms and of the forearms, both sides [deg]."""
    means = [
        [found.figures.get(f"direction_error_{side}_{part}_deg", {}).get("mean") for side in SIDES]
        for part in ("upper_arm", "forearm")
    ]
    return ", ".join("–" if None in pair else number(sum(pair) / len(pair), 1) for pair in means)


def human_hands(found: Attempt, done: Run) -> str:
    """Return the largest speed of the person's hands [m/s]."""
    reference = done.reference
    roles = [list(reference.role_names).index(f"{side}_hand") for side in SIDES]
    moved = np.linalg.norm(np.diff(reference.role_position_m[:, roles], axis=0), axis=2)
    speed = moved / np.diff(reference.time_s)[:, None]
    return number(float(np.nanmax(speed)), 1)


def hand_targets(found: Attempt, done: Run) -> str:
    """Return how far the robot's hands are from their targets, root mean square and most [mm]."""
    off = np.concatenate(
        [
            np.linalg.norm(
                done.path.point[f"{s}_hand"] - done.reference.target[f"{s}_hand"][:, :3, 3], axis=1
            )
            for s in SIDES
        ]
    )
    return f"{number(1e3 * np.sqrt(np.mean(off**2)), 1)}, {number(1e3 * off.max(), 1)}"


def inside(found: Attempt, done: Run) -> str:
    """Return the share of frames with the CoM over the feet that touch [%] and its least margin [mm]."""
    kinds = [found.figures.get(f"com_margin_{s}_support_m", {}) for s in ("single", "double")]
    frames = sum(k.get("frames", 0) for k in kinds) + found.figures["flight_frames"]["count"]
    if not frames or not any(k.get("frames") for k in kinds):
        return "no foot on the floor"
    least = min(k["min"] for k in kinds if k.get("frames"))
    return f"{100 * sum(k.get('inside', 0) for k in kinds) / frames:.4g} %, {number(1e3 * least, 0)}"


def supports(found: Attempt, done: Run) -> str:
    """Return how many changes of the human's support the robot followed."""
    measured = found.figures.get("support_delay_s", {})
    if "changes" not in measured:
        return "–"
    return f"{measured['changes'] - measured['missed']} of {measured['changes']}"


def slip(found: Attempt, done: Run) -> str:
    """Return the slip of feet that stand, mean and most [mm/s]."""
    name = "foot_slip_declared_contact_m_s"
    return f"{value(found, name, scale=1e3)}, {value(found, name, 'max', 1e3, 0)}"


def limits(found: Attempt, done: Run) -> str:
    """Return the frames outside joint limits or too fast."""
    return count(found, "joint_limit_violation_frames", "joint_overspeed_frames")


def collisions(found: Attempt, done: Run) -> str:
    """Return the frames with a self-collision."""
    return count(found, "self_collision_frames")


def held(found: Attempt, done: Run) -> str:
    """Return the frames in which the robot was held, and those after it was stopped."""
    status = list(done.motion.status)
    return f"{status.count('held')}, {status.count('stopped')}"


COMMON: dict[str, Column] = {
    "outside limits (frames)": limits,
    "self-collision (frames)": collisions,
    "held, stopped (frames)": held,
}
COLUMNS: dict[str, dict[str, Column]] = {
    "montecillo_2010": {
        "direction error, worst segment (°)": direction,
        "CoM from its target, RMS, most (mm)": com,
        "feet from their hips, left, right (mm)": feet,
        "changes of support followed": supports,
        "CoM inside, least margin (mm)": inside,
        "slip of standing feet, mean, most (mm/s)": slip,
        **COMMON,
    },
    "tomic_2018": {
        "person's hands, fastest (m/s)": human_hands,
        "direction error, upper arms, forearms (°)": arms,
        "hands from their targets, RMS, most (mm)": hand_targets,
        "hands from their shoulders, left, right (mm)": hands,
        **COMMON,
    },
}


def tables(preset: str, sets: Sequence[str], found: Sequence[Attempt]) -> str:
    """Return the table of what ran, and the list of what did not."""
    columns = COLUMNS[preset]
    rows, reasons = [], dict[str, list[str]]()
    for a in found:
        told = a.status if a.status == "done" else f"{a.status}: {a.message}"
        if not a.cells:
            reasons.setdefault(told, []).append(f"`{a.file}`" + (f" ({a.card})" if a.card else ""))
            continue
        rows.append([f"`{a.file}`", a.card, number(a.length_s, 1), told, *a.cells])
    options = "".join(f" --set {s}" for s in sets)
    text = [
        f"`imitor run {preset} --input FILE{options}`: {len(rows)} of {len(found)} recordings run.\n",
        table(["file", "set", "length (s)", "run", *columns], rows),
    ]
    if reasons:
        text.append("Not run:\n")
        text.append("\n".join(f"- {why}: {', '.join(files)}" for why, files in reasons.items()))
    return "\n".join(text)


def main() -> None:
    """Run what is asked for, print the tables and write the pages."""
    args = arguments()
    captures = shared_folder(args.captures)
    if captures is None:
        raise SystemExit("no folder of captures: give --captures, or set IMITOR_SHARED")
    files = args.files or sorted(
        str(p.relative_to(captures)) for pattern in PATTERNS for p in captures.glob(pattern)
    )
    for preset in args.presets or COLUMNS:
        found, sets = [], args.sets
        with ProcessPoolExecutor(args.jobs) as pool:
            tried = partial(attempt, preset=preset, sets=sets, captures=captures, frames=args.frames)
            for a in pool.map(tried, files):
                print(f"{preset}: {a.file}: {a.status} {a.message}", flush=True)
                found.append(a)
        text = tables(preset, sets, found)
        print("\n" + text)
        if args.docs or not (args.files or args.frames or args.sets):
            print(f"wrote {write(args.docs or DOCS, preset, PROGRAM, text)}")


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", metavar="FILE", help="recordings, in the folder of captures")
    parser.add_argument("--preset", action="append", dest="presets", choices=list(COLUMNS))
    parser.add_argument("--captures", type=Path, help="folder of captures; default: mocap in IMITOR_SHARED")
    parser.add_argument("--frames", type=int, help="only the first frames")
    parser.add_argument("--set", action="append", default=[], dest="sets", help="change an option")
    parser.add_argument("--jobs", type=int, default=1, help="recordings that run at the same time")
    parser.add_argument("--docs", type=Path, help="folder of the documentation to write to")
    return parser.parse_args()


if __name__ == "__main__":
    main()
