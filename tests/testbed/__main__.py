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
from tests.testbed.requirements import check_machines
from tests.testbed.site import CLUSTER, BedSpec, machines


def main(arguments: list[str]) -> int:
    """Run one command; the exit code."""
    options = _parser().parse_args(arguments)
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
    running = _running()
    if running is None:
        check_machines()
        for name in (*PROGRAMS, "kubectl"):
            tool(name)
        images = _images() if options.images else []
        start = time.monotonic()
        running = start_bed(options.folder, [CLUSTER], images, BedSpec(machines=machines(options.edges)))
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


def down(_: argparse.Namespace) -> None:
    """Switch everything off, and remove the cluster's folder."""
    record = read_record(CLUSTER)
    if record is None:
        say("no cluster is there")
        return
    running = _running()
    if running is not None:
        running.down()
    with SiteLock(CLUSTER) as lock:
        if not lock.try_take():
            raise BedError("the cluster is just being started or removed by another command")
        clear_up(CLUSTER)
    folder = Path(record.folder)
    if (folder / MARK).exists():
        shutil.rmtree(folder)
    say("the cluster is gone")


def status(_: argparse.Namespace) -> None:
    """Say which machines are on, and which are Ready."""
    running = _running()
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
    _needed().machine(options.machine).power_off()


def power_on(options: argparse.Namespace) -> None:
    """Press the power button of a machine that is off."""
    _needed().machine(options.machine).power_on()


def make(options: argparse.Namespace) -> None:
    """Build what the test bed is made of."""
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
    from tests.testbed.images import ensure_images  # noqa: PLC0415 - a cluster without them needs no image builder

    return list(ensure_images().values())


def _running() -> Bed | None:
    """The cluster that runs."""
    record = read_record(CLUSTER)
    with SiteLock(CLUSTER) as lock:
        if record is None or lock.try_take():  # nobody holds the lock: it is dead
            return None
    folder = Path(record.folder)
    return Bed(SPEC.validate_json((folder / "spec.json").read_bytes()), folder)


def _needed() -> Bed:
    running = _running()
    if running is None:
        raise BedError("no cluster runs; start one: python -m tests.testbed up")
    return running


def _default_folder() -> Path:
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state"
    return Path(state) / "fleet-computer" / "cluster"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.testbed", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, act: Callable[[argparse.Namespace], None]) -> argparse.ArgumentParser:
        one = commands.add_parser(name, help=act.__doc__, description=act.__doc__)
        one.set_defaults(act=act)
        return one

    start = command("up", up)
    start.add_argument("--folder", type=Path, default=_default_folder(), help="keys, logs and disks (%(default)s)")
    start.add_argument("--edges", type=int, default=3, help="edge machines beside the hub (%(default)s)")
    start.add_argument("--images", action="store_true", help="with the images of the Fleet Computer, built if needed")
    command("down", down)
    command("status", status)
    names = ", ".join([*RECIPES, HADOOP, "images"])
    command("build", make).add_argument("names", nargs="*", metavar="NAME", help=f"{names}; all but kwok and images")
    for name, act in {"power-off": power_off, "power-on": power_on}.items():
        command(name, act).add_argument("machine", help="hub, edge1, edge2, ...")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
