"""A model to look at: the report that is sent to a colleague, the studio to work in."""

from __future__ import annotations

from typing import Any

import click

from frischid.cli.arguments import json_option, map_option, situation_option
from frischid.cli.group import main
from frischid.cli.inputs import read
from frischid.cli.output import show_page, working


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@map_option
@situation_option
@click.option("-o", "--output", type=click.Path(), default="report.html", show_default=True, help="The HTML file.")
@json_option
def report(model: str, logs: tuple[str, ...], mapping: str | None, situation: Any, output: str, as_json: bool) -> None:
    """One HTML page that opens offline: how good the model is, where it fails, what is missing, what to do."""
    from frischid.cli.pages import seeing as show
    from frischid.core.files import check_writable
    from frischid.model.model import Model
    from frischid.reports.page import report as run

    check_writable(output)
    loaded = Model.load(model)
    with working(as_json) as progress:
        progress("reading logs")
        data = read(logs, loaded.robot, mapping)
        study = run(loaded, data, output, situation=situation, model_path=model, progress=progress)
    show_page(show.report(study, output), as_json)


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@map_option
@click.option(
    "-o", "--output", type=click.Path(), help="Where the page saves the model; MODEL with -studio by default."
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8080, show_default=True, help="Port to listen on; the next free one when it is taken.")
@json_option
def studio(
    model: str,
    logs: tuple[str, ...],
    mapping: str | None,
    output: str | None,
    host: str,
    port: int,
    as_json: bool,
) -> None:
    """A page to work in: the robot moves along the log, a click adds what is missing, and the error falls."""
    import time
    import warnings
    from pathlib import Path

    from frischid.studio import Studio

    path = output or str(Path(model).with_name(f"{Path(model).stem}-studio.json"))
    # A browser tab may be closed at any time, also while something is sent to it.
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)
    running = Studio(host, port)  # before all that takes time: a browser may begin to load the page
    try:
        from frischid.cli.pages import studio as show

        show_page(show.studio(running.address, path, host), as_json)
        with working(as_json) as progress:
            progress("reading logs")
            from frischid.model.model import Model

            loaded = Model.load(model)
            data = read(logs, loaded.robot, mapping)
            progress("comparing")
            running.show(loaded, data, path)
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        pass
    finally:
        running.stop()
