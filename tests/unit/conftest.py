"""What unit tests share."""

from __future__ import annotations

import os

import pytest


@pytest.fixture
def quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests in which programs die, and no machine does: nothing need be on the platters."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
