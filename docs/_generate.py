"""Write what the documentation takes from the code: ``python docs/_generate.py``; ``--check`` only compares.

Pages in ``docs/reference`` are written whole. In other pages a part between ``<!-- generated: NAME -->`` and
``<!-- end -->`` is.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel

DOCS: Final = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent / "tests"))  # the list of broken inputs

from imitor import errors  # noqa: E402
from imitor.cli import parser, templates  # noqa: E402
from imitor.cli.show import option_rows  # noqa: E402
from imitor.errors import ImitorError  # noqa: E402
from imitor.hooks import HookSpecs  # noqa: E402
from imitor.kinds import KINDS, SinkReport  # noqa: E402
from imitor.metrics.doc import table as metrics_table  # noqa: E402
from imitor.motion.skeletons import SkeletonCard  # noqa: E402
from imitor.registry import Registered, Registry  # noqa: E402
from imitor.robot.card import RobotCard  # noqa: E402
from imitor.spec.schema import PipelineDocument  # noqa: E402

NOTICE: Final = "<!-- Written by docs/_generate.py. -->\n\n"
PART: Final = re.compile(r"(<!-- generated: (.*?) -->\n).*?(<!-- end -->)", re.DOTALL)
METRICS: Final = re.compile(
    r"(<!-- The table is printed by: .*? -->\n\n).*?(\n<!-- End of the printed table. -->)", re.DOTALL
)


def cell(text: object) -> str:
    """Return text for a table cell."""
    return re.sub(r"\s+", " ", str(text)).replace("|", "\\|").strip()


def code(text: object) -> str:
    """Return text as code in a table cell, or nothing."""
    return f"`{cell(text)}`" if cell(text) else ""


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def option_table(model: type[BaseModel], leave_out: Sequence[str] = ()) -> str:
    """Return a table of options: name, type, default, meaning with the unit."""
    rows = [r for r in option_rows(model) if r[0].split(".")[0] not in leave_out]
    if not rows:
        return "No options.\n"
    cells = [(code(name), cell(kind), _default(default), cell(text)) for name, kind, default, text in rows]
    return table(("option", "type", "default", "meaning [unit]"), cells)


def _default(text: str) -> str:
    return "*required*" if text == "required" else code(text)


def facts(entry: Registered) -> Iterator[str]:
    """Yield what a component needs and gives, one list item each."""
    component = entry.component
    for label, value in (
        ("needs before it", component.wants),
        ("needs the tasks", getattr(component, "needs_tasks", ())),
        ("adds to the human", component.gives),
        ("declares the tasks", getattr(component, "declares", ())),
        ("reads files", getattr(component, "extensions", ())),
    ):
        if value:
            yield f"- {label}: {', '.join(f'`{v}`' for v in sorted(map(str, value)))}\n"
    serves = getattr(component, "serves", {})
    if serves:
        yield f"- serves: {', '.join(f'{kind} ({how})' for kind, how in serves.items())}\n"
    if component.extra:
        yield f"- needs `pip install 'imitor[{component.extra}]'`\n"


def component_text(entry: Registered, level: str) -> str:
    """Return what there is to know about a component."""
    head = f"{level} `{entry.name}`\n\n{inspect.cleandoc(entry.component.__doc__ or '')}\n\n"
    said = "".join(facts(entry))
    return head + (f"{said}\n" if said else "") + option_table(entry.component.config_type)


def of_kind(registry: Registry, kind: str) -> list[Registered]:
    """Return the components of a kind."""
    return [r for r in registry if r.kind == kind]


def plugins_part(registry: Registry, kind: str) -> str:
    """Return the plugins of a kind with their options, for the kind's page."""
    found = of_kind(registry, "sink" if kind == "robot" else kind)
    if kind in ("robot", "sink"):  # robots are sinks with a page of their own
        found = [r for r in found if (".plugins.robots." in r.origin) == (kind == "robot")]
    return "\n".join(component_text(r, "###") for r in found) or "None comes with imitor yet.\n"


def example_part(registry: Registry, kind: str) -> str:
    """Return the plugin that ``imitor new`` writes."""
    name = f"my_{kind}"
    return f"```python\n{templates.plugin_files(kind, name)[f'imitor_{name}.py'].rstrip()}\n```\n"


def lifecycle_part(registry: Registry, kind: str) -> str:
    """Return a table of the methods that a plugin of a kind may write."""
    base = KINDS[kind]
    names = ["calibrate", "start", "open", "declare", "prepare", "recognises", "reset", "frames", "settle", "step",
             "write", "finish", "close"]  # fmt: skip
    rows = []
    for name in names:
        method = getattr(base, name, None)
        if method is not None:
            summary = inspect.cleandoc(method.__doc__ or "").split("\n\n")[0]
            rows.append((code(f"{name}{signature(method)}"), cell(summary)))
    return table(("method", "what it does"), rows)


def signature(method: Callable[..., Any]) -> str:
    """Return a signature without ``self`` and module names."""
    given = inspect.signature(method)
    kept = [p for p in given.parameters.values() if p.name not in ("self", "cls")]
    text = str(given.replace(parameters=kept))
    return re.sub(r"\b(?:[a-z_]+\.)+(?=[A-Z])", "", text).replace("'", "")


def robots_part(registry: Registry, _: str) -> str:
    """Return a table of the robots that come along."""
    from imitor.robot.card import load_card

    rows = []
    for name in sorted(registry.cards("robots")):
        card = load_card(name, registry)
        origin = card.model.package or card.model.description or "imitor"
        rows.append((code(name), cell(card.title), cell(card.licence), cell(origin)))
    return table(("name", "robot", "licence of the model", "model from"), rows)


def presets_part(registry: Registry, _: str) -> str:
    """Return a table of the presets."""
    from imitor.cli.list_ import title_of

    cards = registry.cards("pipelines")
    return table(("preset", "what it does"), [(code(n), cell(title_of(cards[n]))) for n in sorted(cards)])


def card_part(registry: Registry, _: str) -> str:
    """Return the keys of a robot card."""
    return option_table(RobotCard, leave_out=("name", "path")).replace("option", "key", 1)


def skeleton_part(registry: Registry, _: str) -> str:
    """Return the keys of a skeleton card."""
    return option_table(SkeletonCard, leave_out=("name", "path")).replace("option", "key", 1)


def pipeline_part(registry: Registry, _: str) -> str:
    """Return the keys of a pipeline."""
    return option_table(PipelineDocument).replace("option", "key", 1)


def broken_part(registry: Registry, _: str) -> str:
    """Return the tables of broken inputs and what is said about them."""
    from broken_inputs import CASES

    out = []
    for group in dict.fromkeys(c.group for c in CASES):
        rows = []
        for case in (c for c in CASES if c.group == group):
            said = []
            for line in case.said.splitlines():
                quoted = re.match(r" *\d* \| ", line)  # of the source line and the caret, only the suggestion
                said.append(code(line.partition("^")[2] if quoted else line))
            rows.append(
                (cell(case.wrong), code(case.command), "<br>".join(filter(None, said)), str(case.status))
            )
        head = ("what is wrong", "`imitor …`", "what is said", "status")
        out.append(f"### {group}\n\n{table(head, rows)}")
    return "\n".join(out)


def references_part(registry: Registry, _: str) -> str:
    """Return the list of sources, from ``references.bib``."""
    return "".join(f"- **{key}** — {text}\n" for key, text in references().items())


def references() -> dict[str, str]:
    """Return every entry of ``references.bib``: key -> text."""
    out = {}
    text = (DOCS / "references.bib").read_text(encoding="utf-8")
    for key, body in re.findall(r"^@\w+\{(\w+),\n(.*?)^\}", text, re.M | re.S):
        fields = {n: re.sub(r"\s+", " ", v.replace("{", "").replace("}", "")).strip()
                  for n, v in re.findall(r"(\w+) *= \{(.*?)\},\n", body, re.S)}  # fmt: skip
        place = (
            fields.get("journal")
            or fields.get("booktitle")
            or fields.get("institution")
            or fields["publisher"]
        )
        where = [f"*{place}*"]
        if "volume" in fields:
            where[0] += f" {fields['volume']}({fields['number']})"
        elif "number" in fields:
            where.append(f"report {fields['number']}")
        if "edition" in fields:
            where.append(f"{fields['edition']} edition")
        if "pages" in fields:
            where.append(fields["pages"].replace("--", "–"))
        doi = f" [doi:{fields['doi']}](https://doi.org/{fields['doi']})" if "doi" in fields else ""
        authors = fields["author"].replace(" and ", ", ")
        out[key] = f"{authors}. {fields['title']}. {', '.join([*where, fields['year']])}.{doi}"
    return out


PARTS: Final[dict[str, Callable[[Registry, str], str]]] = {
    "plugins": plugins_part,
    "example": example_part,
    "lifecycle": lifecycle_part,
    "robots": robots_part,
    "presets": presets_part,
    "robot-card": card_part,
    "skeleton-card": skeleton_part,
    "pipeline": pipeline_part,
    "broken-inputs": broken_part,
    "references": references_part,
}


def components_page(registry: Registry) -> str:
    """Return the page of all components."""
    out = ["# Components\n\nEvery plugin that comes with imitor, with all its options.\n"]
    for kind in KINDS:
        found = of_kind(registry, kind)
        texts = [component_text(r, "###") for r in found] or ["None comes with imitor yet.\n"]
        out += [f"## {kind.capitalize()}\n", *texts]
    return "\n".join(out)


def hooks_page(registry: Registry) -> str:
    """Return the page of hooks."""
    out = [
        "# Hooks\n\nA plugin module implements them with `@imitor.hookimpl`; they are called when imitor starts and at "
        "the ends of a run, never per frame.\n"
    ]
    for name, hook in vars(HookSpecs).items():
        if not name.startswith("_"):
            text = inspect.cleandoc(hook.__doc__ or "")
            out.append(f"## `{name}`\n\n```python\ndef {name}{signature(hook)}\n```\n\n{text}\n")
    out.append("## What a sink gives back\n\n" + inspect.cleandoc(SinkReport.__doc__ or "") + "\n")
    return "\n".join(out)


def cli_page(registry: Registry) -> str:
    """Return the page of the command line."""
    out = ["# Command line\n"]
    out += list(_command(parser(), "##"))
    return "\n".join(out)


def _command(command: argparse.ArgumentParser, level: str) -> Iterator[str]:
    yield f"{level} `{command.prog}`\n\n{command.description or ''}\n"
    rows: list[tuple[str, str]] = []
    inner: list[argparse.ArgumentParser] = []
    for action in command._actions:
        if isinstance(action, argparse._SubParsersAction):
            inner += list(dict.fromkeys(action.choices.values()))
        elif not isinstance(action, argparse._HelpAction):
            names = " ".join([*action.option_strings[-1:], str(action.metavar or "")]).strip()
            rows.append((code(names or action.dest), cell(action.help or "")))
    if rows:
        yield table(("argument", "meaning"), rows)
    if command.epilog:
        yield f"{command.epilog}\n"
    for sub in inner:
        yield from _command(sub, level if level == "###" else level + "#")


def errors_page(registry: Registry) -> str:
    """Return the page of exception classes."""
    classes = [c for c in vars(errors).values() if inspect.isclass(c) and issubclass(c, ImitorError)]
    rows = []
    for cls in classes:
        base = cls.__bases__[0].__name__
        rows.append((code(cls.__name__), code(base), str(cls.exit_status), cell(_first(cls))))
    tree = inspect.cleandoc(errors.__doc__ or "").partition("\n\n")[2]
    return (
        "# Exceptions\n\nAll are in `imitor.errors`; facts are attributes.\n\n"
        f"```text\n{inspect.cleandoc(tree)}\n```\n\n"
        + table(("class", "base", "exit status", "meaning"), rows)
    )  # fmt: skip


def _first(cls: type) -> str:
    return inspect.cleandoc(cls.__doc__ or "").split("\n\n", 1)[0]


def schema_page(registry: Registry) -> str:
    """Return the page of the file formats that a schema describes."""
    return (
        "# Pipelines and cards, key by key\n\n"
        "The JSON Schema of a pipeline is [pipelines/imitor.schema.json](../../pipelines/imitor.schema.json); "
        "`imitor schema` prints it with the plugins that are installed.\n\n"
        f"## Pipeline\n\n{pipeline_part(registry, '')}\n"
        f"## Robot card\n\n{card_part(registry, '')}\n"
        f"## Skeleton card\n\n{skeleton_part(registry, '')}"
    )


PAGES: Final[dict[str, Callable[[Registry], str]]] = {
    "components": components_page,
    "hooks": hooks_page,
    "cli": cli_page,
    "errors": errors_page,
    "schema": schema_page,
}


def rendered(registry: Registry) -> dict[Path, str]:
    """Return every generated page: file -> text it should have."""
    out = {DOCS / "reference" / f"{name}.md": NOTICE + make(registry) for name, make in PAGES.items()}
    for path in sorted(DOCS.rglob("*.md")):
        if path in out or "_build" in path.parts:
            continue
        text = path.read_text(encoding="utf-8")

        def fill(match: re.Match[str]) -> str:
            name, _, argument = match[2].partition(" ")
            return f"{match[1]}\n{PARTS[name](registry, argument)}\n{match[3]}"

        new = PART.sub(fill, text)
        new = METRICS.sub(lambda m: m[1] + metrics_table() + m[2], new)
        if new != text or PART.search(text):
            out[path] = new
    return out


def main() -> int:
    """Write the pages, or with ``--check`` say which are out of step."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 if something is out of step"
    )
    check = options.parse_args().check
    stale = []
    for path, text in rendered(Registry(entry_points=False)).items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            stale.append(path)
            if not check:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8")
    for path in stale:
        print(f"{'out of step' if check else 'wrote'}: {path.relative_to(DOCS.parent)}")
    if check and stale:
        print("write them anew: make generate")
    return 1 if check and stale else 0


if __name__ == "__main__":
    raise SystemExit(main())
