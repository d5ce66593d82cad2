"""List what is installed: plugins by kind, robots, skeletons, marker sets, presets.

KIND is one of source, filter, mapper, stabilizer, solver, postprocessor, sink, robots, skeletons, markersets,
presets; without it, all are listed. Plugins that could not be loaded are listed with the reason.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from imitor.cli import common
from imitor.cli.tables import table
from imitor.errors import ImitorError
from imitor.kinds import KINDS
from imitor.registry import BUILTIN, Registry
from imitor.spec.cards import hint_for

CARDS = {"robots": "robots", "skeletons": "skeletons", "markersets": "markersets", "presets": "pipelines"}
"""Name a user types -> folder of the registry."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("kind", metavar="KIND", nargs="?", help="what to list")
    common.add_without(parser)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    legal = [*KINDS, *CARDS]
    kind = args.kind
    if kind is not None and kind not in legal:
        # The singular of a card and the plural of a kind are what people type too.
        kind = {f"{k}s": k for k in KINDS}.get(kind) or {c.removesuffix("s"): c for c in CARDS}.get(kind)
        if kind is None:
            raise ImitorError(f"there is no kind '{args.kind}'; {hint_for(args.kind, legal)}")
    registry = common.make_registry(args.without)
    wanted = legal if kind is None else [kind]
    print("\n\n".join(filter(None, [_section(word, registry, headed=kind is None) for word in wanted])))
    if registry.failures:
        print("\nnot loaded")
        print(table([[f.plugin, f.module, f.error] for f in registry.failures]))
    return 0


def _section(word: str, registry: Registry, *, headed: bool) -> str:
    if word in KINDS:
        rows = [[r.name, r.component.summary() + _origin(r.origin)] for r in registry if r.kind == word]
        title = f"{word} plugins"
    else:
        rows = [[name, title_of(path)] for name, path in sorted(registry.cards(CARDS[word]).items())]
        title = word
    if not rows:
        return f"{title}: none" if headed else "none"
    return f"{title}\n{table(rows)}" if headed else table(rows, indent="")


def _origin(origin: str) -> str:
    return "" if origin.startswith(f"{BUILTIN}.") else f" ({origin})"


def title_of(path: Path) -> str:
    """Return a one-line title of a card or preset: its ``title:``, ``name:`` or first comment."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return "(cannot be read)"
    for line in lines:
        key, colon, value = line.partition(":")
        if colon and key == "title":
            return value.strip().strip("'\"")
    comments = [line.lstrip("# ") for line in lines if line.startswith("#")]
    return next((c for c in comments if c and not c.startswith("yaml-language-server")), "")
