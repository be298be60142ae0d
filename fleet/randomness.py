"""Random numbers that depend on where they are used and on nothing else.

A simulated mission, its plain reference and a flown one that was killed and started again must all make the same
choices. So a choice draws from a counter-based generator: a hash of (seed, mission, agent, step). No state is kept.

Source: SplitMix64 (Steele, Lea, Flood: Fast splittable pseudorandom number generators, OOPSLA 2014).
"""

from __future__ import annotations

import hashlib

_MASK = (1 << 64) - 1
GOLDEN_GAMMA = 0x9E3779B97F4A7C15
MIX_1 = 0xBF58476D1CE4E5B9
MIX_2 = 0x94D049BB133111EB


def mix(value: int) -> int:
    """SplitMix64's finaliser: a bijection of 64-bit integers."""
    value = (value ^ (value >> 30)) * MIX_1 & _MASK
    value = (value ^ (value >> 27)) * MIX_2 & _MASK
    return value ^ (value >> 31)


def draw(seed: int, *counters: int) -> int:
    """64 random bits for a place in the program.

    Args:
        seed: Any integer; the low 64 bits count.
        counters: What tells this draw from all others: mission, agent, step, purpose.
    """
    state = mix((seed + GOLDEN_GAMMA) & _MASK)  # mixed first: seed and mission must not be interchangeable
    for counter in counters:
        state = mix(((state ^ (counter & _MASK)) + GOLDEN_GAMMA) & _MASK)
    return mix((state + GOLDEN_GAMMA) & _MASK)


def uniform(seed: int, *counters: int) -> float:
    """A number in [0, 1) with 53 random bits; see `draw`."""
    return (draw(seed, *counters) >> 11) * 2.0**-53


def named_seed(seed: int, name: str) -> int:
    """An independent seed in 0..2^32-1 for a named purpose, for generators that take a seed."""
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=4).digest()
    return int.from_bytes(digest, "big")
