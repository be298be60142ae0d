"""The process that a bed lives in: parent of its machines, their network cards, and their power buttons.

`python -m tests.testbed.keeper FOLDER IMAGES PROGRAM...`; it inherits the lock of the site. It takes orders at a Unix
socket, one JSON object per connection: {"do": "power-on" | "power-off" | "status" | "down", "machine": NAME}.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from tests.testbed import kernel
from tests.testbed.image_store import ImageStore
from tests.testbed.machine import Machine, Parts
from tests.testbed.network import Lan
from tests.testbed.power import Card
from tests.testbed.provision import Provision
from tests.testbed.records import Record, clear_up, socket_path, write_record
from tests.testbed.site import BedSpec
from tests.testbed.volumes import Volumes

SPEC = TypeAdapter(BedSpec)
Answer = dict[str, Any]


class Keeper:
    """One bed: made, kept and removed."""

    def __init__(self, spec: BedSpec, folder: Path, parts: Parts) -> None:
        self._spec = spec
        self._folder = folder
        self._parts = parts
        self._selector = selectors.DefaultSelector()
        self._volumes: Volumes | None = None
        self._machines: dict[str, Machine] = {}
        self._watched: dict[str, Card | int] = {}  # what wakes a machine that is off, or tells that one has ended

    def make(self) -> None:
        """Make network and machines, and switch the machines on."""
        spec = self._spec
        write_record(spec.site, Record(str(self._folder), tuple(one.name for one in spec.machines), os.getpid()))
        kernel.enter(spec.site.prefix)
        Lan(spec).up()
        store = ImageStore(self._parts.images)
        for index, machine in enumerate(spec.machines):
            made = Machine(spec, index, self._folder / machine.name, self._parts)
            store.furnish(made.folder / "disk/lib/containerd")
            self._machines[machine.name] = made
        provision = Provision(spec, self._folder)
        provision.set_up(list(self._machines.values()))
        for name in self._machines:
            self._power_on(name)
        self._volumes = Volumes(provision.api, self._folder)
        self._volumes.start()

    def keep(self) -> None:
        """Take orders and wake machines until the order `down`, SIGTERM or SIGINT comes."""
        path = socket_path(self._spec.site)
        path.unlink(missing_ok=True)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
            server.bind(str(path))
            server.listen()
            self._selector.register(server, selectors.EVENT_READ, lambda: self._serve(server))
            while True:
                for key, _ in self._selector.select():
                    key.data()

    def remove(self) -> None:
        """Switch everything off, and remove every trace."""
        if self._volumes is not None:
            self._volumes.stop()
        for machine in self._machines.values():
            machine.power_off()
        clear_up(self._spec.site)

    def _serve(self, server: socket.socket) -> None:
        connection, _ = server.accept()
        with connection, connection.makefile("rw") as stream:
            order = json.loads(stream.readline())
            stream.write(json.dumps(self._obey(order["do"], order.get("machine", ""))) + "\n")
            stream.flush()
            if order["do"] == "down":
                raise SystemExit(0)

    def _obey(self, order: str, name: str) -> Answer:
        acts: dict[str, Callable[[], None]] = {
            "power-on": lambda: self._power_on(name),
            "power-off": lambda: self._power_off(name),
            "status": lambda: None,
            "down": self.remove,
        }
        try:
            acts[order]()
        except Exception as error:  # noqa: BLE001 - the one who gave the order is told
            return {"error": f"{type(error).__name__}: {error}"}
        return {"machines": {one: machine.on for one, machine in self._machines.items()}}

    def _power_on(self, name: str) -> None:
        if self._machines[name].on:
            return
        self._unwatch(name)
        pid = self._machines[name].power_on()
        ended = os.pidfd_open(pid)
        self._watch(name, ended, lambda: self._power_off(name))  # it switched itself off

    def _power_off(self, name: str) -> None:
        index = self._spec.index(name)
        self._unwatch(name)
        self._machines[name].power_off()
        card = Card(self._spec.site.namespace(name), self._spec.site.mac(index))
        self._watch(name, card, lambda: self._hear(name, card))

    def _hear(self, name: str, card: Card) -> None:
        if card.woken():
            time.sleep(self._spec.timing.boot_delay_s)
            self._power_on(name)

    def _watch(self, name: str, source: Card | int, act: Callable[[], None]) -> None:
        self._watched[name] = source
        self._selector.register(source, selectors.EVENT_READ, act)

    def _unwatch(self, name: str) -> None:
        source = self._watched.pop(name, None)
        if source is None:
            return
        self._selector.unregister(source)
        if isinstance(source, Card):
            source.close()
        else:
            os.close(source)


def main(folder: Path, images: Path, *programs: Path) -> None:
    """Make the bed that is described in the folder, and keep it until told otherwise."""
    spec = SPEC.validate_json((folder / "spec.json").read_bytes())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    clear_up(spec.site)
    keeper = Keeper(spec, folder, Parts(programs, images))
    with ImageStore(images).held():
        try:
            keeper.make()
            keeper.keep()
        finally:
            keeper.remove()


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:]))
