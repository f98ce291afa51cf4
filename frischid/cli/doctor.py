"""The command `doctor`: whether an installation is complete, and computes what it should."""

from __future__ import annotations

from frischid.cli.arguments import json_option
from frischid.cli.group import main
from frischid.cli.output import show_page, working


@main.command()
@json_option
def doctor(as_json: bool) -> None:
    """Show versions and optional parts, and run a self-test.

    Attach the output to a report of a fault. Exit code 1: the self-test failed.
    """
    from frischid.cli.pages import doctor as show
    from frischid.cli.self_test import self_test

    with working(as_json) as progress:
        progress("testing")
        trials = self_test()
    show_page(show.health(trials), as_json)
    if not all(trial.passed for trial in trials):
        raise SystemExit(1)
