"""Functions that every benchmark script uses: options, a table, and the same figures as JSON."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from rich.console import Console
from rich.table import Table

from frischid.core.files import write_text
from frischid.core.parallel import HERE, Dask, Workers, workers


def parser(description: str | None) -> argparse.ArgumentParser:
    """Options of every benchmark."""
    options = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--json", metavar="FILE", type=Path, help="write the figures here too")
    return options


def data_folder() -> Path | None:
    """Folder of the measured logs, from FRISCHID_DATA; None when it is not set."""
    folder = os.environ.get("FRISCHID_DATA")
    return Path(folder) if folder else None


@contextmanager
def pool(scheduler: str | None, count: int, *modules: ModuleType) -> Iterator[Workers]:
    """Workers for a benchmark's runs; one worker is this process. The workers receive `modules` of the benchmark."""
    with workers(scheduler or (HERE if count == 1 else None), count) as there:
        if isinstance(there, Dask):
            import cloudpickle  # comes with Dask

            for module in modules:
                cloudpickle.register_pickle_by_value(module)
        yield there


class Worker:
    """Another package that does the same job in an interpreter of its own, once per line sent to it.

    Parameters
    ----------
    python : str
        Interpreter that has the package.
    script : Path
        Script to run; it answers every line with a line of JSON.
    folder : str
        Folder of inputs and answers.
    install : str
        Command that installs the package, for the error message.
    """

    def __init__(self, python: str, script: Path, folder: str, install: str) -> None:
        self.python, self.install = python, install
        self.process = subprocess.Popen(
            [python, str(script), folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> Worker:
        return self

    def run(self, said: str = "go") -> dict[str, Any]:
        """One round; `said` is the line that the script gets."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(f"{said}\n")
            self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            sys.exit(
                f"error: {self.python} cannot run {self.script.name}; run `{self.install}` in a venv of its own and "
                "pass that venv's interpreter with --python"
            )
        return dict(json.loads(line))

    def __exit__(self, *_: object) -> None:
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.wait()


def numbers(criteria: Any) -> list[str]:
    """Names of the numbers in frozen criteria; ``burst.edge`` is the edge of the rule ``burst``."""
    found = []
    for field in fields(criteria):
        value = getattr(criteria, field.name)
        found += [f"{field.name}.{inner}" for inner in numbers(value)] if is_dataclass(value) else [field.name]
    return found


def multiplied(criteria: Any, name: str, factor: float) -> Any:
    """The criteria with one of their `numbers` multiplied; a whole number stays one, and is at least 1."""
    first, _, rest = name.partition(".")
    value = getattr(criteria, first)
    if rest:
        changed = multiplied(value, rest, factor)
    else:
        changed = max(1, round(value * factor)) if isinstance(value, int) else value * factor
    return replace(criteria, **{first: changed})


def publish(title: str, rows: Sequence[Mapping[str, Any]], path: Path | None, notes: Sequence[str] = ()) -> None:
    """Print the rows as a table and write them as JSON.

    Parameters
    ----------
    title : str
    rows : sequence of mapping
        One per line; columns are the keys of the first.
    path : Path or None
        JSON file to write.
    notes : sequence of str
        Printed below the table, and written.
    """
    table = Table(title=title, title_justify="left", header_style="bold")
    names = list(rows[0]) if rows else []
    for name in names:
        table.add_column(name, justify="left" if isinstance(rows[0][name], str) else "right")
    for row in rows:
        table.add_row(*(_cell(row.get(name)) for name in names))
    console = Console(width=160)
    console.print(table)
    for note in notes:
        console.print(note)
    if path is not None:
        record(title, rows, path, notes)


def record(title: str, rows: Sequence[Mapping[str, Any]], path: Path, notes: Sequence[str] = ()) -> None:
    """Write rows as JSON, with the machine and the version that made them; parameters as in `publish`."""
    project = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    version = tomllib.loads(project)["project"]["version"]  # of this checkout, whatever is installed
    machine = {
        "python": platform.python_version(),
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "load": round(
            os.getloadavg()[1], 1
        ),  # of the last five minutes: above the cores, times are those of a busy machine
    }
    content = {
        "schema": "frischid.benchmark/1",
        "title": title,
        "frischid": version,
        "machine": machine,
        "rows": list(rows),
        "notes": list(notes),
    }
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def _cell(x: Any) -> str:
    if isinstance(x, bool):
        return "yes" if x else "NO"
    return f"{x:.4g}" if isinstance(x, float) else str(x)
