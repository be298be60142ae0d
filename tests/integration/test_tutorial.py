"""docs/tutorial.md works when its commands are given one after the other."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT


def test_every_command_of_the_tutorial_works(tmp_path: Path) -> None:
    text = (ROOT / "docs/tutorial.md").read_text()
    script = "\n".join(re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    (tmp_path / "tutorial.sh").write_text(script)
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "tutorial.sh"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "refused with exit code 2" in done.stdout
    for run in ("run", "strict", "survey"):
        assert (tmp_path / "my-swarm" / run / "report.html").is_file()
