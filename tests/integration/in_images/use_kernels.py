"""Run in the runtime image: uses every kernel, and says whether a program had to be compiled for it."""

import sys

sys.path.insert(0, "/kernel")

from compile_kernel import use_once
from kernel_settings import able

if not able():
    sys.exit("this processor cannot run them")
use_once()

from fleet.functions import kriging_kernel  # noqa: E402 - numba reads its settings at the import
from fleet.planning import kernel as planning  # noqa: E402 - same
from fleet.planning import outlook_kernel as outlook  # noqa: E402 - same
from fleet.simulator import kernel as simulator  # noqa: E402 - same

known = [vars(module).items() for module in (simulator, kriging_kernel, planning, outlook)]
programs = {id(each): each for names in known for name, each in names if hasattr(each, "stats") and name[0] != "_"}
used = [each for each in programs.values() if each.stats.cache_misses or each.stats.cache_hits]
compiled = sum(sum(each.stats.cache_misses.values()) for each in used)
print(f"compiled {compiled}, found {len(used)} programs")  # noqa: T201 - the test reads it
