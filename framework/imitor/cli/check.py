"""Validate pipelines without running them.

Says 'ok' for each pipeline that can run, and for the others every problem with its file, line and column.
"""

from __future__ import annotations

import argparse

from imitor.cli.common import add_overrides, load
from imitor.cli.tables import plural
from imitor.errors import Problem, SpecError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("pipelines", metavar="PIPELINE", nargs="+", help="a preset's name or a YAML file")
    add_overrides(parser)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    from imitor.cli import common

    registry = common.make_registry(args.without)
    problems: list[Problem] = []
    for name in args.pipelines:
        try:
            spec = load(name, args, registry)
        except SpecError as error:
            problems += error.problems
        else:
            for message in spec.dropped:
                print(message)
            print(f"ok: {spec.name} ({spec.robot}, {plural(len(spec.stages), 'stage')})")
    if problems:
        raise SpecError(list(dict.fromkeys(problems)))
    return 0
