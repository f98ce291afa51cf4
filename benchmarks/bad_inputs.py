"""The table of bad inputs: every kind of column, file, robot, mapping, model, formula and argument, with every fault.

Each row is one command on one bad input: its exit code and its message. A row fails if the command ends in a
traceback, takes longer than 20 s, or accepts an input that nobody can use (exit code 0 where 1 or 2 must come).

    python benchmarks/bad_inputs.py              prints the whole table
    python benchmarks/bad_inputs.py --every 25   one row of 25, as CI does
"""

from __future__ import annotations

import os
import sys
import traceback
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bad_input_rows
import click.testing
from bad_input_row import Row
from common import parser, publish
from mutated_models import TooLongError, limited

from frischid.cli import main as frischid

LONGEST = 20  # s of one command


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--every", type=int, default=1, help="take one row of so many")
    options.add_argument("--only", default="", help="kinds of input that begin with this")
    options.add_argument("--failed", action="store_true", help="print only the rows that failed")
    given = options.parse_args()
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        every = [row for row in bad_input_rows.rows(Path(folder)) if row.kind.startswith(given.only)]
        rows = [result(row) for row in every[:: given.every]]
        os.chdir("/")
    counts = Counter(str(row["exit code"]) for row in rows)
    bad = [row for row in rows if row["verdict"] != "right"]
    notes = [
        f"{len(rows)} of {len(every)} rows: " + ", ".join(f"exit code {k}: {n}" for k, n in sorted(counts.items())),
        f"{len(bad)} rows failed",
    ]
    publish("bad inputs", bad if given.failed else rows, given.json, notes)
    if bad:
        sys.exit(1)


def result(row: Row) -> dict[str, Any]:
    """Run one command, and judge its end."""
    row.prepare()
    runner = click.testing.CliRunner()
    try:
        with limited(LONGEST):
            done = runner.invoke(frischid, list(row.arguments))
    except TooLongError as error:
        return line(row, -1, str(error), "too long")
    verdict = "right"
    message = last_line(done.stderr) or last_line(done.stdout)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        place = traceback.extract_tb(done.exception.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        return line(row, done.exit_code, f"{type(done.exception).__name__} at {where}: {done.exception}", "traceback")
    if done.exit_code not in row.codes:
        verdict = "accepted" if done.exit_code == 0 else "another exit code"
    return line(row, done.exit_code, message, verdict)


def line(row: Row, code: int, message: str, verdict: str) -> dict[str, Any]:
    """One line of the table."""
    command = shortened(" ".join(row.arguments), 70)
    return {
        "kind": row.kind, "fault": shortened(row.fault, 40), "command": command, "exit code": code,
        "message": shortened(message, 110), "verdict": verdict,
    }  # fmt: skip


def last_line(text: str) -> str:
    """The last line that says something."""
    return next((x for x in reversed(text.splitlines()) if x.strip()), "")


def shortened(text: str, most: int) -> str:
    plain = text.encode("unicode_escape").decode()
    return plain if len(plain) <= most else f"{plain[: most - 1]}…"


if __name__ == "__main__":
    main()
