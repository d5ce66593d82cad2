"""Work on robot cards: 'imitor robot check CARD' says what is wrong or improbable with one."""

from __future__ import annotations

import argparse

from imitor.cli import common
from imitor.cli.tables import plural


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser(
        "check", help="say what is wrong with a card", description="Check a robot card."
    )
    check.add_argument("card", metavar="CARD", help="a robot's name or the path of a card")
    common.add_without(check)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    registry = common.make_registry(args.without)
    from imitor.robot.check import check_card

    findings = check_card(args.card, registry)
    for finding in findings:
        print(f"{finding.level}: {finding.message}")
    wrong = sum(str(f.level) == "error" for f in findings)
    if not findings:
        print(f"ok: {args.card}")
    elif wrong:
        print(f"{plural(wrong, 'error')} in {args.card}")
    return 2 if wrong else 0
