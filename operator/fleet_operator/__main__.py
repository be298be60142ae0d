"""`python -m fleet_operator`: the operator as a process.

Exit code 0 after SIGTERM or SIGINT, 2 for a wrong configuration, 75 when it is to be started again.
"""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from fleet.errors import ExitCode, FleetError
from fleet.storage.open import open_storage
from fleet_operator import config as configuration
from fleet_operator import handlers
from fleet_operator.cluster.connection import Connection, connect
from fleet_operator.cluster.credentials import Credentials
from fleet_operator.config import Config
from fleet_operator.reconcile.fence import fenced
from fleet_operator.reconcile.means import Means
from fleet_operator.reconcile.reconciler import FleetReconciler
from fleet_operator.resources.refs import ObjectRef
from fleet_operator.service.logs import start_log
from fleet_operator.service.metrics import API_CALLS, Metrics
from fleet_operator.service.service import Reconciler, Service

log = logging.getLogger("fleet_operator")

# Lists of thousands of objects are made and dropped all the time. With Python's own thresholds the collector looks
# through all that is remembered again and again: it was two thirds of the time of a start with 23,000 Jobs.
GC_THRESHOLDS = (50_000, 50, 100)
_SPARE_THREADS = 4


async def operate(config: Config, credentials: Credentials, build: Callable[[Connection], Reconciler]) -> ExitCode:
    """Run the operator until it is told to stop, or has to.

    Args:
        build: Makes the reconciler for a connection that is open.
    """
    numbers, stop = Metrics(), asyncio.Event()
    loop = asyncio.get_running_loop()
    # A thread for each worker: storages that do not answer hold threads, and nobody else is to wait for these.
    loop.set_default_executor(ThreadPoolExecutor(config.workers + _SPARE_THREADS))
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    connection = connect(
        credentials,
        ObjectRef(config.namespace, config.lease),
        config.watch_namespaces,
        lambda verb, status: numbers.count(API_CALLS, verb=verb, code=str(status)),
    )
    async with connection.transport:
        kopf = handlers.KopfWatches(credentials, connection.watches, config.watch_namespaces)
        service = Service(connection, build(connection), config, numbers)
        return await service.run(stop, [kopf.run()])


def run(build: Callable[[Config, Connection], Reconciler]) -> int:
    """Configure from the environment, and operate; the exit code."""
    try:
        config = configuration.from_environment(os.environ)
        credentials = Credentials(os.environ)
    except FleetError as error:
        sys.stderr.write(f"fleet-operator: {error}\n")
        return int(ExitCode.USAGE)
    start_log(config.log_format, config.log_level)
    handlers.quiet()
    gc.set_threshold(*GC_THRESHOLDS)
    # Not asyncio.run: it would wait for threads in which a storage call hangs.
    loop = asyncio.new_event_loop()
    try:
        return int(loop.run_until_complete(operate(config, credentials, lambda connection: build(config, connection))))
    except Exception:
        log.exception("the operator ends, and has to be started again")
        return int(ExitCode.TRANSIENT)


def fleet_reconciler(config: Config, connection: Connection) -> Reconciler:
    """What the operator does for fleets; neither cluster nor storage is changed without the lease."""

    def left_s() -> float:
        return connection.transport.left_s()  # which is another one as soon as there is a lease

    opened = fenced(partial(open_storage, limits=config.limits), left_s)
    means = Means(
        connection.cluster,
        config.settings,
        config.library,
        frozenset(config.watch_namespaces),
        opened=opened,
        installation=lambda: connection.leases.uid,  # known as soon as the lease is held
    )
    return FleetReconciler(means)


if __name__ == "__main__":
    code = run(fleet_reconciler)
    logging.shutdown()
    os._exit(code)  # and neither does the interpreter's own end wait for such threads
