"""The command line: it reads arguments, calls the library and prints; it does no mathematics.

Heavy imports are done only when a command runs, so ``--help`` is quick. Every command but `completion` takes
``--json`` for machines. Start with `fitting`.

- **Commands.** `fitting` (info, identify, compare), `checking` (check, map, cut, fetch), `improving` (diagnose, add,
  improve, history), `seeing` (report, studio), `exporting`, `carrying` (payload), `drives` (gains), `motions`,
  `fleets`, `paper`, `learning` (effects, demo, doctor, schema, completion). `group` is the group of all.
- **What they take.** `arguments` and `controllers` (options), `paths` (files), `inputs` (a robot and its logs).
- **What they print.** A function of `pages` turns a result into a page, `output` prints the page, `narrow` fits its
  tables into a terminal. `outputs` has the types of the JSON.
- **The work of some commands.** `demo`, `practice` (the folder of the guides), `self_test`.
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
