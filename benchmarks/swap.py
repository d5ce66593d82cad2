"""Every mapper with every stabilizer, solver and robot: what runs, what stands, and what the builder refuses.

    python benchmarks/swap.py [--mapper M]... [--stabilizer S]... [--solver S]... [--robot R]... [--seconds S]

Each combination is a preset with parts swapped on the command line (``--use``, ``--set``), so a user can repeat it. It
runs on the first seconds of three clips: two of the performer and, where there are captures (--captures, or ``mocap``
in the folder that IMITOR_SHARED names), one of a real person; a mapper that needs rigid targets has those of the
performer alone. Writes ``docs/swap.md`` when nothing is left out.
"""

from __future__ import annotations

import argparse
import itertools
import os
import shlex
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import imitor  # noqa: F401  (sets one BLAS thread before numpy is used)
from imitor import metrics
from imitor.atomic import atomic
from imitor.errors import ImitorError, SpecError
from imitor.kinds import RunInfo
from imitor.pipeline import Pipeline
from imitor.record import Recorder
from imitor.registry import Registry
from imitor.spec import load_pipeline

ROOT = Path(__file__).resolve().parents[1]
SEGMENTS = (
    "[left_upper_arm, right_upper_arm, left_forearm, right_forearm, left_thigh, right_thigh, left_shank, right_shank, "
    "torso, waist, chest]"
)
# In `balance`, the CoM stands between feet and trunk. Legs as straight as the human's leave no way down, so the posture
# bends them; a limit of its own would keep it from undoing what `posture` did, so the guard limits both together.
WITH_COM = "balance.order=[[left_foot, right_foot, left_sole, right_sole], [com], [waist]]"
BALANCED = ("posture.null_space={}", "balance.null_space={}")
STRAIGHT = ("balance.null_space={posture: -0.1}", "balance.damping=0.003", "balance.speed_limits=false")
MAPPERS = ("segment_scaling", "tpose_offset", "normalized_model", "virtual_marker_fit")
SCALED = ("segment_scaling", "normalized_model")
"""Mappers whose feet are given in the world; they declare the same tasks, `normalized_model` some more."""
WEARING = ("virtual_marker_fit",)
"""Mappers that need the rigid targets that the performer wears."""
WORN = ("source.targets=true",)
HANDS = "solve.order=[[left_hand, right_hand]]"
"""Of a mapper that leads hands and joints alone."""
ON_FEET = (
    "solve.order=[[left_foot, right_foot, left_ankle, right_ankle], [com], [head], [left_sole, right_sole], "
    "[left_hand, right_hand], [waist, chest]]"
)


@dataclass(frozen=True)
class Arrangement:
    """A preset that has these stabilizers in their places.

    Attributes:
        preset: The pipeline; its mapper is ``map``.
        solvers: Ids of its solvers.
        sets: Options that a mapper, a solver, or both together need: orders of the tasks that a mapper declares.
    """

    preset: str
    solvers: tuple[str, ...] = ("solve",)
    sets: Mapping[str, Sequence[str]] = field(default_factory=dict)


STABILIZERS = {
    "none": Arrangement(
        "retarget",
        sets={
            "virtual_marker_fit": (*WORN, HANDS, "solve.weights={}"),
            **{
                f"virtual_marker_fit {s}": ("solve.null_space={posture: -0.5}",)
                for s in ("prioritized", "placo")
            },
            "tpose_offset": [
                "solve.order=[[left_foot, right_foot], [left_hand, right_hand], [left_sole, right_sole]]",
                "solve.weights={}",
            ],
        },
    ),
    "com_offset, foot_retarget": Arrangement(
        "koenemann_2014",
        ("posture", "balance"),
        {
            **{
                key: [
                    f"posture.order=[[left_foot, right_foot, left_ankle, right_ankle], {SEGMENTS}]",
                    "balance.order=[[left_foot, right_foot], [com], [waist]]",
                ]
                for key in SCALED
            },
            "virtual_marker_fit": WORN,
            **dict.fromkeys(("tpose_offset prioritized", "tpose_offset placo"), (WITH_COM, *BALANCED)),
            **{f"{m} {s}": (BALANCED[0], *STRAIGHT) for m in SCALED for s in ("prioritized", "placo")},
        },
    ),
    "support_transition": Arrangement(
        "penna_poubel_2014",
        sets={
            "tpose_offset": [
                "solve.order=[[com], [left_foot, right_foot, left_sole, right_sole], [waist_height, waist], "
                "[left_hand, right_hand]]"
            ],
            "virtual_marker_fit": WORN,
        },
    ),
    "com_anticipation": Arrangement(
        "montecillo_2010",
        sets={
            **dict.fromkeys(("segment_scaling", "tpose_offset"), (ON_FEET,)),
            "virtual_marker_fit": WORN,
        },
    ),
    "contact_transition": Arrangement(
        "tomic_2018",
        sets=dict.fromkeys(MAPPERS, ("contact.object=null", "contact.placement_m=[0, 0, 0]")),
    ),
}
SOLVERS = ("prioritized", "damped_least_squares", "placo")
ROBOTS = ("nao_v4", "unitree_g1", "romeo", "talos", "hrp2")
SCENARIOS = ("step_forward", "slow_dance")
CAPTURE = "kinect_v2_irds/216_18_6_1_1_stand.csv"


class Refused(Exception):
    """The builder does not take a combination; says why."""


@dataclass
class Outcome:
    """What became of a combination.

    Attributes:
        stands: Least share of frames with the CoM over the feet that touch, over the clips [-].
        faults: What must not be: numbers that are none, limits left, stages that failed.
        refused: Why the builder refuses it.
    """

    stands: float = 1.0
    faults: list[str] = field(default_factory=list)
    refused: str = ""


@dataclass(frozen=True)
class Combination:
    """One row of the table, on any robot."""

    mapper: str
    stabilizer: str
    solver: str

    def of(self, clips: Sequence[str | Path]) -> list[str | Path]:
        """Return the clips that have what the mapper needs."""
        return [c for c in clips if isinstance(c, str) or self.mapper not in WEARING]

    def options(self) -> tuple[str, list[str], list[str]]:
        """Return preset, ``--use`` and ``--set``."""
        plan, mine = STABILIZERS[self.stabilizer], {self.mapper, self.solver}
        uses = [f"map={self.mapper}", *(f"{name}={self.solver}" for name in plan.solvers)]
        sets = [s for words, needed in plan.sets.items() if mine.issuperset(words.split()) for s in needed]
        return plan.preset, uses, sets

    def command(self, robot: str) -> str:
        """Return what a user types."""
        preset, uses, sets = self.options()
        words = [f"--use {u}" for u in uses] + [f"--set {shlex.quote(s)}" for s in sets]
        return f"imitor run {preset} --robot {robot} " + " ".join(words)

    def run(self, registry: Registry, robot: str, clip: str | Path, seconds: float) -> dict[str, Any]:
        """Run one clip and return its figures.

        Raises:
            Refused: The builder does not take it.
            ImitorError: A stage failed.
        """
        preset, uses, sets = self.options()
        recording = clip if isinstance(clip, Path) else None
        more = [] if isinstance(clip, Path) else [f"source.scenario={clip}"]
        try:
            spec = load_pipeline(
                preset, registry, robot=robot, input=recording, uses=uses, sets=[*more, *sets]
            )
            pipeline = Pipeline(spec, registry)
        except SpecError as error:
            problem = error.problems[0]
            raise Refused(
                f"{problem.where}: {problem.message}" if problem.where else problem.message
            ) from error
        except ImitorError as error:
            raise Refused(str(error)) from error
        frames = round(seconds * pipeline.rate_hz)
        parts = pipeline.robot, pipeline.skeleton, pipeline.rate_hz, pipeline.stack
        recorder = Recorder(RunInfo(Path(), *parts, frames))
        for record in pipeline.records(frames):
            recorder.add(record)
        pipeline.close()
        motion, reference = recorder.motion(), recorder.reference()
        figures: dict[str, Any] = metrics.evaluate(motion, reference, pipeline.robot, collision_every=0)[
            "figures"
        ]
        return figures


def outcome(
    combination: Combination, registry: Registry, robot: str, clips: Sequence[str | Path], seconds: float
) -> Outcome:
    """Run a combination on all clips."""
    found = Outcome()
    for clip in combination.of(clips):
        name = clip if isinstance(clip, str) else clip.name
        try:
            figures = combination.run(registry, robot, clip, seconds)
        except Refused as error:
            found.refused = str(error)
            return found
        except ImitorError as error:
            found.faults.append(f"{name}: {error}")
            continue
        for key, text in (
            ("joint_limit_violation_frames", "outside joint limits"),
            ("joint_overspeed_frames", "too fast"),
        ):
            count = figures.get(key, {}).get("count", 0)
            if count:
                found.faults.append(f"{name}: {count} frames {text}")
        found.stands = min(found.stands, standing_share(figures))
    return found


def standing_share(figures: Mapping[str, Any]) -> float:
    """Return the share of frames with the CoM inside the polygon of the feet that touch; flight counts as outside."""
    support = [figures.get(f"com_margin_{s}_support_m", {}) for s in ("single", "double")]
    frames = sum(f.get("frames", 0) for f in support) + figures["flight_frames"]["count"]
    return float(sum(f.get("inside", 0) for f in support) / max(frames, 1))


def tried(what: tuple[Combination, str], clips: Sequence[str | Path], seconds: float) -> Outcome:
    """Run a combination on a robot, in any process."""
    combination, robot = what
    return outcome(combination, Registry(entry_points=False), robot, clips, seconds)


# ------------------------------------------------------------------ the table


def cell(found: Outcome) -> str:
    """Return what the table says."""
    if found.refused:
        return "refused"
    if found.faults:
        return "**fails**"
    return f"{100 * found.stands:.4g} %"


def page(
    results: Mapping[Combination, Mapping[str, Outcome]],
    robots: Sequence[str],
    clips: Sequence[str | Path],
    seconds: float,
) -> str:
    """Return the page as Markdown."""
    names = ", ".join(f"`{c}`" if isinstance(c, str) else f"the capture {c.name}" for c in clips)
    lines = [
        "<!-- Written by: python benchmarks/swap.py -->\n",
        "# Parts in every combination\n",
        "Mapper, stabilizers, solver and robot are swapped by options alone. Each cell is the least share of frames",
        f"with the CoM over the feet that touch the floor, over the first {seconds:g} s of {names};",
        "no frame is outside joint or speed limits unless it says so. Without a stabilizer nothing holds the CoM. What",
        "cannot work is refused before anything runs. `virtual_marker_fit` needs the rigid targets that the performer",
        "wears: it runs on the performer's clips alone. `contact_transition` has nothing to hold in these clips: the",
        "hands go their own ways.\n",
        "| mapper | stabilizers | solver | " + " | ".join(robots) + " |",
        "| --- | --- | --- |" + " --- |" * len(robots),
    ]
    reasons: dict[str, list[str]] = {}
    for row, found in results.items():
        told = " | ".join(cell(found[robot]) for robot in robots)
        lines.append(f"| {row.mapper} | {row.stabilizer} | {row.solver} | {told} |")
        for robot in robots:
            title = f"{row.mapper}, {row.stabilizer}, {row.solver}"
            if found[robot].refused:
                reasons.setdefault(f"{title}: {found[robot].refused}", [])
            for fault in found[robot].faults:
                reasons.setdefault(f"{title}: {fault}", []).append(robot)
    if reasons:
        lines.append("\nReasons:\n")
        lines += [f"- {why}" + (f" ({', '.join(on)})" if on else "") for why, on in reasons.items()]
    lines.append("\nA row as a command, the robot being free to choose:\n\n```console")
    seen = set()
    for row, found in results.items():
        if (row.mapper, row.stabilizer) not in seen and not any(f.refused for f in found.values()):
            seen.add((row.mapper, row.stabilizer))
            lines.append(f"$ {row.command(robots[0])}")
    return "\n".join([*lines, "```"]) + "\n"


def main() -> None:
    """Run all combinations, print a line each, write the page."""
    args = arguments()
    folder = args.captures or Path(os.environ.get("IMITOR_SHARED", "")) / "mocap"
    capture = folder / CAPTURE
    clips: list[str | Path] = [*SCENARIOS, *([capture] if capture.is_file() else [])]
    robots = args.robots or ROBOTS
    rows = itertools.product(
        args.mappers or MAPPERS, args.stabilizers or STABILIZERS, args.solvers or SOLVERS
    )
    results: dict[Combination, dict[str, Outcome]] = {Combination(*parts): {} for parts in rows}
    cells = [(row, robot) for row in results for robot in robots]
    with ProcessPoolExecutor(args.jobs) as pool:
        found_all = pool.map(partial(tried, clips=clips, seconds=args.seconds), cells)
        for (row, robot), found in zip(cells, found_all, strict=True):
            results[row][robot] = found
            more = [found.refused] if found.refused else found.faults
            print(" | ".join([row.mapper, row.stabilizer, row.solver, robot, cell(found), *more]), flush=True)
    if args.docs or not (args.mappers or args.stabilizers or args.solvers or args.robots):
        path = (args.docs or ROOT / "docs") / "swap.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic(path) as temporary:
            temporary.write_text(page(results, robots, clips, args.seconds), encoding="utf-8")
        print(f"wrote {path}")


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mapper", action="append", dest="mappers", choices=MAPPERS)
    parser.add_argument("--stabilizer", action="append", dest="stabilizers", choices=list(STABILIZERS))
    parser.add_argument("--solver", action="append", dest="solvers", choices=SOLVERS)
    parser.add_argument("--robot", action="append", dest="robots")
    parser.add_argument("--seconds", type=float, default=3.0, help="length of each run [s]")
    parser.add_argument("--jobs", type=int, default=1, help="cells that run at the same time")
    parser.add_argument("--captures", type=Path, help="folder of captures")
    parser.add_argument("--docs", type=Path, help="the folder of the documentation to write to")
    return parser.parse_args()


if __name__ == "__main__":
    main()
