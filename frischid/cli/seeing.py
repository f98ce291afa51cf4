"""A model to look at: the report that is sent to a colleague."""

from __future__ import annotations

from typing import Any

import click

from frischid.cli.arguments import json_option, map_option, read, show_page, situation_option, working
from frischid.cli.group import main


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@map_option
@situation_option
@click.option("-o", "--output", type=click.Path(), default="report.html", show_default=True, help="The HTML file.")
@json_option
def report(model: str, logs: tuple[str, ...], mapping: str | None, situation: Any, output: str, as_json: bool) -> None:
    """One HTML page that opens offline: how good the model is, where it fails, what is missing, what to do."""
    from frischid.model import Model, check_writable
    from frischid.report import report as run
    from frischid.show import seeing as show

    check_writable(output)
    loaded = Model.load(model)
    with working(as_json) as progress:
        progress("reading logs")
        data = read(logs, loaded.robot, mapping)
        study = run(loaded, data, output, situation=situation, model_path=model, progress=progress)
    show_page(show.report(study, output), as_json)
