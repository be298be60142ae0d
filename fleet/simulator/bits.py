"""Instructions of the processor that count the bits of a word, and what they do in plain Python."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from fleet.compiled import instruction
from fleet.simulator.arrays import WORD_BITS


def zeros_below(word: Any) -> int:
    """As `trailing_zeros`."""
    bits = int(word)
    return (bits & -bits).bit_length() - 1 if bits else WORD_BITS


def zeros_above(word: Any) -> int:
    """As `leading_zeros`."""
    return WORD_BITS - int(word).bit_length()


@instruction(zeros_below)
def trailing_zeros(_context: Any, value: Any) -> Any:
    """Zeros below the lowest bit that is set, of a uint64; 64 for 0."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return value(value), generate


@instruction(zeros_above)
def leading_zeros(_context: Any, value: Any) -> Any:
    """Zeros above the highest bit that is set, of a uint64; 64 for 0."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctlz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return value(value), generate
