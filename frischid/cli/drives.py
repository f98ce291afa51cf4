"""The command `gains`: drive gains, the torque of a joint per ampere or per position error."""

from __future__ import annotations

from typing import Any

import click

from frischid.cli.arguments import (
    MapFiles,
    RobotArguments,
    cutoff_of,
    cutoff_option,
    effects_of,
    effects_option,
    json_option,
    map_option,
    robot_options,
)
from frischid.cli.controllers import ControllerArguments, controller_options
from frischid.cli.group import main
from frischid.cli.inputs import load, names_of, read
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath


@main.command()
@click.argument("robot", type=InputPath())
@click.option("--unloaded", multiple=True, type=InputPath(), required=True, help="Log without the payload; repeatable.")
@click.option("--loaded", multiple=True, type=InputPath(), required=True, help="Log with the payload; repeatable.")
@click.option("--payload", type=float, required=True, help="Mass of the payload, kg.")
@click.option(
    "--com",
    type=float,
    nargs=3,
    metavar="X Y Z",
    help="Payload's centre of mass in the carrying joint's frame, m, if known.",
)
@click.option("--carrier", help="Joint whose link carries the payload; the last by default.")
@cutoff_option
@robot_options
@effects_option
@map_option
@controller_options
@json_option
def gains(
    robot: str,
    unloaded: tuple[str, ...],
    loaded: tuple[str, ...],
    payload: float,
    com: tuple[float, float, float] | None,
    carrier: str | None,
    cutoff: str,
    effects: str | None,
    mapping: MapFiles,
    controller: ControllerArguments,
    as_json: bool,
    **options: Any,
) -> None:
    """Find drive gains from logs with and without a known payload.

    Gains given in the mapping file are checked. With --controller pd, the logs
    have commanded positions, and the gains are kp; a --kp of all joints is
    checked.
    """
    from frischid.cli.pages import drives as show
    from frischid.export.drive_gain_problem import KnownPayload
    from frischid.export.drive_gains import find_gains
    from frischid.logs.mapping import LogMap

    form = LogMap.of(mapping)
    given = {n: j.current_gain for n, j in form.joint.items() if j.current_gain is not None}
    with working(as_json) as progress:
        progress("reading logs")
        machine, without = load(robot, RobotArguments(**options), unloaded, mapping, progress=progress)
        named = controller.currents(names_of(machine))
        given |= {} if named is None else named.gain
        carrying = read(loaded, machine, mapping, progress)
        progress("drive gains")
        found = find_gains(
            machine,
            without,
            carrying,
            KnownPayload(payload, com, carrier),
            given={n: given[n] for n in machine.joints if n in given} or None,
            effects=effects_of(effects),
            cutoff=cutoff_of(cutoff),
            controller=controller.read(names_of(machine)),
        )
    show_page(show.gains(found), as_json)
