"""The command `payload`: the body that a robot carries."""

from __future__ import annotations

import json
from pathlib import Path

import click

from frischid.cli.arguments import MapFiles, json_option, map_option, torque_joints_option
from frischid.cli.group import main
from frischid.cli.inputs import model_of, opened
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath, OutputPath
from frischid.errors import NoBodyError


@main.command()
@click.argument("model", type=InputPath())
@click.argument("logs", type=InputPath(), nargs=-1, required=True)
@click.option("--frame", help="Frame of the URDF in which the result is given; the flange by default.")
@click.option("--carrier", help="Joint whose link carries the body; the last by default.")
@map_option
@torque_joints_option
@click.option("-o", "--output", type=OutputPath(), help="Write the body here (JSON).")
@json_option
def payload(
    model: str,
    logs: tuple[str, ...],
    frame: str | None,
    carrier: str | None,
    mapping: MapFiles,
    torque_joints: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Identify the body that the robot carries.

    The result is the mass, centre of mass and inertia of the body, with bounds. MODEL is the model of the robot without
    the body; LOGS are recorded with the body. Exit code 1: the logs show no body, and no file is written.
    """
    from frischid.cli.pages import carrying as show
    from frischid.core.files import write_text
    from frischid.model.payload_identification import payload as run

    loaded = model_of(model, torque_joints)
    with working(as_json) as progress:
        progress("payload")
        try:
            found = run(loaded, opened(logs, loaded.robot, mapping, progress), frame=frame, carrier=carrier)
        except NoBodyError as none:
            nothing: NoBodyError | None = none
        else:
            nothing = None
    if nothing is not None:
        show_page(show.no_body(nothing, output), as_json)
        return
    if output:
        write_text(Path(output), json.dumps(found.to_dict(), indent=1) + "\n")
    show_page(show.payload(found, output), as_json)
