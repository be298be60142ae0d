"""In the runtime image, lets roles use the kernels as they were compiled with the image.

numba needs seconds and 70 MB for each, in every pod that flies, trains or aggregates. Its cache is good for one kind of
processor: this one is for x86-64-v2, which costs the kernels next to nothing: they work on bits, or on one number at a
time. A processor that lacks something of that has them compiled at the first use, as does any other architecture.

Source: x86-64 psABI, "Micro-Architecture Levels"; numba reference, NUMBA_CPU_NAME, NUMBA_CACHE_LOCATOR_CLASSES.
"""

import os
import sys

FOLDER = "/opt/fleet/kernel"
PROCESSOR = "x86-64-v2"
NEEDED = {"cx16", "lahf_lm", "pni", "popcnt", "sse4_1", "sse4_2", "ssse3"}
"""What Linux calls the parts of that level."""

SETTINGS = {"NUMBA_CPU_NAME": PROCESSOR, "NUMBA_CPU_FEATURES": ""}
LOCATORS = "prebuilt_kernel.Locator,UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator"


def able() -> bool:
    """Whether this processor has all of the level."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as lines:  # noqa: PTH123 - pathlib is 10 ms
            flags = next((line for line in lines if line.startswith("flags")), "")
    except OSError:
        return False
    return set(flags.split()) >= NEEDED


# Programs of users keep numba as it is: theirs may gain from what newer processors have.
if "fleet.runtime" in sys.orig_argv and os.path.isdir(FOLDER) and able():  # noqa: PTH112 - as above
    for name, value in {**SETTINGS, "NUMBA_CACHE_LOCATOR_CLASSES": LOCATORS}.items():
        os.environ.setdefault(name, value)
