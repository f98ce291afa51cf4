"""Processor time and memory of whole commands on one long log: check, identify, compare, report, diagnose.

Memory and time may grow only where frischid says so. The log repeats a simulated motion of a planar arm with fresh
noise, at 1 kHz, as one Parquet file. Each command runs in a process of its own; its memory is the peak of that process.

    python benchmarks/long_log.py                    1e5 and 1e7 rows
    python benchmarks/long_log.py --rows 1e4 1e5     a short run
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from common import parser, publish

import frischid as fr

RATE, PERIOD = 1000.0, 20.0
LIMIT = 500  # MiB, of every command
COMMANDS = {
    "check": ("planar2", "long.parquet"),
    "identify": ("planar2", "long.parquet", "-o", "model.json"),
    "compare": ("model.json", "long.parquet"),
    "report": ("model.json", "long.parquet", "-o", "page.html"),
    "diagnose": ("model.json", "long.parquet"),
}


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--rows", type=float, nargs="+", default=[1e5, 1e7])
    given = options.parse_args()
    rows = []
    for count in given.rows:
        with TemporaryDirectory() as folder:
            write(Path(folder) / "long.parquet", int(count))
            rows += [{"rows": int(count), **measured(name, Path(folder))} for name in COMMANDS]
    worst = max(row["peak MiB"] for row in rows)
    publish("whole commands on one long log", rows, given.json, [f"most memory {worst:.0f} MiB, limit {LIMIT}"])
    if worst > LIMIT or any(row["exit code"] > 1 for row in rows):
        sys.exit("a command failed or needed more memory than it may")


def write(path: Path, rows: int) -> None:
    """One file of so many rows, a period of the motion at a time."""
    robot, rng = fr.Robot.load("planar2"), np.random.default_rng(0)
    period = fr.simulate(robot, fr.random_fourier(robot, PERIOD, seed=3), rate=RATE, channels=())
    schema = pa.schema(
        [(name, pa.float64()) for name in ("t", *(f"{c}_joint{j}" for c in ("q", "tau") for j in (1, 2)))]
    )
    with pq.ParquetWriter(path, schema) as file:
        for start in range(0, rows, len(period)):
            count = min(len(period), rows - start)
            t = (start + np.arange(count)) / RATE
            q = period.q[:count] + 1e-5 * rng.normal(size=(count, 2))
            assert period.tau is not None
            tau = period.tau[:count] + 0.01 * rng.normal(size=(count, 2))
            file.write_table(pa.table([t, *q.T, *tau.T], schema=schema))


def measured(name: str, folder: Path) -> dict[str, Any]:
    """One command: its exit code, processor time, peak of resident memory."""
    null = subprocess.DEVNULL
    process = subprocess.Popen(
        [sys.executable, "-m", "frischid", name, *COMMANDS[name]], cwd=folder, stdout=null, stderr=null
    )
    _, status, used = os.wait4(process.pid, 0)
    return {
        "command": name,
        "exit code": os.waitstatus_to_exitcode(status),
        "processor time, s": used.ru_utime + used.ru_stime,
        "peak MiB": used.ru_maxrss / 1024,
    }


if __name__ == "__main__":
    main()
