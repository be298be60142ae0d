"""The LAN of a bed: a bridge, one network namespace per machine, and a cable to this computer."""

from __future__ import annotations

import contextlib
from pathlib import Path

from tests.testbed.errors import CommandFailed
from tests.testbed.processes import run
from tests.testbed.site import BedSpec
from tests.testbed.waiting import wait_for

BRIDGE = "lan0"
CARD = "eth0"
POD_BRIDGE = "cni0"
NAMESPACES = Path("/run/netns")


class Lan:
    """The cables of a bed; cards are switched with their machines."""

    def __init__(self, spec: BedSpec) -> None:
        self._spec = spec
        self._site = spec.site

    def up(self) -> None:
        """Lay every cable; the cards have no addresses yet."""
        site = self._site
        run(["ip", "netns", "add", site.lan])
        _ip(site.lan, f"link add {BRIDGE} type bridge forward_delay 0", f"link set {BRIDGE} up")
        run(["ip", "link", "add", site.cable, "type", "veth", "peer", "name", "mgmt", "netns", site.lan])
        _ip(site.lan, f"link set mgmt master {BRIDGE} up")
        for index, machine in enumerate(self._spec.machines):
            inside = site.namespace(machine.name)
            run(["ip", "netns", "add", inside])
            peer = f"type veth peer name {machine.name} netns {site.lan}"
            _ip(inside, f"link add {CARD} address {site.mac(index)} {peer}", "link set lo up", f"link set {CARD} up")
            _ip(site.lan, f"link set {machine.name} master {BRIDGE} up")
        routes = [f"route add {site.pods_of(i)} via {site.address(i)}" for i in range(len(self._spec.machines))]
        routes.append(f"route add {site.services} via {site.hub}")
        _ip("", f"addr add {site.own_address}/24 dev {site.cable}", f"link set {site.cable} up", *routes)

    def card_on(self, index: int) -> None:
        """Give a machine its address and its routes."""
        site, machine = self._site, self._spec.machines[index]
        routes = [f"route replace default via {site.own_address}"]  # the API server wants one
        others = [i for i in range(len(self._spec.machines)) if i != index]
        routes += [f"route replace {site.pods_of(i)} via {site.address(i)}" for i in others]
        address = f"addr replace {site.address(index)}/24 dev {CARD}"
        _ip(site.namespace(machine.name), address, *routes)

    def card_off(self, index: int) -> None:
        """Take a machine's address away: one that is off answers no ARP."""
        inside = self._site.namespace(self._spec.machines[index].name)
        _ip(inside, f"addr flush dev {CARD}")
        with contextlib.suppress(CommandFailed):  # no pod had a network: there is no bridge of pods
            _ip(inside, f"link del {POD_BRIDGE}")

    def down(self) -> None:
        """Remove every cable that is there; what is not there is fine."""
        site = self._site
        for name in [site.namespace(machine.name) for machine in self._spec.machines] + [site.lan]:
            if (NAMESPACES / name).exists():
                run(["ip", "netns", "del", name])
        cable = Path("/sys/class/net") / site.cable
        with contextlib.suppress(CommandFailed):  # it went with the namespace of its other end, which takes a moment
            if cable.exists():
                run(["ip", "link", "del", site.cable])
        wait_for(f"the end of {site.cable}", lambda: not cable.exists(), timeout_s=10.0)


def _ip(namespace: str, *commands: str) -> None:
    """Run commands of ip in a network namespace; "" is this computer's own."""
    where = ["-n", namespace] if namespace else []
    run(["ip", *where, "-batch", "-"], stdin="\n".join(commands) + "\n")
