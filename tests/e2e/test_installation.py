"""The commands of docs/install.md that need pods: what they say holds on machines, and a restore restores."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest

from fleet.storage.hdfs import HdfsStorage
from tests.chart import ROOT
from tests.integration.test_chart_docs import blocks
from tests.testbed.bed import Bed
from tests.testbed.binaries import tool
from tests.testbed.installation import RELEASE, SYSTEM, reach_storage
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.xdist_group("bed"), pytest.mark.slow]

PATIENCE_S = 600
KEPT = "kept/before-the-loss.txt"
# A merged file replaces an older one, which may go between the shell's look and that of stat.
CHECKPOINTS = "stat -c %Y /hadoop/metadata/checkpoint/current/fsimage_* || true"


@pytest.fixture(scope="module")
def commands() -> dict[str, str]:
    """What is to be typed with pods, by what it does."""
    text = (ROOT / "docs/install.md").read_text()
    found = [script for kind, script in blocks(text) if kind == "sh pods"]
    marks = {"check": "helm test", "fly": "crop-scouting", "back up": "> names.tar", "restore": "start=Wait"}
    named = {name: [script for script in found if mark in script] for name, mark in marks.items()}
    assert sorted(script for scripts in named.values() for script in scripts) == sorted(found)
    return {name: script for name, (script,) in named.items()}


def run(script: str, bed: Bed, folder: Path) -> str:
    """What a user sees who types this beside a copy of the chart."""
    (folder / "charts").symlink_to(ROOT / "charts")
    for name in ("kubectl", "helm"):
        (folder / name).symlink_to(tool(name))
    homes = {f"HELM_{kind}_HOME": str(folder / kind) for kind in ("CACHE", "CONFIG", "DATA")}
    own = {"PATH": f"{folder}:{os.environ['PATH']}", "KUBECONFIG": str(bed.kubeconfig), **homes}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=folder,
        env=os.environ | own | {"KUBECACHEDIR": str(folder / "kubectl-cache")},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_an_installation_is_checked_as_the_docs_say(
    bed: Bed, installed: HdfsStorage, commands: dict[str, str], tmp_path: Path
) -> None:
    said = run(commands["check"], bed, tmp_path)
    assert "Phase:          Succeeded" in said
    lines = [line.split()[0] for line in said.splitlines() if line.startswith(("ok", "FAIL"))]
    assert lines == ["ok"] * len(lines)
    assert len(lines) >= 3


def test_the_names_of_all_files_come_back_from_a_checkpoint(
    bed: Bed, installed: HdfsStorage, commands: dict[str, str], tmp_path: Path
) -> None:
    installed.write(KEPT, b"it is still there")
    written_s = time.time()

    def merged() -> bool:
        times = bed.kubectl("exec", f"{RELEASE}-checkpoint-0", "-n", SYSTEM, "--", "sh", "-c", CHECKPOINTS)
        return max(map(int, times.split()), default=0) > written_s + 1

    wait_for("a checkpoint with the file", merged, PATIENCE_S, every_s=1.0)
    for name in ("back up", "restore"):
        (tmp_path / name).mkdir()
        run(commands[name], bed, tmp_path / name)
    assert (tmp_path / "back up/names.tar").stat().st_size > 0
    ready = ("rollout", "status", f"statefulset/{RELEASE}-namenode", "-n", SYSTEM, f"--timeout={PATIENCE_S}s")
    bed.kubectl(*ready, timeout_s=PATIENCE_S + 60)
    assert reach_storage(bed).read(KEPT) == b"it is still there"
    inside = bed.kubectl("exec", f"{RELEASE}-namenode-0", "-n", SYSTEM, "--", "ls", "/hadoop/metadata")
    assert [name for name in inside.split() if name.startswith("lost-")] != []
