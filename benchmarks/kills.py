"""Kill commands at random moments; no file is ever half, and the next writer leaves nothing of the killed one.

Each command writes over an output that is there already, and gets SIGKILL at a random moment of its usual time. Then
the output must be the old file or a whole new one, the inputs must be untouched, and after one more file was written
in the folder, nothing but named files may be there.

    python benchmarks/kills.py                                                    200 kills
    python benchmarks/kills.py --kills 8 --only identify,export,simulate,fetch   as CI does
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from common import parser, publish

import frischid as fr
from frischid.cli import main as command_line
from frischid.core.files import write_text
from frischid.export.proofread import proofread
from frischid.logs.datasets import DATASETS, Dataset
from frischid.logs.mapping import LogMap
from frischid.logs.tables import read_table


@dataclass(frozen=True)
class Job:
    """One command, and how its output is known to be whole."""

    arguments: tuple[str, ...]
    output: str
    is_whole: Callable[[Path], bool]


def is_model(path: Path) -> bool:
    fr.Model.load(path)
    return True


def is_page(path: Path) -> bool:
    return path.read_text(encoding="utf-8").rstrip().endswith("</html>")


def is_code(path: Path) -> bool:
    proofread(path.read_text(encoding="utf-8"), "NumPy", str(path))
    return True


def is_log(path: Path) -> bool:
    return len(fr.read_log(path)) > 0


JOBS = {
    "identify": Job(("planar2", "a.csv", "-o", "new.json"), "new.json", is_model),
    "improve": Job(("model.json", "a.csv", "-o", "new.json", "--max-steps", "1"), "new.json", is_model),
    "report": Job(("model.json", "a.csv", "-o", "page.html"), "page.html", is_page),
    "export": Job(("model.json", "-o", "control.py"), "control.py", is_code),
    "fleet": Job(("planar2", "fleet/*.csv", "-o", "new.json", "--workers", "2"), "new.json", is_model),
    "simulate": Job(("planar2", "-o", "b.parquet", "--duration", "60"), "b.parquet", is_log),
    "fetch": Job(("made", "--from", "source", "-o", "fetched"), "fetched/log.parquet", is_log),
}


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--kills", type=int, default=200)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--only", help="commands to kill, comma separated; all by default")
    given = options.parse_args()
    jobs = {name: JOBS[name] for name in given.only.split(",")} if given.only else JOBS
    rng = random.Random(given.seed)
    with TemporaryDirectory() as text:
        folder = Path(text)
        prepare(folder)
        times = {name: usual_time(folder, name, job) for name, job in jobs.items()}
        counts = {name: {"kills": 0, "while running": 0, "old": 0, "new": 0, "half": 0, "left": 0} for name in jobs}
        for number in range(given.kills):
            name = list(jobs)[number % len(jobs)]
            for key in killed(folder, name, jobs[name], rng.uniform(0.0, 1.05 * times[name])):
                counts[name][key] += 1
    rows: list[dict[str, Any]] = [{"command": n, "seconds": round(times[n], 1)} | c for n, c in counts.items()]
    notes = [f"{given.kills} kills; old, new, half: the output afterwards; left: files that nobody named"]
    publish("kill -9 at random moments", rows, given.json, notes)
    if any(row["half"] or row["left"] for row in rows):
        sys.exit("a file was half written, or something was left behind")


def prepare(folder: Path) -> None:
    """Logs, a fleet's logs and a model."""
    robot = fr.Robot.load("planar2")
    (folder / "fleet").mkdir()
    for seed in range(3):
        log = fr.simulate(
            robot, fr.random_fourier(robot, 5.0, seed=seed), rate=50.0, noise=fr.Noise(tau=0.01), channels=()
        )
        fr.write_log(log, folder / "fleet" / f"r{seed}.csv")
    fr.write_log(log, folder / "a.csv")
    fr.identify(robot, [log], recursion="none").model.save(folder / "model.json")
    (folder / "source").mkdir()
    fr.write_log(log, folder / "source" / "raw.csv")


def made_up(file: Path) -> Dataset:
    """A data set of one file: those of the world cannot be fetched everywhere."""

    def layout(path: Path) -> dict[str, Any]:
        table = read_table(path, LogMap())
        return {name: table.values(name) for name in table.names}

    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    return Dataset("made up", "", "none", "", "https://x.invalid/", {file.name: digest}, {"log": file.name}, layout)


def start(folder: Path, name: str, job: Job) -> subprocess.Popen[bytes]:
    """Start a command in a process group of its own; `fetch` knows the data set that was made up."""
    command = [sys.executable, __file__ if name == "fetch" else "-mfrischid", name, *job.arguments]
    null = subprocess.DEVNULL
    return subprocess.Popen(command, cwd=folder, stdout=null, stderr=null, start_new_session=True)


def usual_time(folder: Path, name: str, job: Job) -> float:
    """Seconds of the whole command; its output is the old file of the kills."""
    begin = time.perf_counter()
    code = start(folder, name, job).wait()
    if code not in (0, 1):
        raise SystemExit(f"{name} {' '.join(job.arguments)} ends with exit code {code}")
    return time.perf_counter() - begin


def killed(folder: Path, name: str, job: Job, after: float) -> list[str]:
    """Kill a command after some seconds, and say in which columns it counts."""
    output = folder / job.output
    before = output.read_bytes()
    inputs = {path: path.read_bytes() for path in (folder / "a.csv", folder / "model.json")}
    stamp = output.stat().st_mtime_ns
    process = start(folder, name, job)
    time.sleep(after)
    found = ["kills"]
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        found.append("while running")
    process.wait()
    try:
        whole = job.is_whole(output) and all(path.read_bytes() == content for path, content in inputs.items())
    except (fr.FrischidError, OSError, json.JSONDecodeError):
        whole = False
    same = output.read_bytes() == before and output.stat().st_mtime_ns == stamp
    found.append("half" if not whole else "old" if same else "new")
    for place in (folder, folder / "fleet", output.parent):
        write_text(place / "next.txt", "the next writer\n")
        (place / "next.txt").unlink()
    if any(path.name.endswith(".tmp") for path in folder.rglob("*")):
        found.append("left")
    return found


if __name__ == "__main__":
    if sys.argv[1:2] == ["fetch"]:
        DATASETS["made"] = made_up(Path("source/raw.csv"))
        command_line()
    else:
        main()
