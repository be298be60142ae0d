"""docs/troubleshoot.md, operate.md, security.md, testbed.md and architecture.md say what the code does."""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from fleet.errors import ExitCode
from fleet.spec.base import Resources
from fleet.spec.resources import FleetStatus
from fleet_operator.compiler import defaults
from fleet_operator.policy.status import fleet_status, story
from fleet_operator.reconcile import asked
from fleet_operator.reconcile.copies import FEWER_COPIES
from fleet_operator.resources.conditions import FleetCondition
from fleet_operator.service import metrics
from tests.conftest import ROOT
from tests.situations import SITUATIONS
from tests.testbed.__main__ import parser

DOCS = ROOT / "docs"
OPERATOR = ROOT / "operator/fleet_operator"
SOURCES = [*OPERATOR.rglob("*.py"), *(ROOT / "fleet").rglob("*.py"), *(ROOT / "charts").rglob("*.[yt][ap][ml]*")]
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
BY_HAND = [path for path in PAGES if path.parent.name != "reference"]  # test_spec_reference has the others
WORD = re.compile(r"[A-Z][A-Za-z]+")
IN_CODE = re.compile(r"`([^`\n]+)`")


def page(name: str) -> str:
    return (DOCS / name).read_text()


def rows(text: str, heading: str) -> list[list[str]]:
    """Cells of the table under a heading of its first cell, without the head."""
    table = re.search(rf"^\| {re.escape(heading)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert table is not None, f"there is no table of {heading}"
    return [[cell.strip() for cell in line.strip("|\n").split(" | ")] for line in table[1].splitlines()]


class Reasons(ast.NodeVisitor):
    """Every word that a call of `Trouble` or `refused` may get as its reason: constants, and what variables hold.

    Args:
        tree: The module.
        constants: The words of constants that it may import.
    """

    def __init__(self, tree: ast.Module, constants: dict[str, str]) -> None:
        self._known: dict[str, list[ast.expr]] = {name: [ast.Constant(word)] for name, word in constants.items()}
        self.found: set[str] = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign):
                self._learn(node.targets[0], node.value)
        self.visit(tree)

    def _learn(self, target: ast.expr, value: ast.expr) -> None:
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            for one, part in zip(target.elts, value.elts, strict=True):
                self._learn(one, part)
        elif isinstance(target, ast.Name):
            self._known.setdefault(target.id, []).append(value)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name in ("Trouble", "refused") and node.args:
            self.found |= set(self._words(node.args[0], set()))
        self.generic_visit(node)

    def _words(self, expression: ast.expr, seen: set[str]) -> Iterator[str]:
        for node in ast.walk(expression):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and WORD.fullmatch(node.value):
                yield node.value
            if isinstance(node, ast.Name) and node.id not in seen:
                for value in self._known.get(node.id, ()):
                    yield from self._words(value, seen | {node.id})


def reasons() -> set[str]:
    """Reasons of Degraded and of refusals, everywhere in the operator."""
    constants = {name: word for name, word in vars(asked).items() if name.isupper() and isinstance(word, str)}
    files = OPERATOR.rglob("*.py")
    return set().union(*(Reasons(ast.parse(file.read_text()), constants).found for file in files))


def headings(text: str) -> set[str]:
    return set(re.findall(r"^### ([A-Z]\w+)$", text, re.MULTILINE))


def test_every_trouble_of_the_code_has_its_heading_and_every_heading_its_trouble() -> None:
    found = reasons()
    assert {"Invalid", "FilesMissing", "ImageMissing", "QuotaExceeded", "PodRefused", "StorageFull"} <= found
    assert headings(page("troubleshoot.md")) == found


def test_every_trouble_comes_with_a_command() -> None:
    parts = re.split(r"^###? ", page("troubleshoot.md"), flags=re.MULTILINE)
    without = [part.split("\n", 1)[0] for part in parts[1:] if "```sh" not in part]
    assert without == ["Invalid", "Degraded"], "their commands are in the sections around them"


@pytest.mark.parametrize("name", ["troubleshoot.md", "operate.md"])
def test_every_name_that_a_page_writes_in_camel_case_is_in_the_code(name: str) -> None:
    code = "\n".join(file.read_text() for file in SOURCES)
    named = {word for word in IN_CODE.findall(page(name)) if re.fullmatch(r"[A-Z][a-z]+([A-Z][a-z]+)+", word)}
    assert named
    assert {word for word in named if not re.search(rf"\b{word}\b", code)} == set()


def test_the_table_of_events_has_every_event() -> None:
    told = IN_CODE.findall(" ".join(row[0] for row in rows(page("operate.md"), "event")))
    statuses: list[FleetStatus | None] = [None, *(fleet_status(each, None) for each in SITUATIONS.values())]
    happens = {
        reason
        for before, after in itertools.product(statuses, statuses)
        if after is not None
        for _, reason, _ in story(before, after)
    }
    troubles = reasons() | {trouble.reason for each in SITUATIONS.values() for trouble in each.troubles}
    refusals = {each.refusal.reason for each in SITUATIONS.values() if each.refusal}
    assert set(told) == (happens - troubles - refusals) | {"Adopted", FEWER_COPIES}
    assert '"Adopted"' in (OPERATOR / "reconcile/claiming.py").read_text()


def test_the_table_of_conditions_has_every_condition() -> None:
    told = [row[0].strip("`") for row in rows(page("operate.md"), "condition of a FleetSpec")]
    assert set(told) == {each.value for each in FleetCondition}


def test_every_phase_is_named() -> None:
    description = str(FleetStatus.model_fields["phase"].description)
    words = description.partition(":")[2].partition(".")[0].replace(" or ", ", ").split(",")
    text = " ".join(page("operate.md").split())
    assert f"a word for people: {', '.join(word.strip() for word in words[:-1])} or {words[-1].strip()}." in text


def test_the_table_of_metrics_is_the_code_s() -> None:
    named = {row[0].strip("`").partition("{")[0] for row in rows(page("operate.md"), "metric")}
    assert named == {value.name for value in vars(metrics).values() if isinstance(value, metrics.Metric)}


def test_the_table_of_sizes_is_the_code_s() -> None:
    table = {row[0]: row[1:5] for row in rows(page("operate.md"), "container") if "its share" not in row}

    def cells(resources: Resources) -> list[str]:
        least, most = resources.requests, resources.limits
        assert least is not None
        assert most is not None
        return [str(least.cpu), str(most.cpu), str(least.memory), str(most.memory)]

    assert table == {
        "sensor": cells(defaults.SENSOR),
        "workflow": cells(defaults.WORKFLOW),
        "map, eval, each": cells(defaults.FUNCTION),
        "trainer": cells(defaults.TRAINER),
    }


def test_the_table_of_exit_codes_is_the_code_s() -> None:
    codes = [int(row[0]) for row in rows(page("troubleshoot.md"), "exit code of a role")]
    assert codes == [ExitCode.USAGE, ExitCode.PERMANENT, ExitCode.TRANSIENT, 137]


def test_the_answers_of_the_probes_are_the_code_s() -> None:
    code = (OPERATOR / "service/service.py").read_text()
    told = [row[0].strip("`") for row in rows(page("troubleshoot.md"), "`/readyz` or `/healthz` says")]
    assert len(told) == 6
    assert [words for words in told if words not in code] == []


def test_the_sentences_of_a_fleet_that_failed_are_the_code_s() -> None:
    code = "\n".join(file.read_text() for file in OPERATOR.rglob("*.py"))
    table = rows(page("troubleshoot.md"), "the message begins with or has")
    told = IN_CODE.findall(" ".join(row[0] for row in table))
    assert len(told) == 5
    assert [words for words in told if words.removesuffix(" failed") not in code] == []


def anchors(path: Path) -> set[str]:
    """Anchors of a page's headings as GitHub makes them."""
    titles = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("path", BY_HAND, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_anchor_of_a_link_is_a_heading(path: Path) -> None:
    links = re.findall(r"\]\(([^)#:]*)#([^)]+)\)", path.read_text())
    assert [f"{to}#{what}" for to, what in links if what not in anchors(path.parent / to if to else path)] == []


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_make_target_that_a_page_names_is_there(path: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"(?:^|`)make ([a-z-]+)", path.read_text(), re.MULTILINE))
    assert named - targets == set()


@pytest.mark.parametrize("name", ["architecture.md", "glossary.md", "security.md", "testbed.md"])
def test_every_module_and_path_that_a_page_names_exists(name: str) -> None:
    """A name without a package is one of the operator, of fleet, or of the test bed, whatever the page is about."""
    roots = [ROOT, ROOT / "operator", OPERATOR, ROOT / "fleet", ROOT / "tests", ROOT / "tests/testbed"]
    missing = []
    for text in IN_CODE.findall(page(name)):
        if re.fullmatch(r"(fleet|fleet_operator|tests|[a-z]+)(\.[a-z_]+)+(\.[A-Z]\w*(\.\w+)?)?", text):
            place = re.sub(r"\.[A-Z].*", "", text).replace(".", "/")
        elif re.fullmatch(r"(tests|charts|crds|docs|containers|bench|operator|examples)(/[\w.-]+)+", text):
            place = text
        else:
            continue
        if text.endswith((".json", ".npz", ".jsonl", ".io", ".kube")):
            continue
        places = [root / place for root in roots] + [root / f"{place}.py" for root in roots]
        if not any(each.exists() for each in places) and not _is_attribute(place, roots):
            missing.append(text)
    assert missing == []


def _is_attribute(place: str, roots: list[Path]) -> bool:
    """Whether the last part is a name within a module, or a field of the FleetSpec or of the chart's values."""
    module, _, name = place.rpartition("/")
    files = [path for root in roots if (path := root / f"{module}.py").is_file()]
    if any(re.search(rf"\b{name}\b", path.read_text()) for path in files):
        return True
    known = (ROOT / "docs/reference/fleetspec.md").read_text() + (
        ROOT / "charts/fleet-computer/values.yaml"
    ).read_text()
    return not files and all(re.search(rf"\b{part}\b", known) for part in place.split("/"))


def test_every_value_of_the_chart_that_a_page_sets_is_there() -> None:
    values = (ROOT / "charts/fleet-computer/values.yaml").read_text()
    for path in PAGES:
        for name in re.findall(
            r"`((?:operator|hdfs|images|crds|priorityClasses|networkPolicies)(?:\.\w+)+)(?:=[^`]*)?`", path.read_text()
        ):
            missing = [
                part for part in name.split(".") if not re.search(rf"^ *{part}:|[{{ ]{part}:", values, re.MULTILINE)
            ]
            assert missing == [], f"{path.name}: {name}"


def test_the_commands_of_the_test_bed_s_page_are_its_own() -> None:
    commands = re.findall(r"^python -m tests\.testbed (.+?)(?: +#.*)?$", page("testbed.md"), re.MULTILINE)
    assert len(commands) >= 5
    for command in commands:
        parser().parse_args(command.split())


def test_the_variables_of_the_environment_that_pages_name_are_read_somewhere() -> None:
    read_by = [*SOURCES, *(ROOT / "tests/testbed").rglob("*.py"), *(ROOT / "bench").rglob("*.py")]
    code = "\n".join(file.read_text() for file in read_by)
    named = {name for path in PAGES for name in re.findall(r"\bFLEET_[A-Z_]*[A-Z]\b", path.read_text())}
    assert {name for name in named if name not in code} == set()


def test_pictures_drawn_by_hand_have_a_title_and_a_description() -> None:
    for path in (DOCS / "images").glob("*.svg"):
        root = ElementTree.fromstring(path.read_text())
        told = {each.tag.rpartition("}")[2] for each in root}
        assert {"title", "desc"} <= told


def test_decisions_are_listed_once_and_in_order() -> None:
    pages = sorted(path.name for path in (DOCS / "adr").glob("0*.md"))
    assert re.findall(r"^\| \[\d+\]\((\S+)\) \|", page("adr/README.md"), re.MULTILINE) == pages
    assert [int(name[:4]) for name in pages] == list(range(1, len(pages) + 1))
    for name in pages:
        title = page(f"adr/{name}").splitlines()[0].partition(". ")[2]
        assert f"({name}) | {title} |" in page("adr/README.md")
