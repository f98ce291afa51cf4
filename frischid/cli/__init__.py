"""The command line: reads arguments, calls the library, prints. No mathematics.

Every command takes ``--json`` for machines. Heavy imports wait until a command runs, so ``--help`` is quick.
"""

# each adds its commands to the group
from frischid.cli import checking, drives, exporting, fitting, fleets, improving, learning, motions, seeing
from frischid.cli.group import main

__all__ = [
    "checking",
    "drives",
    "exporting",
    "fitting",
    "fleets",
    "improving",
    "learning",
    "main",
    "motions",
    "seeing",
]
