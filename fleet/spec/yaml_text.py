"""YAML as Kubernetes reads it, with the line of every value: the one module here that imports yaml."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from fleet.errors import Problem, SpecError

MAX_NODES = 200_000
"""More values than any resource has; aliases can make a small file mean billions."""
MAX_DEPTH = 60

Path = tuple[str | int, ...]
"""Where a value is in a document: field names and list indices."""


def render(path: Path) -> str:
    """The path as users read it: `spec.agents.members[1].actions[0]`."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")


@dataclass(frozen=True)
class Document:
    """A YAML document.

    Args:
        value: Mappings, lists, texts, numbers, booleans and None, as JSON has them.
        lines: Line of each value, from 1, by path.
        problems: What is wrong with it as YAML though it can be read: a field twice, a tag.
        broken: Where that is.
    """

    value: Any
    lines: Mapping[Path, int] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()
    broken: tuple[Path, ...] = ()

    def line(self, path: Path) -> int:
        """Line of a value, or of the nearest value around it; 0 when the document is not from a file."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 0)


class _Reader(yaml.SafeLoader):
    """YAML 1.1 without dates, sexagesimal numbers and `=`, and with `1e3` as a number, as Kubernetes reads it."""


class _Writer(yaml.SafeDumper):
    """Quotes every text that some YAML reader takes for something else."""


_FLOAT = re.compile(
    r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
)
_INT = re.compile(r"^[-+]?(?:0b[01]+|0x[0-9a-fA-F]+|0o?[0-7]+|0|[1-9][0-9]*)$")
_REPLACED = {"tag:yaml.org,2002:" + name for name in ("timestamp", "float", "int", "value")}
_Reader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in _REPLACED]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Reader.add_implicit_resolver("tag:yaml.org,2002:int", _INT, list("-+0123456789"))
_Reader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))
_Writer.yaml_implicit_resolvers = {
    first: list(resolvers) for first, resolvers in yaml.SafeDumper.yaml_implicit_resolvers.items()
}
_Writer.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))
_Writer.add_implicit_resolver("tag:yaml.org,2002:int", _INT, list("-+0123456789"))
_Writer.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"^[yYnN]$"), list("yYnN"))


def _write_text(writer: yaml.SafeDumper, text: str) -> yaml.Node:
    """Unicode's line breaks are escaped: PyYAML would write them as they are, and read them as spaces."""
    style = '"' if re.search("[\x85\u2028\u2029\ufeff]", text) else None
    return writer.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Writer.add_representer(str, _write_text)


def write_yaml(value: object) -> str:
    """A document as YAML: fields in their order, texts quoted where a reader could take them for something else."""
    text: str = yaml.dump(value, Dumper=_Writer, sort_keys=False, allow_unicode=True, width=120)
    return text


def read_yaml(text: str, source: str = "") -> list[Document]:
    """The documents of a YAML text; empty ones are left out.

    Raises:
        SpecError: the text is not YAML.
    """
    try:
        return [
            _Builder().build(node)
            for node in yaml.compose_all(text, Loader=_Reader)
            if not (isinstance(node, yaml.ScalarNode) and node.value == "")
        ]
    except yaml.YAMLError as error:
        raise SpecError([_syntax_problem(error)], source) from error
    except RecursionError as error:
        raise SpecError([Problem("", "this YAML is nested too deeply to be read")], source) from error


_PLAIN_TAGS = {"tag:yaml.org,2002:" + name for name in ("str", "int", "float", "bool", "null", "map", "seq")}


class _Builder:
    """Turns a tree of YAML nodes into a Document, and gathers what is wrong on the way."""

    def __init__(self) -> None:
        self._problems: list[Problem] = []
        self._broken: list[Path] = []
        self._lines: dict[Path, int] = {}
        self._scalars = yaml.constructor.SafeConstructor()

    def build(self, node: yaml.Node) -> Document:
        value = self._value(node, ())
        return Document(value, self._lines, tuple(self._problems), tuple(self._broken))

    def _value(self, node: yaml.Node, path: Path) -> Any:
        self._lines.setdefault(path, node.start_mark.line + 1)
        if len(path) > MAX_DEPTH or len(self._lines) > MAX_NODES:
            raise yaml.MarkedYAMLError(problem="the document is too deep or too large", problem_mark=node.start_mark)
        if not isinstance(node, yaml.ScalarNode) and node.tag not in _PLAIN_TAGS:
            self._report(node, path, f"has the YAML tag {_short(node)}, which a resource cannot have", "remove the tag")
        match node:
            case yaml.MappingNode():
                return self._mapping(node, path)
            case yaml.SequenceNode():
                return [self._value(item, (*path, index)) for index, item in enumerate(node.value)]
            case _:
                return self._scalar(node, path)

    def _scalar(self, node: yaml.Node, path: Path) -> Any:
        if node.tag not in _PLAIN_TAGS:
            self._report(
                node, path, f"has the YAML tag {_short(node)}, which a resource cannot have", "write a plain value"
            )
            return None
        try:
            return _number(node) if node.tag.endswith((":int", ":float")) else self._scalars.construct_object(node)
        except (ValueError, yaml.YAMLError):
            self._report(
                node, path, f"{node.value[:40]!r} cannot be read as a value", "put it in quotes if it is a text"
            )
            return None

    def _mapping(self, node: yaml.MappingNode, path: Path) -> dict[str, Any]:
        result: dict[str, Any] = {}
        merged: dict[str, Any] = {}
        first_line: dict[str, int] = {}
        for key_node, value_node in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                for source in _merge_sources(value_node):
                    merged = self._mapping(source, path) | merged
                continue
            if not isinstance(key_node, yaml.ScalarNode):
                self._report(key_node, path, "a field name is a list or a mapping", "write a plain name")
                continue
            key = key_node.value
            here = (*path, key)
            if key in first_line:
                hint = f"keep one of the two (the other is in line {first_line[key]})"
                self._report(key_node, here, "is given twice", hint)
                continue
            first_line[key] = key_node.start_mark.line + 1
            self._lines[here] = first_line[key]
            result[key] = self._value(value_node, here)
        return result | {key: value for key, value in merged.items() if key not in result}

    def _report(self, node: yaml.Node, path: Path, message: str, hint: str) -> None:
        self._broken.append(path)
        self._problems.append(Problem(render(path), message, hint, node.start_mark.line + 1))


def _short(node: yaml.Node) -> str:
    return str(node.tag).replace("tag:yaml.org,2002:", "!!")


def _number(node: yaml.Node) -> int | float:
    text = node.value.lower().removeprefix("+")
    if node.tag.endswith(":float"):
        return float(text.replace(".inf", "inf").replace(".nan", "nan"))
    sign, digits = (-1, text[1:]) if text.startswith("-") else (1, text)
    if digits.startswith("0") and len(digits) > 1 and digits[1] in "01234567":
        return sign * int(digits, 8)
    return sign * int(digits, 0)


def _merge_sources(node: yaml.Node) -> Iterator[yaml.MappingNode]:
    """The mappings that `<<` names; the first of several wins."""
    candidates = node.value if isinstance(node, yaml.SequenceNode) else [node]
    for candidate in candidates:
        if not isinstance(candidate, yaml.MappingNode):
            raise yaml.MarkedYAMLError(problem="`<<` needs a mapping", problem_mark=candidate.start_mark)
        yield candidate


_PLAIN = (
    (r"found character '\\t' that cannot start any token", "a tab stands where YAML wants spaces"),
    (r"found character '(.)' that cannot start any token", r"a text that begins with `\1` must be in quotes"),
    (r"found undefined alias '(.*)'", r"`*\1` refers to an anchor that is not there; a text that begins with `*` "
     "must be in quotes"),
    (r"mapping values are not allowed here", "a `:` stands where no field can begin: check the indentation of this "
     "line and the one before, and put texts that contain `: ` in quotes"),
    (r"could not find expected ':'", "a field name without `: `"),
    (r"expected ',' or '(.)', but got .*", r"`\1` or `,` is missing before this place"),
    (r"found unexpected end of stream", "a quote is opened and never closed"),
    (r"expected <block end>, but found '(<block mapping start>|<block sequence start>|-)'", "this line is indented "
     "more or less than its neighbours"),
    (r"expected <block end>, but found .*", "a field name without `: `, or a wrong indentation"),
    (r"expected '<document start>', but found .*", "the text ends its document and goes on: check the indentation"),
    (r"found unknown escape character .*", "a backslash in double quotes begins an escape; use single quotes"),
)  # fmt: skip


def _syntax_problem(error: yaml.YAMLError) -> Problem:
    """PyYAML's error, said plainly."""
    if not isinstance(error, yaml.MarkedYAMLError):
        reason = str(error).splitlines()[0]
        return Problem("", f"not YAML: {reason}", "save the file as plain text in UTF-8")
    mark = error.problem_mark or error.context_mark
    reason = error.problem or "it cannot be read"
    for pattern, plain in _PLAIN:
        if re.fullmatch(pattern, reason):
            reason = re.sub(pattern, plain, reason)
            break
    opened = error.context_mark
    if opened is not None and mark is not None and "scalar" not in reason and opened.line != mark.line:
        reason += f" (what it belongs to began in line {opened.line + 1})"
    where = f"column {mark.column + 1}: " if mark else ""
    return Problem("", f"{where}not YAML: {reason}", line=mark.line + 1 if mark else 0)
