"""What the chart gives to HDFS — configuration, probes, programs, steps of a restore — on real processes of Hadoop."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import httpx
import pytest

from tests.chart import BED_VALUES, CHART, RELEASE, Helm, Manifest, find, pod_of
from tests.testbed.binaries import hadoop_jars
from tests.testbed.processes import Program
from tests.testbed.requirements import need
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.xdist_group("control-plane"), pytest.mark.slow]

SERVERS = "org.apache.hadoop.hdfs.server"
PROGRAMS = {
    "namenode": f"{SERVERS}.namenode.NameNode",
    "checkpoint": f"{SERVERS}.namenode.SecondaryNameNode",
    "datanode": f"{SERVERS}.datanode.DataNode",
}
CONTENT = bytes(range(256)) * 1000


class Site:
    """The processes of a release on loopback addresses of their own, with the ports of the chart."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        network = f"127.{random.SystemRandom().randint(1, 254)}.{random.SystemRandom().randint(0, 255)}"
        self.namenode, self.checkpoint, *self.nodes = (f"{network}.{last}" for last in (1, 2, 11, 12))
        self.manifests = Helm(folder / "helm").manifests("--values", BED_VALUES, *self._moved())
        configuration = find(self.manifests, "ConfigMap", f"{RELEASE}-hdfs")["data"]
        (folder / "conf").mkdir()
        for name, text in configuration.items():
            (folder / "conf" / name).write_text(text)
        for server in ("hdfs", "datanode", "secondary"):  # Hadoop's servers look for these folders
            (folder / "web/webapps" / server).mkdir(parents=True)
        self.programs = {
            "namenode": self.program("namenode"),
            "checkpoint": self.program("checkpoint"),
            **{node: self.program("datanode", node) for node in self.nodes},
        }

    def _moved(self) -> list[str]:
        """Addresses and folders that are the pods' own in a cluster."""
        site = {
            "dfs.namenode.rpc-address": f"{self.namenode}:8020",
            "dfs.namenode.http-address": f"{self.namenode}:9870",
            "dfs.namenode.rpc-bind-host": self.namenode,
            "dfs.namenode.http-bind-host": self.namenode,
            "dfs.namenode.secondary.http-address": f"{self.checkpoint}:9868",
            "dfs.namenode.checkpoint.period": "1s",
            "dfs.namenode.name.dir": "file://${env.POD}/metadata/name",
            "dfs.namenode.checkpoint.dir": "file://${env.POD}/metadata/checkpoint",
            "dfs.datanode.data.dir": "file://${env.POD}/data",
            # All of them reach the NameNode from 127.0.0.1: here it is the port that tells them apart.
            "dfs.datanode.address": "${env.NODE_ADDRESS:-localhost}:${env.DATA_PORT:-9866}",
        }
        core = {"fs.defaultFS": f"hdfs://{self.namenode}:8020", "hadoop.tmp.dir": "${env.POD}/tmp"}
        pairs = [("hdfs.siteOverrides", site), ("hdfs.coreOverrides", core)]
        named = [f"{path}.{_escaped(name)}={value}" for path, some in pairs for name, value in some.items()]
        return [part for each in named for part in ("--set-string", each)]

    def container(self, component: str) -> Manifest:
        """The container of a component, as the chart makes it."""
        kind = "DaemonSet" if component == "datanode" else "StatefulSet"
        spec = pod_of(find(self.manifests, kind, f"{RELEASE}-{component}"))["spec"]
        return dict(spec["containers"][0])

    def environment(self, component: str, node: str = "") -> dict[str, str]:
        """The variables of a component's container."""
        own = {each["name"]: each.get("value", "") for each in self.container(component)["env"]}
        pod = self.folder / (node or component)
        return own | {"POD": str(pod)} | (self._address(node) if node else {})

    def _address(self, node: str) -> dict[str, str]:
        return {"NODE_ADDRESS": node, "DATA_PORT": str(9866 - self.nodes.index(node) * 10)}

    def program(self, component: str, node: str = "") -> Program:
        """A process as the image's entry point starts it."""
        variables = self.environment(component, node)
        (self.folder / (node or component) / "tmp").mkdir(parents=True, exist_ok=True)
        path = f"{self.folder}/conf:{self.folder}/web:{hadoop_jars()}/*"
        command = ["java", *variables["HADOOP_OPTS"].split(), "-cp", path, PROGRAMS[component]]
        return Program(command, self.folder / f"{node or component}.log", variables)

    def is_ready(self, component: str, node: str = "") -> bool:
        """What the readiness probe of the chart says."""
        *shell, script = self.container(component)["readinessProbe"]["exec"]["command"]
        script = script.replace("127.0.0.1/9870", f"{self.namenode}/9870")
        env = os.environ | self.environment(component, node)
        return subprocess.run([*shell, script], env=env, capture_output=True, check=False).returncode == 0

    def prepare(self) -> str:
        """What the program of the Job `prepare` prints."""
        (job,) = (each for each in self.manifests if each["kind"] == "Job")
        variables = {each["name"]: each["value"] for each in pod_of(job)["spec"]["containers"][0]["env"]}
        script = CHART / "files/scripts/prepare_storage.py"
        env = os.environ | variables | {"NAMENODE": f"http://{self.namenode}:9870"}
        return subprocess.check_output([sys.executable, script], env=env, text=True, timeout=120)

    def ask(self, method: str, path: str, user: str = "fleet", **query: str) -> httpx.Response:
        """A call of WebHDFS, with the second step at a DataNode when there is one."""
        url = f"http://{self.namenode}:9870/webhdfs/v1{path}"
        content = CONTENT if query["op"] == "CREATE" else b""
        with httpx.Client(trust_env=False, timeout=30.0) as client:
            answer = client.request(method, url, params=query | {"user.name": user})
            if answer.status_code == 307:
                answer = client.request(method, answer.headers["location"], content=content)
        return answer

    def stop(self) -> None:
        """End every process."""
        for program in self.programs.values():
            program.kill()


def _escaped(name: str) -> str:
    return re.sub(r"\.", r"\.", name)


@dataclass(frozen=True)
class Status:
    owner: str
    mode: str


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    need("helm", "java", "bash", "setpriv")
    site = Site(tmp_path_factory.mktemp("site"))
    namenode = site.programs["namenode"]
    formatted = subprocess.run(
        [*namenode.command, "-format", "-nonInteractive"],
        env=os.environ | site.environment("namenode"),
        capture_output=True,
        check=False,
    )
    assert formatted.returncode == 0, formatted.stderr.decode()
    try:
        for program in site.programs.values():
            program.start()
        yield site
    finally:
        site.stop()


def status(site: Site, path: str) -> Status:
    found = site.ask("GET", path, user="hdfs", op="GETFILESTATUS").json()["FileStatus"]
    return Status(found["owner"], found["permission"])


def test_probes_say_ready_when_the_namenode_can_be_written_to(site: Site) -> None:
    site.programs["namenode"].wait_ready(lambda: site.is_ready("namenode"))
    for node in site.nodes:
        site.programs[node].wait_ready(partial(site.is_ready, "datanode", node))
    assert [site.ask("GET", "/", op=op).status_code for op in ("GETFILESTATUS", "LISTSTATUS")] == [200, 200]


def test_the_folder_of_the_fleets_belongs_to_their_user_who_is_not_the_superuser(site: Site) -> None:
    site.programs["namenode"].wait_ready(lambda: site.is_ready("namenode"))
    first, second = site.prepare(), site.prepare()
    assert "/fleet is there for fleet" in first
    assert "/fleet is there for fleet" in second
    assert (status(site, "/"), status(site, "/fleet")) == (Status("hdfs", "755"), Status("fleet", "750"))
    refused = {
        "a fleet's user gives nothing away": site.ask("PUT", "/fleet", op="SETOWNER", owner="mallory"),
        "and writes nowhere else": site.ask("PUT", "/elsewhere", op="MKDIRS"),
        "nobody else looks in": site.ask("GET", "/fleet", user="mallory", op="LISTSTATUS"),
    }
    assert {what: answer.status_code for what, answer in refused.items()} == dict.fromkeys(refused, 403)


def test_a_write_is_on_two_nodes_whose_addresses_clients_get(site: Site) -> None:
    site.prepare()
    for node in site.nodes:
        site.programs[node].wait_ready(partial(site.is_ready, "datanode", node))
    assert site.ask("PUT", "/fleet/kept", op="CREATE", overwrite="true").status_code == 201
    places = site.ask("GET", "/fleet/kept", op="GETFILEBLOCKLOCATIONS").json()["BlockLocations"]["BlockLocation"]
    assert [sorted(place["hosts"]) for place in places] == [site.nodes]
    assert site.ask("GET", "/fleet/kept", op="OPEN").content == CONTENT


def test_names_survive_the_loss_of_the_namenodes_disk_and_are_served_with_one_node_dark(site: Site) -> None:
    """The steps of docs/install.md, "Restore": copy the checkpoint to where the names were, and start."""
    folders = {name: site.folder / name / "metadata" for name in ("namenode", "checkpoint")}
    site.prepare()
    site.ask("PUT", "/fleet/precious", op="CREATE", overwrite="true")
    known = _last_change(site)
    wait_for("a checkpoint", lambda: _image_of(folders["checkpoint"] / "checkpoint/current") >= known)
    site.stop()
    shutil.rmtree(folders["namenode"])
    shutil.copytree(folders["checkpoint"] / "checkpoint/current", folders["namenode"] / "name/current")

    site.programs["namenode"].start()
    site.programs[site.nodes[0]].start()
    try:
        site.programs["namenode"].wait_ready(lambda: site.is_ready("namenode"))
        wait_for("the blocks", lambda: site.ask("GET", "/fleet/precious", op="OPEN").content == CONTENT)
        alone = site.ask("PUT", "/fleet/later", op="CREATE")
        assert (alone.status_code, "minReplication" in alone.text) == (403, True), alone.text
    finally:
        for program in site.programs.values():
            program.start()


def _last_change(site: Site) -> int:
    """Number of the last change of names that the NameNode has written."""
    with httpx.Client(trust_env=False) as client:
        answer = client.get(f"http://{site.namenode}:9870/jmx?qry=Hadoop:service=NameNode,name=NameNodeInfo")
    journal = json.loads(answer.json()["beans"][0]["JournalTransactionInfo"])
    return int(journal["LastAppliedOrWrittenTxId"])


def _image_of(folder: Path) -> int:
    """Number of the last change in the newest image of a folder that has its checksum; -1 without one."""
    return max((int(path.stem.partition("_")[2]) for path in folder.glob("fsimage_*.md5")), default=-1)
