"""The command line: it reads arguments, calls the library and prints; it does no mathematics.

Every command takes ``--json`` for machines. Heavy imports are done only when a command runs, so ``--help`` is quick.
"""

# each module adds its commands to the group
from frischid.cli import (
    carrying,
    checking,
    drives,
    exporting,
    fitting,
    fleets,
    improving,
    learning,
    motions,
    paper,
    seeing,
)
from frischid.cli.group import main

__all__ = [
    "carrying",
    "checking",
    "drives",
    "exporting",
    "fitting",
    "fleets",
    "improving",
    "learning",
    "main",
    "motions",
    "paper",
    "seeing",
]
