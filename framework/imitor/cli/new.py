"""Write a new plugin: a package with a working component of a kind, its test, and its entry point.

Afterwards: pip install -e DIR, then imitor list. Nothing is overwritten.
"""

from __future__ import annotations

import argparse
import keyword
import re
from pathlib import Path

from imitor.errors import ImitorError
from imitor.kinds import KINDS
from imitor.spec.cards import hint_for


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("kind", metavar="KIND", help=f"one of {', '.join(KINDS)}")
    parser.add_argument("name", metavar="NAME", help="name of the plugin in YAML, e.g. my_filter")
    parser.add_argument("--dir", metavar="DIR", type=Path, help="folder to write (default: ./NAME)")


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    from imitor.cli.templates import plugin_files

    if args.kind not in KINDS:
        raise ImitorError(f"there is no kind '{args.kind}'; {hint_for(args.kind, KINDS)}")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", args.name) or keyword.iskeyword(args.name):
        raise ImitorError(f"'{args.name}' cannot be a plugin's name; use lower-case letters, digits and _")
    folder = args.dir or Path(args.name)
    files = plugin_files(args.kind, args.name)
    existing = [str(folder / name) for name in files if (folder / name).exists()]
    if existing:
        raise ImitorError(f"already there: {', '.join(existing)}; nothing was written, choose another --dir")
    try:
        for name, text in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as file:
                file.write(text)
            print(f"wrote {path}")
    except OSError as error:
        raise ImitorError(f"cannot write to {folder}: {error.strerror}") from None
    print(f"next: pip install -e {folder} && python -m pytest {folder}")
    return 0
