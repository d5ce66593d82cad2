"""Scalars by the core schema of YAML 1.2: what a plain word in a file means.

PyYAML follows YAML 1.1, where ``on`` is true, ``1:30`` is 90, ``010`` is 8 and ``1e-4`` is text; not so here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

Scalar = str | int | float | bool | None

_TAG: Final = "tag:yaml.org,2002:"
STR, INT, FLOAT, BOOL, NULL, SEQ, MAP = (
    _TAG + t for t in ("str", "int", "float", "bool", "null", "seq", "map")
)

PATTERNS: Final[tuple[tuple[str, re.Pattern[str], list[str]], ...]] = (
    (NULL, re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""]),
    (BOOL, re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF")),
    (INT, re.compile(r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$"), list("-+0123456789")),
    (
        FLOAT,
        re.compile(
            r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
            r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
        ),
        list("-+.0123456789"),
    ),
)
"""Tag, pattern and possible first characters, in the order in which they are tried."""

_BASES: Final = {"0o": 8, "0x": 16}
_SUBSTITUTION: Final = re.compile(r"\$\$\{|\$\{([A-Za-z_][A-Za-z0-9_]*)(?::([^}]*))?\}")


def plain_tag(text: str) -> str:
    """Return the tag of a plain (unquoted) scalar."""
    return next((tag for tag, pattern, _ in PATTERNS if pattern.match(text)), STR)


def convert(tag: str, text: str) -> Scalar:
    """Return the value of a scalar.

    Raises:
        ValueError: The text does not fit its tag (an explicit ``!!int x``), or has too many digits.
    """
    if tag == STR:
        return text
    pattern = next(p for t, p, _ in PATTERNS if t == tag)
    if not pattern.match(text) and not (tag == FLOAT and plain_tag(text) == INT):
        raise ValueError(f"'{text}' is no {tag.removeprefix(_TAG)}")
    if tag == NULL:
        return None
    if tag == BOOL:
        return text.lower() == "true"
    if tag == INT:
        base = _BASES.get(text[:2])
        return int(text[2:], base) if base else int(text)
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


def substitute(text: str, environment: Mapping[str, str]) -> str:
    """Return the text with ``${NAME}`` and ``${NAME:default}`` replaced from environment variables.

    ``$${`` stands for ``${`` itself.

    Raises:
        ValueError: A variable is not set and has no default, or a ``${`` has another form.
    """

    def value(match: re.Match[str]) -> str:
        name, default = match.groups()
        if name is None:
            return "${"
        found = environment.get(name, default)
        if found is None:
            raise ValueError(
                f"environment variable '{name}' is not set; set it, or give a default: ${{{name}:value}}"
            )
        return found

    if "${" in _SUBSTITUTION.sub(" ", text):
        raise ValueError(f"'{text}' is no substitution; write ${{NAME}} or ${{NAME:default}}")
    return _SUBSTITUTION.sub(value, text)


def escape(text: str) -> str:
    """Return the text so that `substitute` gives it back."""
    return text.replace("${", "$${")
