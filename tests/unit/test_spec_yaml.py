"""YAML is read as Kubernetes reads it, with lines."""

from __future__ import annotations

from typing import Any

import pytest

from fleet.errors import Problem, SpecError
from fleet.spec.yaml_text import read_yaml, render, write_yaml


def value_of(text: str) -> Any:
    (document,) = read_yaml(text)
    return document.value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2018-06-01", "2018-06-01"),
        ("1:30", "1:30"),
        ("11:22:33:44:55:56", "11:22:33:44:55:56"),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("-.inf", -float("inf")),
        ("0x1f", 31),
        ("0b101", 5),
        ("017", 15),
        ("-12", -12),
        ("+3", 3),
        ("1_000", "1_000"),
        ("yes", True),
        ("'yes'", "yes"),
        ("~", None),
        ("=", "="),
    ],
)
def test_plain_scalars(text: str, value: Any) -> None:
    read = value_of(f"it: {text}")["it"]
    assert (read, type(read)) == (value, type(value))


def test_every_value_has_its_line() -> None:
    (document,) = read_yaml("a: 1\nb:\n  - c: 2\n    d: [3,\n        4]\n")
    lines = {render(path): line for path, line in document.lines.items()}
    assert lines == {"": 1, "a": 1, "b": 2, "b[0]": 3, "b[0].c": 3, "b[0].d": 4, "b[0].d[0]": 4, "b[0].d[1]": 5}
    assert document.line(("b", 0, "d", 7)) == 4


def test_empty_documents_are_left_out() -> None:
    assert [document.value for document in read_yaml("---\na: 1\n---\n---\n# nothing\n")] == [{"a": 1}]


def test_a_field_given_twice_is_told_with_both_lines() -> None:
    (document,) = read_yaml("a:\n  b: 1\n  b: 2\n")
    assert document.problems == (Problem("a.b", "is given twice", "keep one of the two (the other is in line 2)", 3),)
    assert document.value == {"a": {"b": 1}}


def test_merged_mappings_yield_to_what_is_written() -> None:
    assert value_of("x: &x {a: 1, b: 2}\ny:\n  <<: *x\n  b: 3\n") == {"x": {"a": 1, "b": 2}, "y": {"a": 1, "b": 3}}


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("a:\n\tb: 1", 2, "a tab stands where YAML wants spaces"),
        ("a: @b", 1, "a text that begins with `@` must be in quotes"),
        ("a: *b", 1, "`*b` refers to an anchor that is not there"),
        ("a: b: c", 1, "check the indentation of this line"),
        ("a: [1,\n", 2, "not YAML"),
        ("a: 'x\n", 2, "a quote is opened and never closed"),
        ('a: "\\q"', 1, "use single quotes"),
        ("a: &a [*a]", 1, "too deep or too large"),
    ],
)
def test_syntax_errors_are_said_plainly(text: str, line: int, words: str) -> None:
    with pytest.raises(SpecError) as caught:
        read_yaml(text)
    (problem,) = caught.value.problems
    assert (problem.line, words in problem.message) == (line, True), problem


def test_a_text_that_unfolds_to_millions_of_values_is_refused() -> None:
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    with pytest.raises(SpecError, match="too deep or too large"):
        read_yaml("\n".join(levels))


def test_very_deep_nesting_is_refused() -> None:
    with pytest.raises(SpecError, match="too deep"):
        read_yaml("[" * 5000)


def test_ambiguous_texts_are_quoted() -> None:
    texts = ["1e3", "2018-06-01", "no", "y", "1:20", "0o17", "~", ""]
    assert write_yaml(texts) == "".join(f"- '{text}'\n" for text in texts)
