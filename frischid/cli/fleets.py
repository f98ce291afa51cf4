"""The command `fleet`: many robots at once, on one machine or on a cluster."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

import click

from frischid.cli.arguments import (
    MapFiles,
    RobotArguments,
    cutoff_of,
    cutoff_option,
    effects_of,
    effects_option,
    fitted_joints_option,
    json_option,
    map_option,
    matching,
    robot_options,
    scheduler_option,
    torque_lag_of,
    torque_lag_option,
    velocity_option,
    workers_option,
)
from frischid.cli.group import main
from frischid.cli.inputs import load
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath, OutputPath, check_found

DIAGNOSED = 20  # robots that are diagnosed by default, those that differ most from the fleet


@main.command()
@click.argument("robot", type=InputPath())
@click.argument("logs", type=InputPath(), nargs=-1, required=True)
@robot_options
@effects_option
@map_option
@fitted_joints_option
@cutoff_option
@torque_lag_option
@velocity_option
@click.option(
    "--prior",
    type=click.Choice(["urdf", "none"]),
    default="urdf",
    show_default=True,
    help="Use the URDF's links as a prior (urdf) or not (none).",
)
@scheduler_option
@workers_option
@click.option("--strict", is_flag=True, help="Stop at a log that cannot be used instead of skipping it.")
@click.option(
    "--diagnosed", default=DIAGNOSED, show_default=True, help="Most robots to diagnose, of those that differ."
)
@click.option("-o", "--output", type=OutputPath(), help="Write the model of the fleet here (JSON).")
@json_option
def fleet(robot: str, logs: tuple[str, ...], as_json: bool, **options: Any) -> None:
    """Identify many equal robots, and find those that differ.

    Robots are identified each alone and all together.

    LOGS are quoted patterns or addresses: 'logs/**/*.parquet', 'logs/{robot}_*.parquet', 's3://bucket/{robot}/*'.
    The name of a log's robot is the text at {robot}; without {robot}, the first folder below the pattern's fixed part;
    without folders, the file's name.
    """
    arguments = FleetArguments(**{field.name: options.pop(field.name) for field in fields(FleetArguments)})
    run_fleet(robot, RobotArguments(**options), logs, arguments, as_json)


@dataclass(frozen=True)
class FleetArguments:
    """The options of `fleet`, as text.

    Attributes
    ----------
    effects, mapping, torque_joints, cutoff, velocity, prior, output, torque_lag
        As for `identify`.
    scheduler : str or None
        Address of a Dask scheduler, ``local`` or ``none``.
    workers : int or None
        Processes of a local cluster.
    strict : bool
        Whether a log that cannot be used stops the work.
    diagnosed : int
        Most robots to diagnose, of those that differ.
    """

    effects: str | None
    mapping: MapFiles
    torque_joints: str | None
    cutoff: str
    velocity: str
    prior: Literal["urdf", "none"]
    output: str | None
    scheduler: str | None
    workers: int | None = None
    strict: bool = False
    diagnosed: int = DIAGNOSED
    torque_lag: str = "auto"


def run_fleet(
    robot: str, options: RobotArguments, logs: tuple[str, ...], arguments: FleetArguments, as_json: bool
) -> None:
    """Identify a fleet and print the result; also the work of `frischid identify --scheduler`."""
    from frischid.cli.pages import fleets as show
    from frischid.core.parallel import workers
    from frischid.fleet.fleet import identify_fleet
    from frischid.fleet.fleet_options import FleetOptions
    from frischid.fleet.log_paths import find_logs
    from frischid.logs.mapping import LogMap

    output = arguments.output
    found = find_logs(logs)
    check_found([path.address for path in found])
    machine, _ = load(robot, options)
    with working(as_json) as progress, workers(arguments.scheduler, arguments.workers) as pool:
        joints = matching(arguments.torque_joints, machine.joints)
        wanted = FleetOptions(
            effects=tuple(effects_of(arguments.effects)),
            torque_joints=None if joints is None else tuple(joints),
            cutoff=cutoff_of(arguments.cutoff),
            torque_lag=torque_lag_of(arguments.torque_lag),
            velocity=arguments.velocity,
            mapping=None if arguments.mapping is None else LogMap.of(arguments.mapping),
            strict=arguments.strict,
            diagnosed=arguments.diagnosed,
            prior=arguments.prior,
        )
        result = identify_fleet(machine, found, wanted, workers=pool, progress=progress)
    if output:
        result.model.save(output)
    show_page(show.fleet(result, output), as_json)
