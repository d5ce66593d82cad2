"""YAML 1.2 scalars, marks, substitution and what is refused in any YAML file."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor.spec.scalars import escape, substitute
from imitor.spec.yaml_marks import Mark, parse_document, parse_value


def value(text: str) -> Any:
    document = parse_document(f"a: {text}\n", "x.yaml")
    assert document.problems == []
    return document.data["a"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1", 1),
        ("-17", -17),
        ("+3", 3),
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        ("1e-4", 1e-4),
        ("1.5E+3", 1500.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("-.inf", -math.inf),
        (".INF", math.inf),
        ("true", True),
        ("FALSE", False),
        ("~", None),
        ("null", None),
        ("", None),
        ("on", "on"),
        ("off", "off"),
        ("yes", "yes"),
        ("no", "no"),
        ("y", "y"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("2024-01-02", "2024-01-02"),
        ("1e", "1e"),
        (".", "."),
        ("-", [None]),
        ("'1'", "1"),
        ('"true"', "true"),
        ("!!str 1", "1"),
        ("!!float 1", 1.0),
        ("<<", "<<"),
        ("=", "="),
    ],
)
def test_scalar_of_the_core_schema(text: str, expected: Any) -> None:
    found = value(text) if text != "-" else parse_document("a:\n-\n", "x.yaml").data["a"]
    assert found == expected
    assert type(found) is type(expected)


def test_not_a_number_is_a_float() -> None:
    assert math.isnan(value(".nan"))


@given(st.integers())
def test_integers_read_back(number: int) -> None:
    assert value(str(number)) == number


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_read_back(number: float) -> None:
    found = value(repr(number))
    assert type(found) is float
    assert found == number


@given(st.text(alphabet="0123456789+-.eE_xo:", min_size=1, max_size=8))
def test_plain_words_are_numbers_exactly_where_the_core_schema_says(text: str) -> None:
    document = parse_document(f'a: "{text}"\nb: !!str {text}\n', "x.yaml")
    plain = parse_value(text, "x")
    if document.problems or plain.problems or not isinstance(plain.data, int | float):
        return
    # What became a number is what Python reads as the same number: nothing sexagesimal, octal or underscored.
    assert "_" not in text
    assert ":" not in text
    assert plain.data == (int(text, 0) if text[:2] in ("0x", "0o") else float(text))


def test_keys_are_text_and_values_know_their_place() -> None:
    document = parse_document("a:\n  - {on: 1, 2: x}\n  - [3,\n     four]\n", "x.yaml")
    assert document.data == {"a": [{"on": 1, "2": "x"}, [3, "four"]]}
    assert document.mark_of(("a", 0, "on")) == Mark("x.yaml", 2, 10)
    assert document.mark_of(("a", 0, "on"), key=True) == Mark("x.yaml", 2, 6)
    assert document.mark_of(("a", 1, 1)) == Mark("x.yaml", 4, 6)
    assert document.mark_of(("a", 1, 1, "deeper")) == Mark("x.yaml", 4, 6)
    assert document.mark_of((), key=True) == Mark("x.yaml", 1, 1)


def test_columns_count_characters_not_bytes() -> None:
    document = parse_document("é: {ü: 1}\n", "x.yaml")
    assert document.mark_of(("é", "ü")) == Mark("x.yaml", 1, 8)


def test_byte_order_mark_and_windows_line_ends() -> None:
    document = parse_document("\ufeffa: 1\r\nb: 2\r\n", "x.yaml")
    assert document.data == {"a": 1, "b": 2}
    assert document.mark_of(("b",)) == Mark("x.yaml", 2, 4)
    assert str(document.problem(("b",), "no")).splitlines()[1] == "     2 | b: 2"


def test_an_anchor_may_be_repeated() -> None:
    assert parse_document("a: &x [1, 2]\nb: *x\n", "x.yaml").data == {"a": [1, 2], "b": [1, 2]}


def test_an_alias_inside_itself_is_refused() -> None:
    said = [str(p).splitlines()[0] for p in parse_document("a: &x [*x]\n", "x.yaml").problems]
    assert said == ["x.yaml:1:4: a[0]: this alias stands inside what it repeats"]


def test_aliases_of_aliases_do_not_fill_the_memory() -> None:
    levels = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    problems = parse_document("\n".join(levels), "x.yaml").problems
    assert [p.message for p in problems] == ["more than 50000 values"]


@pytest.mark.parametrize("text", ["[" * 5000, "{a: " * 5000, "- " * 5000])
def test_deep_nesting_is_a_problem(text: str) -> None:
    (problem,) = parse_document(text, "x.yaml").problems
    assert "nest" in problem.message


def test_a_very_long_number_is_a_problem() -> None:
    (problem,) = parse_document(f"a: {'9' * 5000}", "x.yaml").problems
    assert str(problem) == "x.yaml:1:4: a: a whole number of 5000 digits"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: !!int x", "'x' is no int"),
        ("a: !!binary aGk=", "tag '!!binary' is not allowed"),
        ("a: !mine 1", "tag '!mine' is not allowed"),
        ("a: !!set {b, c}", "tag '!!set' is not allowed"),
        ("? [1]\n: 2", "a key is a word, not a list or mapping"),
    ],
)
def test_refused(text: str, message: str) -> None:
    assert [p.message for p in parse_document(text, "x.yaml").problems] == [message]


@given(st.text())
def test_any_text_is_read_or_refused_with_a_place(text: str) -> None:
    document = parse_document(text, "x.yaml")
    assert isinstance(document.data, dict) or document.problems
    assert all(str(p).startswith("x.yaml") for p in document.problems)


ENVIRONMENT = {"GAIN": "0.5", "NAME": "anna", "EMPTY": ""}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("${GAIN}", 0.5),
        ("'${GAIN}'", "0.5"),
        ("${NAME}/x", "anna/x"),
        ("${OTHER:1e-3}", 1e-3),
        ("${OTHER:}", None),
        ("${EMPTY:x}", None),
        ("'${OTHER:a b}'", "a b"),
        ("$${GAIN}", "${GAIN}"),
        ("$GAIN", "$GAIN"),
        ("${NAME}${GAIN}", "anna0.5"),
    ],
)
def test_substitution(text: str, expected: Any) -> None:
    document = parse_document(f"a: {text}\n", "x.yaml", environment=ENVIRONMENT)
    assert document.problems == []
    assert document.data["a"] == expected


def test_without_variables_nothing_is_substituted() -> None:
    assert value("${GAIN}") == "${GAIN}"


@given(st.text(alphabet="${}aN:", max_size=12))
def test_escaped_text_comes_back(text: str) -> None:
    assert substitute(escape(text), {}) == text
