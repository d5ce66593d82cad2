"""The command of a paper: its options, the runs, the tables on the terminal and the page in the documentation."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from experiment import Case, Observer, Played, play, shared_folder, skipped
from page import DOCS, write


@dataclass(frozen=True)
class Program:
    """What makes one paper's program.

    Attributes:
        preset: The pipeline, and the page in ``docs/presets``.
        text: What ``--help`` says.
        performer: The cases that --quick runs too.
        more: Recordings and what else takes longer.
        observe: Reads off what the tables need beyond motion and reference.
        tables: Return Markdown of finished runs.
        figures: Draw finished runs into a documentation folder and return their Markdown.
    """

    preset: str
    text: str
    performer: Sequence[Case]
    more: Sequence[Case]
    observe: Observer | None
    tables: Callable[[Sequence[Played]], list[str]]
    figures: Callable[[Sequence[Played], Path], list[str]]

    @property
    def path(self) -> str:
        """The program as a user types it."""
        return f"benchmarks/papers/{self.preset}.py"

    def main(self) -> None:
        """Run the cases asked for, print the tables and write the page."""
        args = self._arguments()
        captures = shared_folder(args.captures)
        cases = [*self.performer, *([] if args.quick else self.more)]
        if args.cases:
            known = {case.title: case for case in (*self.performer, *self.more)}
            unknown = [title for title in args.cases if title not in known]
            if unknown:
                raise SystemExit(f"no case is called {', '.join(unknown)}; there are: {'; '.join(known)}")
            cases = [known[title] for title in args.cases]
        missing = dict(skipped(cases, captures))
        played: list[Played] = []
        for case in cases:
            print(f"{case.title}: {missing.get(case, 'runs')}", flush=True)
            if case in missing:
                continue
            changed = replace(case, sets=(*case.sets, *args.sets), robot=args.robot or case.robot)
            played.append(
                play(
                    self.preset, changed, captures=captures, frames=args.frames,
                    observe=self.observe, simulate=not args.quick,
                )
            )  # fmt: skip
        text = "\n".join(
            [*self.tables(played), *(f"Left out: {c.title}: {why}.\n" for c, why in missing.items())]
        )
        print("\n" + text)
        whole = not (args.quick or args.cases or args.sets or args.frames or args.robot)
        if whole or args.docs:
            docs = args.docs or DOCS
            page = write(docs, self.preset, self.path, "\n".join([text, *self.figures(played, docs)]))
            print(f"wrote {page}")

    def _arguments(self) -> argparse.Namespace:
        parser = argparse.ArgumentParser(
            description=self.text, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        names = "; ".join(case.title for case in (*self.performer, *self.more))
        parser.add_argument("cases", nargs="*", metavar="CASE", help=names)
        parser.add_argument("--quick", action="store_true", help="scenarios alone, without physics")
        parser.add_argument("--robot", help="replaces the preset's robot")
        parser.add_argument(
            "--captures", type=Path, help="folder of captures; default: mocap in IMITOR_SHARED"
        )
        parser.add_argument("--frames", type=int, help="only the first frames")
        parser.add_argument("--set", action="append", default=[], dest="sets", metavar="ID.option=value")
        parser.add_argument("--docs", type=Path, help="folder of the documentation to write to")
        return parser.parse_args()
