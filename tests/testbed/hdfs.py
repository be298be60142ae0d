"""A real HDFS on the loopback address: a NameNode and DataNodes as plain processes, on free ports."""

from __future__ import annotations

import getpass
import json
import shutil
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.testbed.binaries import hadoop_jars
from tests.testbed.errors import Missing
from tests.testbed.hadoop_conf import write_configuration
from tests.testbed.ports import Ports
from tests.testbed.processes import Program, run

HOST = "127.0.0.1"
USER = "fleet"
# Small and quick to start; containers' limits are of no interest, and Java 17 fails to read those of a machine.
JAVA_FLAGS = (
    "-XX:-UseContainerSupport", "-Xmx192m", "-Xss512k", "-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1",
    "-Djava.net.preferIPv4Stack=true",
)  # fmt: skip
_PROGRAM = "org.apache.hadoop.hdfs.server"


class HdfsCluster:
    """A NameNode and DataNodes, each with an address of its own (127.0.0.11 and on); storage of the user `fleet`."""

    def __init__(self, folder: Path, datanodes: int) -> None:
        self.folder = folder
        self._ports = Ports()
        self._rpc, self._http = self._ports.take(), self._ports.take()
        self.address = f"{HOST}:{self._http}"
        self.uri = f"webhdfs://{USER}@{self.address}/fleet"
        self._jars = hadoop_jars()
        self._configuration = write_configuration(
            folder / "conf",
            f"{HOST}:{self._rpc}",
            {
                "dfs.namenode.rpc-address": f"{HOST}:{self._rpc}",
                "dfs.namenode.http-address": self.address,
                "dfs.namenode.name.dir": (folder / "name").as_uri(),
                # All DataNodes speak to the NameNode from 127.0.0.1; it is their names that tell them apart.
                "dfs.client.use.datanode.hostname": "true",
                "dfs.datanode.use.datanode.hostname": "true",
            },
        )
        self.namenode = self._program("namenode", "namenode.NameNode")
        self.hosts = tuple(f"127.0.0.{11 + index}" for index in range(datanodes))
        self.datanodes = tuple(self._datanode(host) for host in self.hosts)

    def start(self) -> None:
        """Format, start everything, and wait until files can be written.

        Raises:
            NotReady: a program ended, or was not ready in time.
        """
        if not (self.folder / "name/current").exists():
            run([*self._java("namenode.NameNode"), "-format", "-nonInteractive"])
        for program in (self.namenode, *self.datanodes):
            program.start()
        self.namenode.wait_ready(lambda: self._is_up(len(self.datanodes)))
        self.make_folder("/fleet", USER)

    def stop(self) -> None:
        """End everything; data and logs stay in the folder."""
        for program in (*self.datanodes, self.namenode):
            program.kill()
        self._ports.close()

    def stop_datanode(self, index: int, *, kill: bool = True) -> None:
        """End a DataNode at once, as a power cut would, or with SIGTERM."""
        if kill:
            self.datanodes[index].kill()
        else:
            self.datanodes[index].stop(timeout_s=20.0)

    def freeze_datanode(self, index: int) -> None:
        """Make a DataNode a hung one: it neither answers nor closes its connections."""
        self.datanodes[index].signal(signal.SIGSTOP)

    def thaw_datanode(self, index: int) -> None:
        """Let a frozen DataNode go on."""
        self.datanodes[index].signal(signal.SIGCONT)

    def answers(self, index: int) -> bool:
        """Whether a DataNode answers over HTTP."""
        host = self.hosts[index]
        address = next(node["infoAddr"] for name, node in self.live_datanodes().items() if host in name)
        try:
            httpx.get(f"http://{host}:{address.rpartition(':')[2]}/", trust_env=False, timeout=2)
        except httpx.HTTPError:
            return False
        return True

    def start_datanode(self, index: int) -> None:
        """Start a DataNode, and wait until the NameNode uses it."""
        self.datanodes[index].start()
        host = self.hosts[index]
        self.datanodes[index].wait_ready(lambda: any(host in name for name in self._fresh()))

    def start_all(self) -> None:
        """Start what does not run, and wait until all is well."""
        self.namenode.start()
        for program in self.datanodes:
            program.start()
        self.namenode.wait_ready(lambda: self._is_up(len(self.datanodes)))

    def stop_namenode(self, *, kill: bool = True) -> None:
        """End the NameNode at once, or with SIGTERM."""
        if kill:
            self.namenode.kill()
        else:
            self.namenode.stop(timeout_s=20.0)

    def start_namenode(self, *, wait: bool = True) -> None:
        """Start the NameNode, and wait until it has left safe mode."""
        self.namenode.start()
        if wait:
            alive = sum(program.running for program in self.datanodes)
            self.namenode.wait_ready(lambda: self._is_up(alive))

    def restart_namenode(self) -> None:
        """Kill the NameNode and start it again."""
        self.stop_namenode()
        self.start_namenode()

    def make_folder(self, path: str, owner: str, mode: str = "755") -> None:
        """Make a folder that belongs to a user."""
        self._ask("PUT", path, op="MKDIRS", permission=mode)
        self._ask("PUT", path, op="SETOWNER", owner=owner, group=owner)
        self._ask("PUT", path, op="SETPERMISSION", permission=mode)

    def set_owner(self, path: str, owner: str) -> None:
        """Give a folder to another user."""
        self._ask("PUT", path, op="SETOWNER", owner=owner)

    def set_modified(self, path: str, at_s: float) -> None:
        """Let a file look as if it was last written at a time."""
        self._ask("PUT", path, op="SETTIMES", modificationtime=int(at_s * 1000))

    def set_space_quota(self, path: str, bytes_: int) -> None:
        """Let the copies of what is under a folder take this many bytes and no more; -1 for no limit."""
        self._ask("PUT", path, op="SETQUOTA", namespacequota=2**63 - 1, storagespacequota=bytes_)

    def delete(self, path: str) -> None:
        """Remove a folder and all that is in it."""
        self._ask("DELETE", path, op="DELETE", recursive="true")

    def fsck(self, path: str) -> str:
        """What `hdfs fsck -files -blocks -locations -openforwrite` says about a path."""
        asked = dict.fromkeys(("files", "blocks", "locations", "replicadetails", "openforwrite"), "1")
        asked |= {"path": path, "ugi": getpass.getuser()}
        reply = httpx.get(f"http://{self.address}/fsck", params=asked, trust_env=False, timeout=30)
        return reply.raise_for_status().text

    def live_datanodes(self) -> dict[str, Any]:
        """DataNodes that the NameNode takes for alive, and what it knows of each."""
        return dict(json.loads(self._bean("NameNodeInfo")["LiveNodes"]))

    def _is_up(self, datanodes: int) -> bool:
        try:
            return not self._bean("NameNodeInfo")["Safemode"] and len(self._fresh()) >= datanodes
        except (httpx.HTTPError, KeyError, IndexError):
            return False

    def _fresh(self) -> list[str]:
        try:
            return [name for name, node in self.live_datanodes().items() if node["lastContact"] <= 1]
        except (httpx.HTTPError, KeyError, IndexError):
            return []

    def _bean(self, name: str) -> dict[str, Any]:
        query = {"qry": f"Hadoop:service=NameNode,name={name}"}
        reply = httpx.get(f"http://{self.address}/jmx", params=query, trust_env=False, timeout=10)
        return dict(reply.raise_for_status().json()["beans"][0])

    def _ask(self, method: str, path: str, **query: str | int) -> None:
        """A call of WebHDFS as HDFS' superuser: the user who started the NameNode."""
        url = f"http://{self.address}/webhdfs/v1{path}"
        reply = httpx.request(method, url, params=query | {"user.name": getpass.getuser()}, trust_env=False, timeout=30)
        if reply.is_error:
            raise RuntimeError(f"{query} of {path}: {reply.text}")

    def _datanode(self, host: str) -> Program:
        ports = {name: self._ports.take() for name in ("dfs.datanode.address", "dfs.datanode.http.address")}
        ports["dfs.datanode.ipc.address"] = self._ports.take()
        data = self.folder / f"data-{host}"
        settings = [f"-D{name}={host}:{port}" for name, port in ports.items()]
        settings += [f"-Ddfs.datanode.data.dir={data.as_uri()}", f"-Ddfs.datanode.hostname={host}"]
        return self._program(f"datanode-{host}", "datanode.DataNode", *settings)

    def _program(self, name: str, java_class: str, *settings: str) -> Program:
        return Program([*self._java(java_class), *settings], self.folder / f"{name}.log")

    def _java(self, java_class: str) -> Sequence[str]:
        return ["java", *JAVA_FLAGS, "-cp", f"{self._configuration}:{self._jars}/*", f"{_PROGRAM}.{java_class}"]


@contextmanager
def hdfs_cluster(folder: Path, datanodes: int = 3) -> Iterator[HdfsCluster]:
    """A running HDFS with its data in a folder; it ends with the block.

    Raises:
        Missing: Java or Hadoop's jars are not on this computer.
        NotReady: a program ended, or was not ready in time.
    """
    if shutil.which("java") is None:
        raise Missing("java is not on the PATH: install a Java 17 runtime (Debian: openjdk-17-jre-headless)")
    folder.mkdir(parents=True, exist_ok=True)
    cluster = HdfsCluster(folder, datanodes)
    try:
        cluster.start()
        yield cluster
    finally:
        cluster.stop()
