"""The command line: reads arguments, calls the library, prints. No mathematics.

Every command takes ``--json`` for machines. Heavy imports wait until a command runs, so ``--help`` is quick.
"""

from frischid.cli import fitting, improving, learning, motions, seeing  # each adds its commands to the group
from frischid.cli.group import main

__all__ = ["fitting", "improving", "learning", "main", "motions", "seeing"]
