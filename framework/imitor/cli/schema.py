"""Print or write the JSON Schema of a pipeline, for editors.

It covers the plugins installed here. In a pipeline file, name it in the first line:
# yaml-language-server: $schema=imitor.schema.json
"""

from __future__ import annotations

import argparse
from pathlib import Path

from imitor.cli import common
from imitor.errors import ImitorError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("--out", metavar="FILE", type=Path, help="write to a file instead of the terminal")
    common.add_without(parser)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    from imitor.spec.json_schema import schema_text, write_schema

    registry = common.make_registry(args.without)
    if args.out is None:
        print(schema_text(registry), end="")
        return 0
    try:
        write_schema(args.out, registry)
    except OSError as error:
        raise ImitorError(f"cannot write {args.out}: {error.strerror}") from None
    print(f"wrote {args.out}")
    return 0
