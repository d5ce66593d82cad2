"""Can this order of stages work? Found before anything is built, from what classes say they need and give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imitor.errors import Problem, did_you_mean
from imitor.kinds import Component, Config
from imitor.registry import Registry
from imitor.spec.document import Document, Loc, dotted
from imitor.tasks import TaskKind

_TASK_STAGES = ("stabilizer", "solver", "postprocessor")


@dataclass(frozen=True)
class Entry:
    """A stage while it is being checked: ``component`` and ``config`` are ``None`` where they are wrong."""

    kind: str
    name: str
    id: str
    loc: Loc
    component: type[Component[Any]] | None = None
    config: Config | None = None

    @property
    def title(self) -> str:
        """Place and id, for messages: ``stages[3] foot_retarget``."""
        return f"{dotted(self.loc)} {self.id}"


def check_order(
    source: Entry | None, stages: Sequence[Entry], document: Document, registry: Registry
) -> list[Problem]:
    """Return the problems of an order of stages.

    What cannot be known because a plugin is unknown is left out.

    Args:
        source: The source.
        stages: The stages in order.
        document: Where they are written.
        registry: For suggestions.
    """
    problems = list(_structure(stages, document))
    if source is not None and source.component is not None and all(s.component for s in stages):
        problems += _human(source, stages, document, registry)
        problems += _tasks(stages, document)
    return problems


def _at(entry: Entry, document: Document, message: str, suggestion: str = "") -> Problem:
    key = entry.kind if entry.loc[0] == "stages" else "use"
    return document.problem_at(document.mark_of((*entry.loc, key)), entry.title, message, suggestion)


def _structure(stages: Sequence[Entry], document: Document) -> Iterator[Problem]:
    kinds = [s.kind for s in stages]
    for kind, purpose in (
        ("mapper", "a pipeline needs one to turn the human into tasks"),
        ("solver", "a pipeline needs one to find the robot's configuration"),
    ):
        if kind not in kinds:
            mark = document.mark_of(("stages",), key=True)
            yield document.problem_at(
                mark, "stages", f"no {kind}; {purpose}", f"imitor list {kind} shows them"
            )
    mapper = solver = -1
    for i, stage in enumerate(stages):
        if stage.kind == "mapper" and mapper < 0:
            mapper = i
        elif stage.kind == "filter" and mapper >= 0:
            yield _at(
                stage,
                document,
                f"a filter changes the human, so it stands before the mapper (stages[{mapper}])",
            )
        elif stage.kind in _TASK_STAGES and mapper < 0 and "mapper" in kinds:
            yield _at(stage, document, "needs tasks, but no mapper stands before it")
        wants = stage.component.wants if stage.component else frozenset[str]()
        if "solver" in kinds and solver < 0 and ("configuration" in wants or stage.kind == "postprocessor"):
            yield _at(stage, document, "needs a configuration, but no solver stands before it")
        if stage.kind == "solver" and solver < 0:
            solver = i


def _human(
    source: Entry, stages: Sequence[Entry], document: Document, registry: Registry
) -> Iterator[Problem]:
    given = set(source.component.gives if source.component else ())
    for stage in stages:
        cls = stage.component
        if cls is None:
            continue
        for want in sorted(cls.wants - given - {"configuration"}):
            givers = [r.name for r in registry if r.kind == "filter" and want in r.component.gives]
            hint = f"put 'filter: {givers[0]}' before it" if givers else ""
            if len(givers) > 1:
                hint = f"put a filter before it: {', '.join(givers)}"
            yield _at(stage, document, f"needs the human's {want}, which nothing before it gives", hint)
        if stage.kind == "filter":
            given |= cls.gives


def _tasks(stages: Sequence[Entry], document: Document) -> Iterator[Problem]:
    declared: dict[str, TaskKind] = {}
    mapped = False
    for stage in stages:
        cls = stage.component
        mapped |= stage.kind == "mapper"
        if mapped:  # else that is the problem, and already told
            for task in sorted(getattr(cls, "needs_tasks", frozenset()) - declared.keys()):
                yield _at(stage, document, f"needs the task '{task}', which no stage before it declares")
            if stage.kind == "solver":
                yield from _order(stage, declared, document)
        declared |= getattr(cls, "declares", {})


def _order(stage: Entry, declared: Mapping[str, TaskKind], document: Document) -> Iterator[Problem]:
    serves = getattr(stage.component, "serves", {})
    seen: dict[str, Loc] = {}
    for steps, name in _names(getattr(stage.config, "order", None)):
        here: Loc = (*stage.loc, "order", *steps)
        if name in seen:
            yield document.problem(here, f"'{name}' is in the order already, at {dotted(seen[name])}")
            continue
        seen[name] = here
        if name not in declared:
            hint = did_you_mean(name, declared) or f"declared: {', '.join(declared)}"
            yield document.problem(here, f"no stage before it declares a task '{name}'", hint)
        elif serves and declared[name] not in serves:
            kinds = ", ".join(serves)
            yield document.problem(
                here, f"'{stage.name}' does not serve '{name}', a {declared[name]} task", f"it serves {kinds}"
            )
    if seen:
        for name in getattr(stage.config, "weights", None) or {}:
            if name not in seen:
                hint = did_you_mean(name, seen) or f"in the order: {', '.join(seen)}"
                here = (*stage.loc, "weights", name)
                message = f"'{name}' has a weight but is not in the order"
                yield document.problem(here, message, hint, key=True)


def _names(order: Any) -> Iterator[tuple[Loc, str]]:
    """Yield every task name of an order with its place in it: ``[[left_foot, right_foot], {com: 2.0}]``."""
    if isinstance(order, str):
        yield (), order
    elif isinstance(order, Mapping):
        yield from (((name,), name) for name in order)
    elif isinstance(order, Sequence):
        for i, item in enumerate(order):
            yield from (((i, *steps), name) for steps, name in _names(item))
