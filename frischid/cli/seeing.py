"""The commands `report` and `studio`: a page to send to a colleague, and a page to work in."""

from __future__ import annotations

from typing import Any

import click

from frischid.cli.arguments import (
    MapFiles,
    json_option,
    logs_argument,
    map_option,
    situation_option,
    torque_joints_option,
    valid_option,
)
from frischid.cli.group import main
from frischid.cli.inputs import model_of, models_of, opened, opened_or_own, read
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath, OutputPath, also_written
from frischid.errors import InputError

MODEL_SUFFIX = ".json"  # no log has this suffix
PAGE_SUFFIXES = (".html", ".htm")


@main.command()
@click.argument("model", type=InputPath())
@logs_argument("[MODEL]... [LOGS]...")
@map_option
@valid_option
@situation_option
@torque_joints_option
@click.option("-o", "--output", type=OutputPath(), default="report.html", show_default=True, help="The HTML file.")
@json_option
def report(
    model: str,
    logs: tuple[str, ...],
    mapping: MapFiles,
    valid: tuple[str, ...],
    situation: Any,
    torque_joints: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Write one HTML page about a model, which opens offline.

    It shows the model's errors, where the model fails, missing effects, and the next step. Further models (.json) are
    compared with the first, joint by joint, on the same logs. Without LOGS, the logs that the model was fitted to are
    read again.
    """
    from itertools import takewhile
    from pathlib import Path

    from frischid.cli.pages import seeing as show
    from frischid.reports.page import report as run

    further = tuple(takewhile(lambda path: path.endswith(MODEL_SUFFIX), logs))
    models = models_of((model, *further), torque_joints)
    loaded = next(iter(models.values()))
    if Path(output).suffix.lower() not in PAGE_SUFFIXES:
        raise InputError(f"{output}: a report is an HTML page; give it a name that ends with .html")
    with working(as_json) as progress:
        progress("reading logs")
        data = opened_or_own(logs[len(further) :], loaded, mapping, progress)
        test = opened(valid, loaded.robot, mapping, progress)
        study = run(models, data, output, valid=test, situation=situation, model_path=model, progress=progress)
    show_page(show.report(study, output), as_json)


@main.command()
@click.argument("model", type=InputPath())
@logs_argument()
@map_option
@click.option(
    "-o", "--output", type=OutputPath(), help="Where the page saves the model; MODEL with -studio by default."
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8080, show_default=True, help="Port to listen on, or the next free one.")
@json_option
def studio(
    model: str,
    logs: tuple[str, ...],
    mapping: MapFiles,
    output: str | None,
    host: str,
    port: int,
    as_json: bool,
) -> None:
    """Open a page to work on a model.

    The robot moves along the log; a click adds a missing effect, and the error falls. Without LOGS, the logs that the
    model was fitted to are read again.
    """
    import os
    import time
    import warnings
    from pathlib import Path

    from frischid.studio import Studio

    if not Path(model).is_file():
        model_of(model)  # an error, before a page opens
    path = output or f"{os.path.splitext(model)[0]}-studio.json"  # noqa: PTH122 (an empty name is an error below)
    if output is None:
        also_written(path)
    also_written(Path(path).with_suffix(".html"))  # the report
    # A browser tab may be closed at any time, even while data are sent to the tab.
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)
    running = Studio(host, port)  # first of all, so that a browser can begin to load the page
    try:
        from frischid.cli.pages import studio as show

        show_page(show.studio(running.address, path, host), as_json)
        with working(as_json) as progress:
            progress("reading logs")

            loaded = model_of(model)
            data = read(logs, loaded.robot, mapping, progress) if logs else opened_or_own((), loaded, mapping, progress)
            progress("comparing")
            running.show(loaded, data, path)
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        pass
    finally:
        running.stop()
