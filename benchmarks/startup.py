"""Start-up time of frischid compared with that of the libraries it needs: whole processes, in turn, in one run.

The figure is the median over rounds of the ratio within a round. Times are processor time, which other work on the
machine disturbs less than wall-clock time.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys

from common import parser, publish

PINOCCHIO = ("import pinocchio", [sys.executable, "-c", "import pinocchio"])
BOTH = ("import pinocchio, scipy.signal", [sys.executable, "-c", "import pinocchio, scipy.signal"])
CASES = [
    ("import frischid", [sys.executable, "-c", "import frischid"], BOTH, 1.5),
    ("frischid.identify, read_log, Robot", [sys.executable, "-c", "from frischid import identify, read_log, Robot"],
     BOTH, None),
    ("frischid --help", [sys.executable, "-m", "frischid", "--help"], PINOCCHIO, 2.0),
    ("frischid identify --help", [sys.executable, "-m", "frischid", "identify", "--help"], PINOCCHIO, 2.0),
    ("a mistyped command", [sys.executable, "-m", "frischid", "idenify"], PINOCCHIO, 2.0),
    ("a mistyped option", [sys.executable, "-m", "frischid", "identify", "--outptu"], PINOCCHIO, 2.0),
]  # fmt: skip


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--rounds", type=int, default=7)
    options = arguments.parse_args()
    commands = {name: command for name, command, _, _ in CASES} | dict([PINOCCHIO, BOTH])
    for command in commands.values():  # so that compiled modules and file caches exist for all rounds
        processor_time(command)
    times: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(options.rounds):
        for name, command in commands.items():
            times[name].append(processor_time(command))
    rows = []
    for name, _, (other, _), target in CASES:
        ratio = statistics.median(a / b for a, b in zip(times[name], times[other], strict=True))
        rows.append(
            {
                "process": name,
                "ms": 1e3 * statistics.median(times[name]),
                "against": other,
                "its ms": 1e3 * statistics.median(times[other]),
                "ratio": ratio,
                "target": "" if target is None else f"{target:g}",
                "reached": "" if target is None else ("yes" if ratio <= target else "NO"),
            }
        )
    publish("start-up of whole processes", rows, options.json, [f"median of {options.rounds} rounds, processor time"])


def processor_time(command: list[str]) -> float:
    """User and system seconds of a process and all its threads."""
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, _, usage = os.wait4(child.pid, 0)
    child.returncode = 0  # already waited for
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
