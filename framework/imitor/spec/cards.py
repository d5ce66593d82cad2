"""Finding what a pipeline names: presets, robots and mesh files, by name or by path."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from imitor.environment import Box, Cylinder, Mesh
from imitor.errors import Problem, SpecError, did_you_mean
from imitor.registry import Registry
from imitor.spec.document import Document


def looks_like_path(text: str) -> bool:
    """Tell whether a person means a file: it ends in .yaml or .yml, or has a slash."""
    return text.endswith((".yaml", ".yml")) or "/" in text


def known(names: Iterable[str], most: int = 12) -> str:
    """Return a list of legal names for a message, shortened when there are many."""
    words = sorted(names)
    if not words:
        return "there are none"
    rest = len(words) - most
    return "known: " + ", ".join(words[:most]) + (f" and {rest} more" if rest > 0 else "")


def hint_for(given: str, names: Iterable[str]) -> str:
    """Return the closest legal name as a suggestion, else the list of legal names."""
    words = list(names)
    return did_you_mean(given, words) or known(words)


def find_pipeline(name_or_path: str, registry: Registry) -> Path:
    """Return the file of a pipeline given by its preset's name or by a path.

    Raises:
        SpecError: There is none.
    """
    presets = registry.cards("pipelines")
    if name_or_path in presets:
        return presets[name_or_path]
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.is_dir():
        raise SpecError([Problem(name_or_path, 0, 0, "", "this is a folder; a pipeline is a .yaml file")])
    if looks_like_path(name_or_path):
        raise SpecError([Problem(name_or_path, 0, 0, "", "there is no such file")])
    hint = hint_for(name_or_path, presets)
    raise SpecError([Problem(name_or_path, 0, 0, "", "there is no preset and no file of this name", hint)])


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises:
        SpecError: The file cannot be read or is not UTF-8.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise SpecError([Problem(str(path), 0, 0, "", f"cannot read the file: {error.strerror}")]) from None
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        column = error.start - (raw.rfind(b"\n", 0, error.start) + 1) + 1
        message = f"not UTF-8 text (byte 0x{raw[error.start]:02x})"
        raise SpecError([Problem(str(path), line, column, "", message, "save the file as UTF-8")]) from None


def check_robot(
    robot: str, document: Document, registry: Registry, folder: Path | None
) -> tuple[str, list[Problem]]:
    """Look for a robot's card and validate it.

    Args:
        robot: Name or path as written.
        document: The pipeline, for the place of ``robot``.
        registry: Where named cards are.
        folder: Folder of the pipeline file; a relative path may start there.

    Returns:
        The robot, a path made complete, and what is wrong with it or with its card.
    """
    cards = registry.cards("robots")
    if robot not in cards and looks_like_path(robot):
        found = next((p for p in (Path(robot), (folder or Path()) / robot) if p.is_file()), None)
        if found is None:
            return robot, [document.problem(("robot",), f"there is no robot card '{robot}'")]
        robot = str(found)
    elif robot not in cards:
        return robot, [document.problem(("robot",), f"no robot is called '{robot}'", hint_for(robot, cards))]
    # Only here: most of what reads pipelines needs no robot card.
    from imitor.robot.card import load_card

    try:
        load_card(robot, registry)
    except SpecError as error:
        return robot, error.problems
    return robot, []


def check_environment(
    environment: Sequence[Box | Cylinder | Mesh], document: Document, folder: Path | None
) -> tuple[list[dict[str, Any]], list[Problem]]:
    """Look for mesh files, names that are used twice, and what moves with what.

    Args:
        environment: The objects, each valid on its own.
        document: The pipeline, for their places.
        folder: Folder of the pipeline file, where relative paths start; else the current one.

    Returns:
        The objects as plain data with complete paths, and what is wrong with them.
    """
    found, problems, names = [], [], set()
    sliding = [item.name for item in environment if item.slide is not None]
    for i, item in enumerate(environment):
        data = item.model_dump(mode="json", exclude_none=True)
        if item.name in names:
            message = f"another object is called '{item.name}'"
            problems.append(document.problem(("environment", i, "name"), message, "give each its own name"))
        names.add(item.name)
        if item.part_of is not None and (item.part_of not in sliding or item.slide is not None):
            message = f"no other object that slides is called '{item.part_of}'"
            if item.slide is not None:
                message = "an object with a slide of its own is part of no other"
            hint = f"those that slide: {', '.join(sliding) or 'none'}"
            problems.append(document.problem(("environment", i, "part_of"), message, hint))
        if isinstance(item, Mesh):
            path = ((folder or Path()) / item.path.expanduser()).resolve()
            if not path.is_file():
                place = ("environment", i, "path")
                problems.append(
                    document.problem(place, f"there is no mesh file '{item.path}'", f"looked for {path}")
                )
            data["path"] = str(path)
        found.append(data)
    return found, problems
