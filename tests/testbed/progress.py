"""Tells who waits what takes long."""

from __future__ import annotations

import sys


def say(text: str) -> None:
    """One line on the terminal, also from within a test whose output pytest keeps."""
    if sys.__stderr__ is not None:
        sys.__stderr__.write(f"test bed: {text}\n")
        sys.__stderr__.flush()
