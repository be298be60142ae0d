"""All of the evaluation in one command.

    python -m bench.scouting.everything [--short] [--workers 2] [--only PART ...] [--fresh] [--out bench/out/scouting]

Flies, one after the other: plans and rivals, sizes of the planned swarm, stops, its memory, the paper's swarm and its
parts, learning between missions, the paper's headline figures, what contexts tell, hovering, late news; every real
field of the shared data, with ten seeds. All of it is in one folder: `results.json` has the machine, the commit, and
for each part its command, its duration and its figures; `tables.txt` all that was printed; beside them are the
pictures. A part that fails is told at the end, the others run on. What is there already, by the same command at the
same commit, is not flown again unless --fresh is given: a run that was broken off goes on.

The full form takes about an hour on two cores, half of it the paper's swarm. The short form takes two
minutes: two seeds, quick learning and few fields; its figures say that everything runs, not more.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench import machine

OUT = Path(__file__).resolve().parents[1] / "out" / "scouting"
SHORT_OUT = OUT.with_name("scouting-short")
_FEW = ("--fields", "2018-08-02", "lasrosas-1999")
_BRIEF = ("--seeds", "2", *_FEW)


@dataclass(frozen=True)
class Part:
    """A module of the evaluation.

    Args:
        name: Of the module in this package; "plans" is the package itself. Its files are called so too.
        short: Options of the short form.
        reads: Parts whose files it is given, as options of their names.
    """

    name: str
    short: tuple[str, ...] = _BRIEF
    reads: tuple[str, ...] = ()

    @property
    def module(self) -> str:
        """For `python -m`."""
        return "bench.scouting" if self.name == "plans" else f"bench.scouting.{self.name}"


PARTS = (
    Part("plans", ("--short",)),
    Part("sizes"),
    Part("stops"),
    Part("memory"),
    Part("paper", ("--short", *_FEW, "--agents", "1", "2", "4", "8")),
    Part("online", ("--short", *_FEW, "--goals", "0.75", "0.9")),
    Part("headlines", ("--short", *_FEW), reads=("paper", "online")),
    Part("contexts", ("--short", *_FEW)),
    Part("hover"),
    Part("late"),
)
"""In the order in which they run."""


@dataclass(frozen=True)
class Form:
    """How all parts are run.

    Args:
        out: The folder of all files.
        short: Whether in the short form.
        workers: Processes.
    """

    out: Path
    short: bool
    workers: int

    def command(self, part: Part) -> list[str]:
        """What is run for a part, as arguments of Python."""
        options = list(part.short) if self.short else []
        for other in part.reads:
            options += [f"--{other}", str(self.file(other))]
        return ["-m", part.module, *options, "--workers", str(self.workers), "--out", str(self.file(part.name))]

    def file(self, name: str) -> Path:
        """Where a part writes its figures."""
        return self.out / f"{name}.json"

    @property
    def results(self) -> Path:
        """The file with the figures of all parts."""
        return self.out / "results.json"


def run(form: Form, wanted: Sequence[Part]) -> list[str]:
    """Run parts, and write what came of each as soon as it is there.

    Returns:
        Names of those that failed.
    """
    form.out.mkdir(parents=True, exist_ok=True)
    sections, failed = kept(form), []
    for part in wanted:
        command = form.command(part)
        if _is_known(sections.get(part.name), command):
            print(f"{part.name} is in {form.results}", flush=True)
            continue
        sections[part.name] = ran(form, part, command)
        if sections[part.name]["exit_code"]:
            failed.append(part.name)
        save(form, sections)
    return failed


def ran(form: Form, part: Part, command: Sequence[str]) -> dict[str, Any]:
    """Run a part; what it prints is shown, and kept."""
    started, clock, on = datetime.now(UTC), time.perf_counter(), machine.facts()
    form.file(part.name).unlink(missing_ok=True)
    printed = []
    with subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True, encoding="utf-8") as process:
        assert process.stdout is not None  # it was asked for
        for line in process.stdout:
            printed.append(line)
            print(line, end="", flush=True)
    seconds = time.perf_counter() - clock
    code = process.returncode or int(not form.file(part.name).is_file())
    print(f"python {' '.join(command)}: {'failed' if code else 'done'} after {seconds:.0f} s", flush=True)
    return {
        "command": f"python {' '.join(command)}",
        "started": started.isoformat(timespec="seconds"),
        "seconds": round(seconds, 1),
        "exit_code": code,
        "machine": on,
        "tables": "".join(printed),
        "results": None if code else json.loads(form.file(part.name).read_text(encoding="utf-8")),
    }


def kept(form: Form) -> dict[str, dict[str, Any]]:
    """What an earlier run left, by part."""
    if not form.results.is_file():
        return {}
    parts: dict[str, dict[str, Any]] = json.loads(form.results.read_text(encoding="utf-8"))["parts"]
    return parts


def _is_known(section: dict[str, Any] | None, command: Sequence[str]) -> bool:
    """Whether a part was run by the same command at the same commit, and did not fail."""
    if section is None or section["exit_code"]:
        return False
    same = section["machine"]["commit"] == machine.commit() and not machine.commit().endswith("changed")
    return same and section["command"] == f"python {' '.join(command)}"


def save(form: Form, sections: dict[str, dict[str, Any]]) -> None:
    """Write the figures and tables of all parts, in their order."""
    parts = {part.name: sections[part.name] for part in PARTS if part.name in sections}
    document = {
        "command": " ".join(["python", *sys.orig_argv[1:]]),
        "seconds": round(sum(each["seconds"] for each in parts.values()), 1),
        "machine": machine.facts(),
        "parts": parts,
    }
    form.results.write_text(json.dumps(document) + "\n", encoding="utf-8")
    told = "\n".join(
        f"## {each['command']}\n{each['seconds']:.0f} s, exit code {each['exit_code']}, "
        f"commit {each['machine']['commit']}\n\n{each['tables']}"
        for each in parts.values()
    )
    on = "\n".join(f"{name}: {value}" for name, value in document["machine"].items())
    (form.out / "tables.txt").write_text(f"{document['command']}\n{on}\n\n{told}", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all; the exit code says whether anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=[part.name for part in PARTS], help="parts that are run")
    parser.add_argument("--fresh", action="store_true", help="run again what is there already")
    parser.add_argument("--out", type=Path, help=f"folder of all files; {OUT}, of the short form {SHORT_OUT}")
    asked = parser.parse_args(arguments)
    form = Form(asked.out or (SHORT_OUT if asked.short else OUT), asked.short, asked.workers)
    if asked.fresh:
        form.results.unlink(missing_ok=True)
    failed = run(form, [part for part in PARTS if not asked.only or part.name in asked.only])
    print(f"figures in {form.results}, tables and pictures beside it")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
