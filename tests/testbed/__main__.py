"""The test bed as commands: `python -m tests.testbed up`, then kubectl; `down` removes every trace."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.testbed import packages
from tests.testbed.bed import PROGRAMS, Bed, start_bed
from tests.testbed.binaries import EVERYTHING, HADOOP, build, tool
from tests.testbed.errors import BedError
from tests.testbed.keeper import SPEC
from tests.testbed.progress import say
from tests.testbed.recipes import RECIPES
from tests.testbed.records import MARK, SiteLock, clear_up, read_record
from tests.testbed.requirements import check_machines, required, switched_off
from tests.testbed.site import CLUSTER, BedSpec, Site, machines


def main(arguments: list[str]) -> int:
    """Run one command; the exit code."""
    options = parser().parse_args(arguments)
    act: Callable[[argparse.Namespace], None] = options.act
    try:
        act(options)
    except BedError as error:
        say(f"error: {error}")
        return 1
    except KeyboardInterrupt:
        say("interrupted; `python -m tests.testbed down` removes what is left")
        return 130
    return 0


def up(options: argparse.Namespace) -> None:
    """Start the cluster, or say where it is when it runs."""
    running = _running(options.site)
    if running is None:
        packages.ensure(packages.MACHINES)
        check_machines()
        for name in (*PROGRAMS, "kubectl"):
            tool(name)
        images = _images() if options.images else []
        start = time.monotonic()
        running = start_bed(
            options.folder or _folder(options.site), [options.site], images, BedSpec(machines=machines(options.edges))
        )
        try:
            running.wait_ready()
        except BaseException:  # an interrupt as well: half a cluster is of no use
            running.down()
            raise
        say(f"{len(running.machines)} machines are Ready after {time.monotonic() - start:.1f} s")
    elif options.images:
        for image in _images():
            say(f"loading {image.name} into every machine")
            running.load_image(image)
    say("\n" + running.kubectl("get", "nodes", "-o", "wide").rstrip())
    sys.stdout.write(f"export KUBECONFIG={running.kubeconfig}\n")


def down(options: argparse.Namespace) -> None:
    """Switch everything off, and remove the cluster's folder."""
    record = read_record(options.site)
    if record is None:
        say("no cluster is there")
        return
    running = _running(options.site)
    if running is not None:
        running.down()
    with SiteLock(options.site) as lock:
        if not lock.try_take():
            raise BedError("the cluster is just being started or removed by another command")
        clear_up(options.site)
    folder = Path(record.folder)
    if (folder / MARK).exists():
        shutil.rmtree(folder)
    say("the cluster is gone")


def status(options: argparse.Namespace) -> None:
    """Say which machines are on, and which are Ready."""
    running = _running(options.site)
    if running is None:
        say("no cluster runs; start one: python -m tests.testbed up")
        return
    ready, on = running.readiness(), running.order("status")["machines"]
    for machine in running.machines:
        power = "on" if on[machine.name] else "off"
        word = "Ready" if ready.get(machine.name) else "not Ready"
        sys.stdout.write(f"{machine.name:8} {machine.address:12} {machine.mac}  {power:4} {word}\n")
    sys.stdout.write(f"export KUBECONFIG={running.kubeconfig}\n")


def power_off(options: argparse.Namespace) -> None:
    """Cut the power of a machine."""
    needed(options.site).machine(options.machine).power_off()


def power_on(options: argparse.Namespace) -> None:
    """Press the power button of a machine that is off."""
    needed(options.site).machine(options.machine).power_on()


def make(options: argparse.Namespace) -> None:
    """Build what the test bed is made of."""
    if options.if_possible and switched_off():
        say("FLEET_TESTBED=off: nothing is built, and the tests of real clusters, HDFS and images are skipped")
        return
    try:
        _make(options)
    except BedError as error:
        if not options.if_possible or required():
            raise
        say(f"SOME TESTS WILL BE SKIPPED, as this cannot be made here: {error}")


def _make(options: argparse.Namespace) -> None:
    if os.geteuid() == 0:
        packages.ensure(packages.MACHINES)
    names = options.names or EVERYTHING
    unknown = set(names) - {*RECIPES, HADOOP, "images"}
    if unknown:
        raise BedError(f"unknown: {', '.join(unknown)}; there are {', '.join([*RECIPES, HADOOP, 'images'])}")
    build([name for name in names if name != "images"])
    if "images" in names:
        _images()


def _images() -> list[Path]:
    from tests.testbed.images import PODS, ensure_images  # noqa: PLC0415 - a cluster without them needs no image builder

    return list(ensure_images(*PODS).values())


def _running(site: Site) -> Bed | None:
    """The cluster that runs."""
    record = read_record(site)
    with SiteLock(site) as lock:
        if record is None or lock.try_take():  # nobody holds the lock: it is dead
            return None
    folder = Path(record.folder)
    return Bed(SPEC.validate_json((folder / "spec.json").read_bytes()), folder)


def needed(site: Site = CLUSTER) -> Bed:
    """The cluster that runs. Raises BedError when none does."""
    running = _running(site)
    if running is None:
        raise BedError("no cluster runs; start one: python -m tests.testbed up")
    return running


def _folder(site: Site) -> Path:
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state"
    return Path(state) / "fleet-computer" / ("cluster" if site == CLUSTER else f"cluster-{site.prefix}")


def _site(text: str) -> Site:
    prefix, _, number = text.partition(":")
    if not (prefix.isalnum() and len(prefix) <= 8 and number.isdecimal() and 1 <= int(number) <= 250):
        raise argparse.ArgumentTypeError("say it as fc:77, with at most 8 letters and a number up to 250")
    return Site(prefix, int(number))


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    arguments = argparse.ArgumentParser(prog="python -m tests.testbed", description=__doc__)
    where = "names and addresses, to have several: fc:77 has names fc-..., and 10.77 to 10.79 (the default)"
    arguments.add_argument("--site", type=_site, default=CLUSTER, help=where)
    commands = arguments.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, act: Callable[[argparse.Namespace], None]) -> argparse.ArgumentParser:
        one = commands.add_parser(name, help=act.__doc__, description=act.__doc__)
        one.set_defaults(act=act)
        return one

    start = command("up", up)
    start.add_argument("--folder", type=Path, help="for keys, logs and disks (~/.local/state/fleet-computer/cluster)")
    start.add_argument("--edges", type=int, default=3, help="edge machines beside the hub (%(default)s)")
    start.add_argument("--images", action="store_true", help="with the images of the Fleet Computer, built if needed")
    command("down", down)
    command("status", status)
    names = ", ".join([*RECIPES, HADOOP, "images"])
    building = command("build", make)
    building.add_argument("names", nargs="*", metavar="NAME", help=f"{names}; all but kwok and images")
    building.add_argument("--if-possible", action="store_true", help="what cannot be made here is said, and no failure")
    for name, act in {"power-off": power_off, "power-on": power_on}.items():
        command(name, act).add_argument("machine", help="hub, edge1, edge2, ...")
    return arguments


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
