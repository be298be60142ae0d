from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from fleet.cli import extensions
from tests.integration.cli.conftest import Invoke, Program
