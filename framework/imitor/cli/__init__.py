"""The command line. One module a command; heavy packages are imported by the command that needs them."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from typing import NoReturn

import imitor
from imitor.errors import ImitorError, did_you_mean

_EPILOG = (
    "imitor COMMAND --help says more. Exit status: 0 done, 1 the run failed, 2 input wrong, 130 interrupted."
)


class _Parser(argparse.ArgumentParser):
    """An argument parser that suggests the command a person meant."""

    def error(self, message: str) -> NoReturn:
        wrong = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if wrong:
            legal = [word.strip("' ") for word in wrong[2].split(",")]
            hint = did_you_mean(wrong[1], legal)
            message = f"there is no '{wrong[1]}'; {hint or 'known: ' + ', '.join(legal)}"
        self.exit(2, f"{self.prog}: {message}\nhelp: {self.prog} --help\n")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    from imitor.cli import check, evaluate, list_, new, robot, run, schema, show, stream

    top = _Parser(
        prog="imitor", description="Humanoid robots imitate whole-body human motion.", epilog=_EPILOG
    )
    top.add_argument("--version", action="version", version=f"imitor {imitor.__version__}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", parser_class=_Parser)
    for module in (run, stream, check, list_, show, evaluate, robot, new, schema):
        text = (module.__doc__ or "").strip()
        name = module.__name__.rsplit(".", 1)[1].rstrip("_")
        command = commands.add_parser(
            name,
            help=text.split("\n", 1)[0],
            description=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(execute=module.execute)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status: 0 done, 1 failed, 2 input wrong, 130 interrupted."""
    top = parser()
    try:
        args = top.parse_args(argv)
        if args.command is None:
            top.print_help(sys.stderr)
            return 2
        status: int = args.execute(args)
        sys.stdout.flush()
        return status
    except SystemExit as stop:  # argparse has printed what there is to say
        return stop.code if isinstance(stop.code, int) else 2
    except ImitorError as error:
        _debug()
        _complain(str(error))
        return error.exit_status
    except KeyboardInterrupt:
        _complain("interrupted")
        return 130
    except BrokenPipeError:
        # The reader, such as `head`, has seen enough; nothing may be flushed into the pipe at exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        _debug()
        _complain(
            f"internal error: {type(error).__name__}: {error}\n"
            "This is a fault of imitor or of a plugin. Please report it with the output of: "
            "IMITOR_DEBUG=1 imitor ..."
        )
        return 1


def _debug() -> None:
    """Show the traceback of the error in hand where a developer asked for it."""
    if os.environ.get("IMITOR_DEBUG"):
        import traceback

        traceback.print_exc()


def _complain(text: str) -> None:
    print(text, file=sys.stderr)
