"""How long a storage takes: `python -m tests.contract.storage_timing [URI]`.

Without an address it starts an HDFS of its own with three DataNodes.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from fleet.storage.open import open_storage
from fleet.storage.port import Storage
from tests.testbed.hdfs import hdfs_cluster

ROUNDS = 200
LINE = b"\n" + b"x" * 500 + b"\n"  # as long as a record of the example


def timed(name: str, act: Callable[[int], object], rounds: int = ROUNDS) -> None:
    times = []
    for number in range(rounds):
        begin = time.perf_counter()
        act(number)
        times.append(1000 * (time.perf_counter() - begin))
    median, high = statistics.median(times), sorted(times)[int(0.9 * len(times))]
    sys.stdout.write(f"{name:32} {median:8.1f} ms median {high:8.1f} ms nine of ten\n")


def measure(storage: Storage) -> None:
    """Time each operation in a folder of its own, which is removed."""
    storage.append("timing/log", LINE)
    timed("append a line", lambda _: storage.append("timing/log", LINE))
    timed("write 500 bytes", lambda number: storage.write(f"timing/{number % 7}/small", LINE))
    timed("write 1 MB", lambda _: storage.write("timing/large", bytes(10**6)), ROUNDS // 10)
    timed("read 500 bytes", lambda number: storage.read(f"timing/{number % 7}/small"))
    timed("read 1 MB", lambda _: storage.read("timing/large"), ROUNDS // 10)
    timed("exists", lambda _: storage.exists("timing/large"))
    for number in range(500):
        storage.write(f"timing/many/{number % 50}/{number}", b"1")
    timed("list 500 objects in 50 folders", lambda _: storage.list("timing/many"), ROUNDS // 20)
    storage.delete("timing")


def main() -> None:
    if len(sys.argv) > 1:
        measure(open_storage(sys.argv[1]))
        return
    with tempfile.TemporaryDirectory() as folder, hdfs_cluster(Path(folder)) as cluster:
        storage = open_storage(cluster.uri)
        for name in ("before Java's compiler has seen it all", "afterwards"):
            sys.stdout.write(f"{name}\n")
            measure(storage)


if __name__ == "__main__":
    main()
