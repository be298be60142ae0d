"""What is in the images, tried in containers without a cluster: as their user, and as few rights as pods have."""

from __future__ import annotations

import json
import os
import re
import stat
import tarfile
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from fleet import __version__
from tests.function_servers import EXAMPLE
from tests.testbed.errors import Missing
from tests.testbed.images import NAMES, build_twice, ensure_images, image_container, reference
from tests.testbed.imaging.container import Container
from tests.testbed.imaging.inputs import ROOT
from tests.testbed.ports import Ports
from tests.testbed.requirements import need, refuse

pytestmark = pytest.mark.xdist_group("images")

MEGABYTES = {"base": 135, "runtime": 820, "function": 510, "operator": 400, "hdfs": 250}
"""What images may have unpacked; a new dependency that is heavy has to be asked for here."""

KERNEL = ROOT / "containers/runtime/kernel"

HDFS_SITE = """<configuration>
  <property><name>fs.defaultFS</name><value>hdfs://localhost:8020</value></property>
  <property><name>dfs.namenode.name.dir</name><value>file:///data/metadata</value></property>
</configuration>
"""

UNCHECKED_HASH = 0b01
"""The flags of a .pyc that Python takes without a look at the source (PEP 552)."""


@pytest.fixture(scope="module")
def archives() -> dict[str, Path]:
    """The archives of all images."""
    need()
    try:
        return ensure_images()
    except Missing as error:
        refuse(str(error))


@pytest.fixture(scope="module")
def containers(archives: dict[str, Path]) -> Iterator[dict[str, Container]]:
    """A container of each image."""
    with ExitStack() as stack:
        mounts = {"/functions": EXAMPLE, "/tests": Path(__file__).parent / "in_images", "/kernel": KERNEL}
        yield {name: stack.enter_context(image_container(name, mounts)) for name in archives}


def _blob(archive: Path, path: str) -> Any:
    with tarfile.open(archive) as tar:
        file = tar.extractfile(path)
        assert file is not None
        return json.load(file)


def _manifest(archive: Path) -> Any:
    index = _blob(archive, "index.json")
    return _blob(archive, f"blobs/sha256/{index['manifests'][0]['digest'].removeprefix('sha256:')}")


BUILDAHS_OWN = re.compile("subprocess exited|Error: |time=")


def _said(container: Container, *command: str, env: dict[str, str] | None = None) -> tuple[int, str]:
    done = container.run(*command, env=env)
    lines = (done.stdout + done.stderr).splitlines()
    said = [line for line in lines if not BUILDAHS_OWN.match(line)]
    return done.returncode, "\n".join(said)


@pytest.mark.parametrize("name", NAMES)
def test_an_image_has_the_name_that_a_kubelet_looks_for_and_the_user_of_the_pods(
    archives: dict[str, Path], name: str
) -> None:
    entry = _blob(archives[name], "index.json")["manifests"][0]
    assert entry["annotations"]["io.containerd.image.name"] == f"docker.io/fleet-computer/{name}:{__version__}"
    assert reference(name) == f"docker.io/fleet-computer/{name}:{__version__}"
    digest = _manifest(archives[name])["config"]["digest"].removeprefix("sha256:")
    assert _blob(archives[name], f"blobs/sha256/{digest}")["config"]["User"] == "65532:65532"


@pytest.mark.parametrize("name", NAMES)
def test_an_image_is_no_larger_than_it_was(archives: dict[str, Path], name: str) -> None:
    assert sum(layer["size"] for layer in _manifest(archives[name])["layers"]) / 1e6 < MEGABYTES[name]


@pytest.mark.parametrize("name", NAMES)
def test_nothing_in_an_image_gives_rights_or_tells_of_the_builder(containers: dict[str, Container], name: str) -> None:
    root = containers[name].root
    found = {path: path.lstat() for path in root.rglob("*")}
    files = {path: status for path, status in found.items() if stat.S_ISREG(status.st_mode)}
    assert [path for path, status in files.items() if status.st_mode & (stat.S_ISUID | stat.S_ISGID)] == []
    assert [path for path, status in files.items() if status.st_mode & stat.S_IWOTH] == []
    folders = {path: status for path, status in found.items() if stat.S_ISDIR(status.st_mode)}
    open_to_all = {path for path, status in folders.items() if status.st_mode & stat.S_IWOTH}
    assert {path for path in open_to_all if not folders[path].st_mode & stat.S_ISVTX} == set()
    assert [path for path, status in found.items() if status.st_uid == 65532] == []
    left = ["root/.cache", "mnt/venv", "build", "etc/pip.conf", "run/secrets/pip.conf", "run/secrets/ca.crt"]
    assert [path for path in left if (root / path).exists()] == []
    assert [path for path in (root / "var/lib/apt/lists").glob("*") if path.is_file()] == []


@pytest.mark.parametrize("name", ["base", "runtime", "function", "operator"])
def test_python_finds_everything_compiled_and_never_compares_times(containers: dict[str, Container], name: str) -> None:
    root = containers[name].root
    compiled = [path for path in root.rglob("*.pyc") if "__pycache__" in path.parts]
    assert len(compiled) > 500
    assert [path for path in compiled if path.read_bytes()[4] != UNCHECKED_HASH] == []


@pytest.mark.parametrize(
    ("name", "command", "answer"),
    [
        ("base", ["python3", "-c", "import os; print(os.getuid(), os.getgid())"], (0, "65532 65532")),
        ("runtime", ["fleet", "--version"], (0, f"fleet {__version__}")),
        ("function", ["fleet", "--version"], (0, f"fleet {__version__}")),
        ("hdfs", ["java", "-version"], (0, "OpenJDK Runtime")),
        ("hdfs", ["hdfs-node"], (64, "usage: hdfs-node namenode")),
        ("hdfs", ["hdfs-node", "no-such-role"], (64, "usage: hdfs-node namenode")),
        ("runtime", ["python", "-m", "fleet.runtime"], (2, "usage: python -m fleet.runtime sensor|workflow")),
        ("operator", ["python", "-m", "fleet_operator"], (2, "name a kubeconfig file with KUBECONFIG")),
    ],
)
def test_the_programs_of_an_image_start(
    containers: dict[str, Container], name: str, command: list[str], answer: tuple[int, str]
) -> None:
    code, said = _said(containers[name], *command)
    assert (code, answer[1] in said) == (answer[0], True), said


@pytest.mark.parametrize("name", ["runtime", "function", "operator"])
def test_all_that_an_image_may_need_can_be_imported(containers: dict[str, Container], name: str) -> None:
    assert _said(containers[name], "python", "/tests/import_all.py", name) == (0, "")


def test_the_operators_image_has_the_example_and_no_learner(containers: dict[str, Container]) -> None:
    library = containers["operator"].root / "fleet/library/crop-scouting"
    files = {path.relative_to(library) for path in library.rglob("*") if path.is_file()}
    expected = {path.relative_to(EXAMPLE) for path in EXAMPLE.rglob("*") if path.is_file()}
    assert files == {path for path in expected if "__pycache__" not in path.parts}
    packages = containers["operator"].root / "opt/fleet/lib/python3.11/site-packages"
    heavy = ["numba", "llvmlite", "scipy", "sklearn", "skopt", "cv2", "matplotlib"]
    assert [name for name in heavy if (packages / name).exists()] == []


def test_roles_have_all_kernels_without_compiling_one(containers: dict[str, Container]) -> None:
    home = {"HOME": "/tmp/role"}
    code, said = _said(containers["runtime"], "python", "/tests/use_kernels.py", "fleet.runtime", env=home)
    if "cannot run them" in said:
        pytest.skip("this processor is older than x86-64-v2: it compiles the kernels itself")
    assert (code, said) == (0, "compiled 0, found 12 programs")


def test_programs_of_users_have_numba_as_it_is(containers: dict[str, Container]) -> None:
    shown = "import os; print([name for name in os.environ if name.startswith('NUMBA')])"
    assert _said(containers["runtime"], "python", "-c", shown) == (0, "[]")


def test_a_function_is_served_from_the_function_image(containers: dict[str, Container], tmp_path: Path) -> None:
    ports = Ports()
    port = ports.take()
    command = ["fleet", "serve", "map", "crop_scouting:map_observation", "--port", str(port)]
    server = containers["function"].start("env", "PYTHONPATH=/functions", *command, log=tmp_path / "server.log")
    try:
        server.wait_ready(lambda: _answers(f"http://127.0.0.1:{port}/healthz"))
    finally:
        server.stop()
        ports.close()


def _answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=5.0) as response:
            return bool(response.status == 200)
    except OSError:
        return False


def test_a_namenode_formats_an_empty_folder_and_no_other(archives: dict[str, Path], tmp_path: Path) -> None:
    configuration, data = tmp_path / "configuration", tmp_path / "data"
    for folder in (configuration, data / "metadata"):
        folder.mkdir(parents=True)
    os.chown(data / "metadata", 65532, 65532)
    (configuration / "hdfs-site.xml").write_text(HDFS_SITE, encoding="utf-8")
    version = data / "metadata/current/VERSION"
    with image_container("hdfs", {"/etc/hadoop": configuration, "/data": data}) as hdfs:
        # What somebody has put there is not ours to remove: the NameNode itself then says that it cannot read it.
        (data / "metadata/theirs").write_text("somebody's", encoding="utf-8")
        assert _said(hdfs, "hdfs-node", "format") == (0, "")
        assert not version.exists()
        (data / "metadata/theirs").unlink()
        assert _said(hdfs, "hdfs-node", "format")[0] == 0
        first = version.read_text("utf-8")
        assert _said(hdfs, "hdfs-node", "format") == (0, "")
    assert version.read_text("utf-8") == first


@pytest.mark.parametrize("name", ["base", "operator"])
def test_the_same_inputs_make_the_same_image_again(archives: dict[str, Path], name: str, tmp_path: Path) -> None:
    second = tmp_path / "second.tar"
    first = build_twice(name, second)
    assert _blob(second, "index.json") == _blob(first, "index.json")
