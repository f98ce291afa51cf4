"""Processor time of the commands now and in an earlier release, on the UR10e's logs, in one run.

`--before FOLDER` holds the earlier release's source, for example from ``git archive v0.1.0 | tar x -C FOLDER``; it runs
with this interpreter's packages. Each command is a process of its own, the two releases take turns, and the table has
the median of `--runs`. The errors of both models stand beside their times: less time is worth nothing with another
result.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from common import data_folder, parser, publish
from trust import FIVE, Part, read

import frischid as fr
from frischid.logs.readers import write_log

HERE = Path(__file__).resolve().parents[1]
BUDGET = "3000"  # evaluations of the criterion: a tenth of the default, the same work in both releases
TEST = "unloaded_50s_14harm"


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--before", type=Path, required=True, metavar="FOLDER", help="source of the other release")
    arguments.add_argument("--runs", type=int, default=3)
    options = arguments.parse_args()
    data = data_folder()
    if data is None:
        sys.exit("FRISCHID_DATA names no folder with the UR10e's logs")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        commands = prepared(data, work)
        times: dict[tuple[str, str], list[float]] = {}
        told: dict[tuple[str, str], str] = {}
        for _ in range(options.runs):
            for name, command in commands.items():
                for release, source in (("before", options.before), ("now", HERE)):
                    seconds, output = timed([w.replace("MODEL", f"{release}.json") for w in command], source, work)
                    times.setdefault((name, release), []).append(seconds)
                    told[name, release] = result(name, output)
                    print(f"{name}, {release}: {seconds:.1f} s, {told[name, release]}", file=sys.stderr, flush=True)
    rows = []
    for name in commands:
        before, now = (statistics.median(times[name, release]) for release in ("before", "now"))
        rows.append(
            {"command": name, "before, s": before, "now, s": now, "ratio": now / before}
            | {f"result {release}": told[name, release] for release in ("before", "now")}
        )
    publish("processor time of the commands on the UR10e's logs", rows, options.json)


def prepared(data: Path, work: Path) -> dict[str, list[str]]:
    """The logs with torques in files that every release reads, and the commands."""
    urdf = data / "ur10e" / "ur10e.urdf"
    robot = fr.Robot.load(urdf)
    for name in (*FIVE, TEST):
        write_log(read(data, robot, "ur10e", Part(name)), work / f"{name}.csv")
    logs, test = [f"{name}.csv" for name in FIVE], f"{TEST}.csv"
    return {
        "identify": ["identify", str(urdf), *logs, "--valid", test, "-o", "MODEL", "--json"],
        "check": ["check", str(urdf), *logs, "--json"],
        "diagnose": ["diagnose", "MODEL", *logs, "--json"],
        "improve": ["improve", "MODEL", *logs, "--valid", test, "--json"],
        "report": ["report", "MODEL", test, "-o", "page.html", "--json"],
        "excite": ["excite", str(urdf), "--budget", BUDGET, "-o", "motion.csv", "--json"],
    }


def timed(command: list[str], source: Path, work: Path) -> tuple[float, str]:
    """Processor seconds of a command and of its children, and its output."""
    environment = {**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # as installed: modules are compiled once
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = [sys.executable, "-m", "frischid", *command]
    done = subprocess.run(words, cwd=work, env=environment, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 1):  # 1: an alarm, which is a result
        sys.exit(f"{source}: {' '.join(command)}\n{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def result(name: str, output: str) -> str:
    """The figure by which two releases can be compared."""
    try:
        found: Any = json.loads(output)
    except json.JSONDecodeError:
        return ""
    return {
        "identify": lambda: f"rank {found['rank']}, cut-off {found['cutoff_hz']:.3g} Hz",
        "diagnose": lambda: f"{found['verdict']}, {len(found['findings'])} findings",
        "improve": lambda: f"{len(found['steps'])} steps, NRMSE {last_error(found['steps'])}",
        "excite": lambda: f"cost {found['cost']:.4g}",
    }.get(name, str)()


def last_error(steps: Sequence[Mapping[str, Any]]) -> str:
    """Error on the test log after the last step; 0.1.0 measured every step there."""
    return f"{steps[-1].get('test_after', steps[-1]['error_after']):.4f}" if steps else "as before"


if __name__ == "__main__":
    main()
