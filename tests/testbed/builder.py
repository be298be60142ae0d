"""Builds programs from Go modules, and fetches jars; what it needs meanwhile it removes at the end."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from tests.testbed import versions
from tests.testbed.errors import CommandFailed, Missing
from tests.testbed.progress import say
from tests.testbed.recipes import FLAGS, STRIP, Recipe
from tests.testbed.toolchain import find_go

GIB = 1024**3
LINKER_BYTES = 3 * GIB  # of the largest program; as many are linked at once as the flag -p says
NEEDED_BYTES = 9 * GIB  # modules and objects of Kubernetes; all of it is removed at the end
HADOOP_PARTS = ("hadoop-common", "hadoop-hdfs", "hadoop-hdfs-client")


class Workshop:
    """A folder with Go's caches, so that builds share what they have in common; it is removed at the end."""

    def __init__(self, folder: Path, tools: Path) -> None:
        self._folder = folder
        folder.parent.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(folder.parent).free
        if free < NEEDED_BYTES:
            raise Missing(
                f"building takes {NEEDED_BYTES / GIB:.0f} GiB for a while, and {folder.parent} has {free / GIB:.1f}: "
                "make room, or name another folder with XDG_CACHE_HOME"
            )
        self._go = find_go(tools)
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "tmp").mkdir(parents=True)

    def build(self, recipe: Recipe, target: Path) -> None:
        """Build the programs of a recipe into a folder, which is there only when all are.

        Raises:
            CommandFailed: Go could not; the message has the end of what it said.
        """
        say(f"building {recipe.name} {recipe.version} from its Go module (about {recipe.minutes:g} min on two cores)")
        start = time.monotonic()
        source = self._folder / "src" / recipe.name
        source.mkdir(parents=True)
        (source / "go.mod").write_text(
            f"module testbed/{recipe.name}\n\ngo {versions.GO}\n{self._requirements(recipe)}"
        )
        if recipe.main:
            (source / "main.go").write_text(recipe.main)
        draft = target.with_name(f"{target.name}.part")
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir(parents=True)
        stamps = [f"-X {variable}={value}" for variable, value in (recipe.stamps or {}).items()]
        flags = [f"-p={_workers()}", f"-tags={recipe.tags}", f"-ldflags={' '.join([STRIP, *stamps])}"]
        names = list(recipe.commands)
        output = f"{draft}/" if len(names) > 1 else str(draft / names[0])
        self._run(source, "build", *FLAGS, *flags, "-o", output, *recipe.commands.values())
        draft.rename(target)
        say(f"built {', '.join(names)} in {time.monotonic() - start:.0f} s")

    def close(self) -> None:
        """Remove the caches: several gigabytes that nobody needs any more."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _requirements(self, recipe: Recipe) -> str:
        """The lines of go.mod that name the module, and where to find what it cannot name itself."""
        lines = [f"require {recipe.module} v{recipe.version}"]
        if recipe.replaces:
            module = self._run(self._folder, "mod", "download", "-json", f"{recipe.module}@v{recipe.version}")
            (found,) = re.findall(r'"GoMod": "(.*)"', module)
            staged = sorted(set(re.findall(r"^\s+(\S+) v0\.0\.0$", Path(found).read_text(), re.MULTILINE)))
            lines += [f"replace {name} => {name} {recipe.replaces}" for name in staged]
        return "\n".join(lines) + "\n"

    def _run(self, folder: Path, *args: str) -> str:
        own = {
            "GOCACHE": str(self._folder / "cache"),
            "GOMODCACHE": str(self._folder / "modules"),
            "GOTMPDIR": str(self._folder / "tmp"),
            "CGO_ENABLED": "0",
            "GOFLAGS": "-modcacherw",  # so that the cache can be removed
            "GOTOOLCHAIN": "local",
        }
        command = [str(self._go), *args]
        done = subprocess.run(command, cwd=folder, env=os.environ | own, text=True, capture_output=True, check=False)
        if done.returncode:
            raise CommandFailed([shlex.join(command)], done.returncode, "", done.stderr)
        return done.stdout


def fetch_hadoop(folder: Path) -> None:
    """Hadoop's jars with everything that they need, by Maven, into a folder that is there only when all are.

    Raises:
        CommandFailed: Maven could not.
    """
    say(f"fetching Hadoop {versions.HADOOP} by Maven (about half a minute)")
    draft = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    project = draft / "pom.xml"
    project.write_text(_project(HADOOP_PARTS))
    command = ["mvn", "--batch-mode", "--quiet", "--file", str(project), "dependency:copy-dependencies"]
    command += ["-DincludeScope=runtime", f"-DoutputDirectory={draft}"]
    done = subprocess.run(command, text=True, capture_output=True, check=False)
    if done.returncode:
        raise CommandFailed(command, done.returncode, done.stdout, done.stderr)
    project.unlink()
    draft.rename(folder)


def _project(parts: Sequence[str]) -> str:
    dependency = (
        "<dependency><groupId>org.apache.hadoop</groupId><artifactId>{}</artifactId><version>{}</version></dependency>"
    )
    dependencies = "".join(dependency.format(part, versions.HADOOP) for part in parts)
    head = '<project xmlns="http://maven.apache.org/POM/4.0.0"><modelVersion>4.0.0</modelVersion>'
    own = "<groupId>testbed</groupId><artifactId>hadoop</artifactId><version>1</version><packaging>pom</packaging>"
    return f"{head}{own}<dependencies>{dependencies}</dependencies></project>\n"


def _workers() -> int:
    """How many compilers or linkers run at once: not more than cores, nor than memory bears."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return max(1, min(len(os.sched_getaffinity(0)), memory // LINKER_BYTES))
