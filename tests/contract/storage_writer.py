"""A process that writes until it is killed: `python -m tests.contract.storage_writer URI whole|append PATH SEED`.

It prints the number of each acknowledged write.
"""

from __future__ import annotations

import random
import sys
import zlib
from itertools import count

from fleet.storage.open import open_storage


def whole(number: int, size: int) -> bytes:
    """A whole object that shows whether it is torn: number, size and checksum before the data."""
    body = random.Random(number).randbytes(size)
    return f"{number} {size} {zlib.crc32(body)}\n".encode() + body


def number_of(data: bytes) -> int:
    """The number of a whole object. Raises ValueError when it is torn."""
    head, _, body = data.partition(b"\n")
    number, size, checksum = map(int, head.split())
    if len(body) != size or zlib.crc32(body) != checksum:
        raise ValueError(f"object {number} is torn: {len(body)} of {size} bytes")
    return number


def line(number: int) -> bytes:
    """An appended line, with a line end on both sides so that a torn one before it stays alone."""
    return f"\nrecord {number} {'x' * (number % 97)} end\n".encode()


def main() -> None:
    uri, kind, path, seed = sys.argv[1:]
    storage = open_storage(uri)
    sizes = random.Random(int(seed))
    for number in count(1):
        if kind == "whole":
            storage.write(path, whole(number, sizes.randrange(300_000)))
        else:
            storage.append(path, line(number))
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
