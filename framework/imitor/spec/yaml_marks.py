"""YAML text to plain data that knows its lines.

PyYAML's constructors lose the lines and keep the last of two equal keys, so nodes are composed and turned
into data here. Pipelines, robot cards and skeleton cards are all read by `parse_document`, and what pydantic
finds wrong in them is brought back to their lines by `translate`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import yaml
from yaml.resolver import BaseResolver

from imitor.spec.document import Document, Loc, Mark, dotted
from imitor.spec.scalars import INT, MAP, PATTERNS, SEQ, STR, Scalar, convert, plain_tag, substitute
from imitor.spec.translate import translate, validate

__all__ = ["Document", "Loc", "Mark", "parse_document", "parse_value", "translate", "validate"]

_BREAK: Final = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
_MAX_NODES: Final = 50_000
"""More than this comes from aliases of aliases, not from a person."""


class _Core(BaseResolver):
    """Resolve plain scalars by the core schema of YAML 1.2."""


for _tag, _pattern, _first in PATTERNS:
    _Core.add_implicit_resolver(_tag, _pattern, _first)

if yaml.__with_libyaml__:
    from yaml._yaml import CParser

    class _Composer(CParser, _Core):
        def __init__(self, text: str) -> None:
            CParser.__init__(self, text)
            _Core.__init__(self)

else:
    from yaml.composer import Composer
    from yaml.parser import Parser
    from yaml.reader import Reader
    from yaml.scanner import Scanner

    class _Composer(Reader, Scanner, Parser, Composer, _Core):  # type: ignore[no-redef]
        def __init__(self, text: str) -> None:
            Reader.__init__(self, text)
            Scanner.__init__(self)
            Parser.__init__(self)
            Composer.__init__(self)
            _Core.__init__(self)


class _Builder:
    """Turn composed nodes into the data and the marks of a document."""

    def __init__(self, document: Document, environment: Mapping[str, str] | None) -> None:
        self.document, self.environment = document, environment
        self.open: list[int] = []
        self.n_nodes = 0

    def build(self, node: yaml.Node, loc: Loc) -> Any:
        self.n_nodes += 1
        self.document.values[loc] = self.mark(node)
        if self.n_nodes > _MAX_NODES:
            if self.n_nodes == _MAX_NODES + 1:
                self.wrong(
                    loc, f"more than {_MAX_NODES} values", "write out or shorten what the aliases repeat"
                )
            return None
        if id(node) in self.open:
            self.wrong(loc, "this alias stands inside what it repeats", "remove the alias")
            return None
        if isinstance(node, yaml.ScalarNode):
            return self.scalar(node, loc)
        self.open.append(id(node))
        data = self.mapping(node, loc) if isinstance(node, yaml.MappingNode) else self.sequence(node, loc)
        self.open.pop()
        return data

    def mapping(self, node: yaml.MappingNode, loc: Loc) -> dict[str, Any]:
        self.check_tag(node, MAP, loc)
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                mark = self.mark(key_node)
                self.document.problems.append(
                    self.document.problem_at(mark, dotted(loc), "a key is a word, not a list or mapping")
                )
                continue
            key = key_node.value
            here = (*loc, key)
            if key in data:
                first = self.document.keys[here].line
                message = f"key '{key}' is given twice, first in line {first}"
                self.document.problems.append(
                    self.document.problem_at(
                        self.mark(key_node), dotted(here), message, "remove one of the two"
                    )
                )
                continue
            self.document.keys[here] = self.mark(key_node)
            data[key] = self.build(value_node, here)
        return data

    def sequence(self, node: yaml.Node, loc: Loc) -> list[Any]:
        self.check_tag(node, SEQ, loc)
        return [self.build(item, (*loc, i)) for i, item in enumerate(node.value)]

    def scalar(self, node: yaml.ScalarNode, loc: Loc) -> Scalar:
        text, tag = node.value, node.tag
        self.check_tag(node, tag if tag in {STR, *(t for t, _, _ in PATTERNS)} else STR, loc)
        try:
            if self.environment is not None and tag == STR and "${" in text:
                text = substitute(text, self.environment)
                tag = STR if node.style else plain_tag(text)
            return convert(tag, text) if tag in {STR, *(t for t, _, _ in PATTERNS)} else text
        except ValueError as error:
            digits = tag == INT and len(text) > 4000
            self.wrong(loc, f"a whole number of {len(text)} digits" if digits else str(error))
            return None

    def check_tag(self, node: yaml.Node, legal: str, loc: Loc) -> None:
        if node.tag != legal:
            tag = node.tag.replace("tag:yaml.org,2002:", "!!")
            self.wrong(loc, f"tag '{tag}' is not allowed", "remove the tag; plain YAML is all there is")

    def wrong(self, loc: Loc, message: str, suggestion: str = "") -> None:
        self.document.problems.append(self.document.problem(loc, message, suggestion))

    def mark(self, node: yaml.Node) -> Mark:
        return Mark(self.document.path, node.start_mark.line + 1, node.start_mark.column + 1)


def parse_document(text: str, path: str, *, environment: Mapping[str, str] | None = None) -> Document:
    """Read a YAML text whose top is a mapping.

    Args:
        text: The YAML text.
        path: Name of its file, for messages.
        environment: Variables for ``${NAME}`` and ``${NAME:default}``; without it these stay as they are.

    Returns:
        The document. What is wrong with the text is in ``problems``; then ``data`` may be ``None``.
    """
    document = _parse(text, path, environment)
    if document.problems or isinstance(document.data, dict):
        return document
    if document.data is None:
        message = "the file is empty" if not _has_content(document.lines) else "there is nothing but 'null'"
        document.problems.append(document.problem_at(Mark(path, 1, 1), "", message))
    else:
        kind = "a list" if isinstance(document.data, list) else "a single value"
        message = f"the top of the file must be a mapping (key: value), not {kind}"
        document.problems.append(document.problem((), message))
        document.data = None
    return document


def parse_value(text: str, origin: str) -> Document:
    """Read a value given on the command line, any YAML: ``0.3``, ``[a, b]``, ``{x: 1}``, a word."""
    document = _parse(text, origin, None)
    # The text is on the user's own command line: no line numbers.
    document.values = dict.fromkeys(document.values, Mark(origin, 0, 0))
    document.keys = dict.fromkeys(document.keys, Mark(origin, 0, 0))
    document.problems = [document.problem((), p.message) for p in document.problems]
    return document


def _parse(text: str, path: str, environment: Mapping[str, str] | None) -> Document:
    text = text.removeprefix("\ufeff")
    document = Document(path, lines=_BREAK.split(text))
    try:
        node = _Composer(text).get_single_node()
    except yaml.MarkedYAMLError as error:
        document.problems.append(_syntax_problem(document, error))
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        column = error.position - (text.rfind("\n", 0, error.position) + 1) + 1
        character = f"#x{error.character:04x}" if isinstance(error.character, int) else repr(error.character)
        message = f"character {character} is not allowed in YAML"
        document.problems.append(document.problem_at(Mark(path, line, column), "", message))
    except RecursionError:
        document.problems.append(document.problem_at(Mark(path, 0, 0), "", "nested too deeply"))
    else:
        if node is not None:
            try:
                document.data = _Builder(document, environment).build(node, ())
            except RecursionError:
                document.problems.append(document.problem_at(Mark(path, 0, 0), "", "nested too deeply"))
    return document


def _has_content(lines: list[str]) -> bool:
    return any(line.strip() and not line.lstrip().startswith(("#", "---", "...")) for line in lines)


def _syntax_problem(document: Document, error: yaml.MarkedYAMLError) -> Any:
    mark = error.problem_mark or error.context_mark
    place = Mark(document.path, mark.line + 1, mark.column + 1) if mark else Mark(document.path, 0, 0)
    message = f"not valid YAML: {error.problem or error.context or error}"
    if error.context and error.problem:
        message += f" ({error.context})"
    line = document.lines[mark.line] if mark and mark.line < len(document.lines) else ""
    suggestion = ""
    if "\t" in line[: len(line) - len(line.lstrip())]:
        suggestion = "indent with spaces, not tabs"
    elif "mapping values" in (error.problem or ""):
        suggestion = "put text with ': ' in quotes, or check the indentation"
    elif "single document" in (error.context or ""):
        suggestion = "one file holds one document; remove the '---'"
    return document.problem_at(place, "", message, suggestion)
