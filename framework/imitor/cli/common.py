"""What several commands share: the registry, and the options that change a pipeline."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

from imitor.registry import Registry
from imitor.spec import PipelineSpec, load_pipeline


def make_registry(without: Iterable[str] = ()) -> Registry:
    """Return the registry of a command."""
    return Registry(without=without)


def add_without(parser: argparse.ArgumentParser) -> None:
    """Add the option that leaves plugins out."""
    parser.add_argument(
        "--without", metavar="PLUGIN", action="append", default=[], help="leave this plugin out"
    )


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add the options that change a pipeline."""
    parser.add_argument("--robot", metavar="R", help="another robot: a name (imitor list robots) or a card")
    parser.add_argument(
        "--input", metavar="FILE", type=Path, help="a recording, read by the source that knows it"
    )
    parser.add_argument("--source", metavar="NAME", help="the source to use, also for --input")
    parser.add_argument(
        "--set", metavar="ID.option=value", action="append", default=[], dest="sets", help="change an option"
    )
    parser.add_argument(
        "--use", metavar="ID=PLUGIN", action="append", default=[], dest="uses", help="swap a stage's plugin"
    )
    add_without(parser)


def load(
    name: str,
    args: argparse.Namespace,
    registry: Registry,
    *,
    add_sinks: Sequence[str] = (),
    more_sets: Sequence[str] = (),
) -> PipelineSpec:
    """Load a pipeline with the options of `add_overrides`."""
    return load_pipeline(
        name,
        registry,
        robot=args.robot,
        input=args.input,
        source=args.source,
        sets=[*args.sets, *more_sets],
        uses=args.uses,
        add_sinks=add_sinks,
    )
