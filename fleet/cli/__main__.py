"""`python -m fleet.cli` is `fleet`."""

from fleet.cli.main import run

run()
