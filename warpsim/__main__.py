"""`python -m warpsim` is the command `warpsim`."""

from warpsim.cli import run

run()
