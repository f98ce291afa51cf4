"""The state of an installation, as a page."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from typing import Any

from rich.markup import escape

from frischid.cli.pages.page import Page, table_of
from frischid.cli.self_test import Trial
from frischid.core.extras import PURPOSE, install_command, installed, name_of, packages
from frischid.core.text import listed
from frischid.core.version import __version__


def health(trials: Sequence[Trial]) -> Page:
    """Versions, optional parts, and the self-test."""
    needed = {name_of(text): installed(text) for text in sorted(packages())}
    parts = {extra: [name_of(text) for text in packages(extra) if installed(text) is None] for extra in PURPOSE}
    where = f"Python {platform.python_version()}, {platform.platform()}, {os.cpu_count()} cores"
    lines: list[Any] = [
        f"[bold]frischid {__version__}[/bold], {escape(where)}",
        ", ".join(f"{name} {version or 'MISSING'}" for name, version in needed.items()),
        "",
        "optional parts",
        *(_part(extra, absent) for extra, absent in parts.items()),
        "",
        _trials(trials),
        _verdict(trials),
    ]
    data = {
        "frischid": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "packages": needed,
        "optional": {extra: {"missing": absent} for extra, absent in parts.items()},
        "self_test": [vars(trial) for trial in trials],
        "passed": all(trial.passed for trial in trials),
    }
    return Page(data, lines)


def _part(extra: str, absent: Sequence[str]) -> str:
    state = "there" if not absent else f"missing: {escape(install_command(extra))}"
    return f"  {extra:<8} {PURPOSE[extra]}: {state}"


def _trials(trials: Sequence[Trial]) -> Any:
    table = table_of("self-test", "", "what", "seconds")
    for trial in trials:
        state = "[green]passed[/green]" if trial.passed else "[bold red]FAILED[/bold red]"
        table.add_row(trial.name, state, escape(trial.detail), f"{trial.seconds:.1f}")
    return table


def _verdict(trials: Sequence[Trial]) -> str:
    failed = [trial.name for trial in trials if not trial.passed]
    if not failed:
        return "All is well. To report a fault, attach this, the command, all that it printed, the URDF and the log."
    return f"The self-test failed at {listed(failed)}. Please report it, with all of this output."
