"""Run a pipeline: human motion in, robot motion out.

PIPELINE is the name of a preset (imitor list presets) or a YAML file. Results go to
a new folder, or to --out DIR.
Example: imitor run retarget --robot romeo --input walk.bvh --set solve.iterations=3 --sink video
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from imitor.cli import common
from imitor.cli.progress import Progress
from imitor.cli.quality_table import quality_table, simulation_text
from imitor.errors import ImitorError
from imitor.kinds import Source
from imitor.registry import Registry
from imitor.spec import PipelineSpec

if TYPE_CHECKING:
    from imitor.run import RunResult

SIMULATOR: Final = "mujoco"
VIEWER: Final = "rerun"
LIVE_VIEWER: Final = "rerun_live"
_WINDOWS: Final = (SIMULATOR, "mujoco_live", VIEWER, LIVE_VIEWER)
_EXIT: Final = {"done": 0, "failed": 1, "stopped": 1, "interrupted": 130}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("pipeline", metavar="PIPELINE", help="a preset's name or a YAML file")
    common.add_overrides(parser)
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for the results")
    parser.add_argument("--frames", metavar="N", type=_count, help="stop after N frames")
    parser.add_argument(
        "--sink",
        metavar="NAME",
        action="append",
        default=[],
        help="add a sink, e.g. video or rerun (repeatable)",
    )
    parser.add_argument("--view", action="store_true", help="show the robot while it moves")
    parser.add_argument("--simulate", action="store_true", help="execute the motion in a physics simulation")
    parser.add_argument("--live", action="store_true", help="insist on a live source")
    parser.add_argument("--arm", action="store_true", help="let robot sinks move a real robot")
    parser.add_argument("--quiet", action="store_true", help="print nothing but problems")


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"should be a whole number above 0, got '{text}'")
    return int(text)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    registry = common.make_registry(args.without)
    spec = _load(args, registry)
    if not args.quiet:
        for message in spec.dropped:
            print(message, file=sys.stderr)
    live = _is_live(spec, registry)
    result = _run_live(spec, registry, args) if live else _run_recorded(spec, registry, args)
    _report(result, quiet=args.quiet)
    return _EXIT[result.status]


def _is_live(spec: PipelineSpec, registry: Registry) -> bool:
    source = registry.get("source", spec.source.name)
    return issubclass(source, Source) and source.live


def _run_live(spec: PipelineSpec, registry: Registry, args: argparse.Namespace) -> RunResult:
    from imitor.cli.live_status import LiveStatus
    from imitor.live.operator import Operator
    from imitor.live.run import LiveRun
    from imitor.pipeline import Pipeline
    from imitor.run import run

    if not args.quiet:
        config = spec.source.config
        print(f"waiting for a sender at {config.host}:{config.port or 'a free port'}", file=sys.stderr)  # type: ignore[attr-defined]
    operator = Operator()
    with operator.keys() as keys, LiveStatus(quiet=args.quiet) as status, status.logged():

        def started(pipeline: Pipeline) -> None:
            if not args.quiet:
                print("\n".join(pipeline.skeleton.notes), file=sys.stderr)

        def observe(live: LiveRun) -> None:
            status.watch(live, keys=keys)

        return run(
            spec,
            registry,
            out_dir=args.out,
            max_frames=args.frames,
            view=args.view,
            started=started,
            operator=operator,
            observe=observe,
        )


def _run_recorded(spec: PipelineSpec, registry: Registry, args: argparse.Namespace) -> RunResult:
    from imitor.pipeline import Pipeline
    from imitor.run import run

    with Progress(rate_hz=spec.rate_hz, quiet=args.quiet) as progress, progress.logged():

        def started(pipeline: Pipeline) -> None:
            progress.rate_hz = pipeline.rate_hz
            for note in pipeline.skeleton.notes:
                progress.say(note)

        return run(
            spec,
            registry,
            out_dir=args.out,
            max_frames=args.frames,
            view=args.view,
            progress=progress,
            started=started,
        )


def _load(args: argparse.Namespace, registry: Registry) -> PipelineSpec:
    """Load the pipeline with what --simulate, --view, --live and --arm ask for."""
    sinks = list(args.sink)
    if args.simulate:
        sinks.append(_required_sink("--simulate", "robot sink", SIMULATOR, registry))
    spec = common.load(args.pipeline, args, registry, add_sinks=sinks)
    if args.view and not any(s.name in _WINDOWS for s in spec.sinks):
        viewer = LIVE_VIEWER if _is_live(spec, registry) else VIEWER
        sinks.append(_required_sink("--view", "sink", viewer, registry))
    sets = []
    if args.arm:
        sets = [f"{s.id}.armed=true" for s in spec.sinks if "armed" in type(s.config).model_fields]
        if not sets:
            raise ImitorError("--arm needs a sink that moves a real robot, and this pipeline has none")
    if args.live:
        _require_live(spec, registry)
    return (
        common.load(args.pipeline, args, registry, add_sinks=sinks, more_sets=sets) if sinks or sets else spec
    )


def _required_sink(option: str, what: str, name: str, registry: Registry) -> str:
    if registry.find("sink", name) is None:
        raise ImitorError(f"{option} needs the {what} '{name}', which is not installed here")
    return name


def _require_live(spec: PipelineSpec, registry: Registry) -> None:
    live = [r.name for r in registry if issubclass(r.component, Source) and r.component.live]
    if spec.source.name not in live:
        remedy = f"use --source NAME: {', '.join(live)}" if live else "none is installed here"
        raise ImitorError(f"--live needs a live source, and '{spec.source.name}' is not one; {remedy}")


def _report(result: Any, *, quiet: bool) -> None:
    """Print how the run ended, what was measured and where the files are."""
    if result.status != "done":
        print(f"{result.status}: {result.message}" if result.message else result.status, file=sys.stderr)
    if quiet:
        return
    if result.metrics:
        print(f"measured quality\n{quality_table(result.metrics, short=True)}")
        if "simulation" in result.metrics:
            print(simulation_text(result.metrics["simulation"]))
    print(f"{result.frames} frames in {result.out_dir}")
    for path in result.files:
        print(f"  {path.relative_to(result.out_dir) if path.is_relative_to(result.out_dir) else path}")
