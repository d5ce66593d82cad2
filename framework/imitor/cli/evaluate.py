"""Measure a finished run again, from the files in its folder.

Prints the measured quality as a table, or with --json everything that was measured.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from imitor.cli import common
from imitor.cli.quality_table import quality_table
from imitor.errors import ImitorError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("dir", metavar="DIR", type=Path, help="folder that a run has written")
    parser.add_argument("--json", action="store_true", help="print JSON")
    common.add_without(parser)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    if not args.dir.is_dir():
        raise ImitorError(
            f"{args.dir}: there is no such folder; give the folder that a run has written (--out)"
        )
    from imitor.metrics import evaluate_dir

    metrics = evaluate_dir(args.dir, common.make_registry(args.without))
    print(json.dumps(metrics, indent=2) if args.json else quality_table(metrics))
    return 0
