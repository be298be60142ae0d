"""Run in the runtime image: flies one mission, and says whether the kernel had to be compiled for it."""

import sys

sys.path.insert(0, "/kernel")

from compile_kernel import fly_once
from kernel_settings import able

if not able():
    sys.exit("this processor cannot run it")
fly_once()

from fleet.simulator import kernel  # noqa: E402 - numba reads its settings at the import

programs = (kernel.fly.stats, kernel.rank.stats)  # type: ignore[attr-defined]  # of numba
compiled = sum(sum(program.cache_misses.values()) for program in programs)
found = sum(sum(program.cache_hits.values()) for program in programs)
print(f"compiled {compiled}, found {found}")  # noqa: T201 - the test reads it
