"""Hadoop's configuration folder for the test bed: what a small site needs, with the short waits of a test."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import escape

Site = Mapping[str, str | int]
REPLICATION = 2
BLOCK_BYTES = 1 << 20

# "Acknowledged" means two live replicas: a pipeline that loses a DataNode takes another, and a block with one replica
# is not closed. DataNodes are the clients of HDFS when a program speaks WebHDFS, so they read these settings too.
DURABLE: Site = {
    "dfs.replication": REPLICATION,
    "dfs.namenode.replication.min": REPLICATION,
    # Else a NameNode that starts while a machine is dark stays in safe mode.
    "dfs.namenode.safemode.replication.min": 1,
    "dfs.client.block.write.replace-datanode-on-failure.enable": "true",
    "dfs.client.block.write.replace-datanode-on-failure.policy": "ALWAYS",
    "dfs.client.block.write.replace-datanode-on-failure.best-effort": "true",
    # Closing a file asks until the second replica is reported, at first after 400 ms: then each append takes as long.
    "dfs.client.block.write.locateFollowingBlock.initial.delay.ms": 1,
    "dfs.client.block.write.locateFollowingBlock.retries": 13,
}

# A DataNode that is gone is noticed after 2 x recheck + 10 x heartbeat (16 s), and avoided after the stale interval.
IMPATIENT: Site = {
    "dfs.heartbeat.interval": 1,
    "dfs.namenode.heartbeat.recheck-interval": 3000,
    "dfs.namenode.stale.datanode.interval": 5000,
    "dfs.namenode.avoid.read.stale.datanode": "true",
    "dfs.namenode.avoid.write.stale.datanode": "true",
    "dfs.namenode.write.stale.datanode.ratio": "1.0",
    "dfs.namenode.redundancy.interval.seconds": "1s",
    "dfs.namenode.reconstruction.pending.timeout-sec": 10,
    "dfs.namenode.decommission.interval": "1s",
    "dfs.namenode.replication.work.multiplier.per.iteration": 20,
    "dfs.namenode.replication.max-streams": 20,
    "dfs.namenode.replication.max-streams-hard-limit": 40,
    # By itself it follows replication.min, and a NameNode that starts while a DataNode is away would stay in safe mode.
    "dfs.namenode.safemode.replication.min": 1,
    "dfs.namenode.safemode.extension": 0,
    "dfs.client.socket-timeout": 5000,
    "ipc.client.connect.max.retries": 2,
}

SMALL: Site = {
    "dfs.blocksize": BLOCK_BYTES,
    # With three DataNodes, one that does a little more than the others is "too busy" for a second copy.
    "dfs.namenode.redundancy.considerLoad": "false",
    "dfs.namenode.handler.count": 8,
    "dfs.datanode.handler.count": 4,
    "dfs.datanode.du.reserved": 0,
    "dfs.namenode.datanode.registration.ip-hostname-check": "false",
    "dfs.permissions.enabled": "true",
}

FLEET_ACTS_FOR_OTHERS: Site = {"hadoop.proxyuser.fleet.hosts": "*", "hadoop.proxyuser.fleet.groups": "*"}

_LOG = """log4j.rootLogger=INFO,console
log4j.appender.console=org.apache.log4j.ConsoleAppender
log4j.appender.console.layout=org.apache.log4j.PatternLayout
log4j.appender.console.layout.ConversionPattern=%d{ISO8601} %p %c{1}: %m%n
"""
_WEB = '<web-app xmlns="http://java.sun.com/xml/ns/javaee" version="2.5"></web-app>\n'


def write_configuration(folder: Path, name_node: str, site: Site) -> Path:
    """Write a configuration folder, which stands first on the class path.

    Args:
        name_node: `host:port` of the NameNode's RPC.
        site: Settings beside `DURABLE`, `IMPATIENT` and `SMALL`, or instead of theirs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "core-site.xml").write_text(_xml({"fs.defaultFS": f"hdfs://{name_node}", **FLEET_ACTS_FOR_OTHERS}))
    (folder / "hdfs-site.xml").write_text(_xml({**DURABLE, **IMPATIENT, **SMALL, **site}))
    (folder / "log4j.properties").write_text(_LOG)
    for server in ("hdfs", "datanode"):  # the jars from Maven have no web pages; the servers look for the folders
        web = folder / "webapps" / server / "WEB-INF"
        web.mkdir(parents=True, exist_ok=True)
        (web / "web.xml").write_text(_WEB)
    return folder


def _xml(settings: Site) -> str:
    rows = "".join(
        f"<property><name>{name}</name><value>{escape(str(value))}</value></property>\n"
        for name, value in settings.items()
    )
    return f"<configuration>\n{rows}</configuration>\n"
