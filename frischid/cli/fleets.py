"""Many robots at once, on one machine or on a cluster."""

from __future__ import annotations

from typing import Any

import click

from frischid.cli.arguments import (
    cutoff_of,
    effects_of,
    effects_option,
    json_option,
    load,
    map_option,
    matching,
    robot_options,
    scheduler_option,
    show_page,
    workers_option,
    working,
)
from frischid.cli.group import main


@main.command()
@click.argument("robot")
@click.argument("logs", nargs=-1, required=True)
@robot_options
@effects_option
@map_option
@click.option("--torque-joints", help="Joints whose torque is fitted, comma separated; all that have one by default.")
@click.option("--cutoff", default="auto", help="Cut-off of the parallel filter: Hz, auto, or none.")
@click.option("--velocity", type=click.Choice(["auto", "measured", "derived"]), default="auto")
@scheduler_option
@workers_option
@click.option("--strict", is_flag=True, help="Stop at a log that cannot be used instead of skipping it.")
@click.option("--diagnosed", default=20, show_default=True, help="Of the robots that differ, how many to diagnose.")
@click.option("-o", "--output", type=click.Path(), help="Write the model of the fleet here (JSON).")
@json_option
def fleet(
    robot: str,
    logs: tuple[str, ...],
    effects: str | None,
    mapping: str | None,
    torque_joints: str | None,
    cutoff: str,
    velocity: str,
    scheduler: str | None,
    workers: int | None,
    strict: bool,
    diagnosed: int,
    output: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Identify many equal robots: each alone, all together, and which differ from the others.

    LOGS are quoted patterns or addresses: 'logs/**/*.parquet', 'logs/{robot}_*.parquet', 's3://bucket/{robot}/*'.
    A robot is what {robot} stands for, else the first folder below the pattern's fixed part, else the file.
    """
    arguments: dict[str, Any] = {
        "effects": effects,
        "mapping": mapping,
        "torque_joints": torque_joints,
        "cutoff": cutoff,
        "velocity": velocity,
        "strict": strict,
        "diagnosed": diagnosed,
        "output": output,
    }
    run_fleet(robot, logs, scheduler, workers, as_json, options, arguments)


def run_fleet(
    robot: str,
    logs: tuple[str, ...],
    scheduler: str | None,
    count: int | None,
    as_json: bool,
    options: dict[str, Any],
    arguments: dict[str, Any],
) -> None:
    """Identify a fleet and print what was found; also what `frischid identify --scheduler` does."""
    from frischid.cli.pages import fleets as show
    from frischid.core.files import check_writable
    from frischid.core.parallel import workers
    from frischid.fleet.fleet import FleetOptions, identify_fleet
    from frischid.fleet.log_paths import find_logs
    from frischid.logs.mapping import LogMap

    output = arguments["output"]
    if output:
        check_writable(output)
    found = find_logs(logs)
    machine, _ = load(robot, options)
    mapping = arguments["mapping"]
    with working(as_json) as progress, workers(scheduler, count) as pool:
        joints = matching(arguments["torque_joints"], machine.joints)
        wanted = FleetOptions(
            effects=tuple(effects_of(arguments["effects"])),
            torque_joints=None if joints is None else tuple(joints),
            cutoff=cutoff_of(arguments["cutoff"]),
            velocity=arguments["velocity"],
            mapping=None if mapping is None else LogMap.of(mapping),
            strict=arguments["strict"],
            diagnosed=arguments["diagnosed"],
        )
        result = identify_fleet(machine, found, wanted, workers=pool, progress=progress)
    if output:
        result.model.save(output)
    show_page(show.fleet(result, output), as_json)
