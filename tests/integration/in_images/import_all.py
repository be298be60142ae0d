"""Run in an image: imports what its programs import, also what they import late."""

import importlib
import pkgutil
import sys

ELSEWHERE = {
    # The report and the commands of people, and models that need an image of one's own.
    "runtime": ("fleet.report", "fleet.cli.reporting", "fleet.learning.deep", "fleet.simulator.parallel_env"),
    # What needs numba, which has no place there: maps are made by numpy.
    "function": ("fleet.functions.compiled_kriging", "fleet.functions.kriging_kernel", "fleet.functions.belief"),
    # The run on one machine, and the commands of people.
    "operator": ("fleet_operator.local", "fleet_operator.flow.commands"),
}
PACKAGES = {
    "runtime": ("fleet",),
    "function": ("fleet.functions", "fleet.cli.serving"),
    "operator": ("fleet_operator",),
}
ALSO = {"runtime": (), "function": (), "operator": ("fleet.storage.hdfs", "fleet.contexts.load")}


def modules(image: str) -> list[str]:
    """Names of an image's modules that must be importable."""
    found = list(ALSO[image])
    for name in PACKAGES[image]:
        package = importlib.import_module(name)
        found.append(name)
        below = pkgutil.walk_packages(getattr(package, "__path__", []), f"{name}.")
        found += [module.name for module in below]
    return [name for name in found if not name.startswith(ELSEWHERE[image]) and not name.endswith("__main__")]


if __name__ == "__main__":
    for module_name in modules(sys.argv[1]):
        importlib.import_module(module_name)
