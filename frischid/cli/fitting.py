"""The commands `info`, `identify` and `compare`: a robot, its model from logs, and the model's error on other logs."""

from __future__ import annotations

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
    torque_joints_option,
    torque_lag_of,
    torque_lag_option,
    valid_option,
    velocity_option,
)
from frischid.cli.controllers import ControllerArguments, controller_options
from frischid.cli.fleets import FleetArguments, run_fleet
from frischid.cli.group import main
from frischid.cli.inputs import load, model_of, names_of, opened
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath, OutputPath
from frischid.errors import InputError, UnknownNameError


@main.command()
@click.argument("robot", type=InputPath(), required=False)
@robot_options
@effects_option
@json_option
def info(robot: str | None, effects: str | None, as_json: bool, **options: Any) -> None:
    """Describe a robot: joints, limits, identifiable parameters.

    ROBOT is a URDF or MJCF file, or the name of a robot of example-robot-data; without ROBOT, these names are listed.
    """
    from frischid.cli.pages import robots as show
    from frischid.regression.regressor import Regressor
    from frischid.regression.structure import structure
    from frischid.robot.urdf_reading import robot_names

    if robot is None:
        show_page(show.robots(list(robot_names())), as_json)
        return
    machine, _ = load(robot, RobotArguments(**options))
    regressor = Regressor(machine, effects_of(effects))
    with working(as_json) as progress:
        progress("base parameters")
        reduction = structure(regressor, machine.joints)
    show_page(show.robot(machine, regressor, reduction), as_json)


@main.command()
@click.argument("robot", type=InputPath())
@click.argument("logs", type=InputPath(), nargs=-1, required=True)
@valid_option
@robot_options
@effects_option
@map_option
@controller_options
@fitted_joints_option
@cutoff_option
@torque_lag_option
@velocity_option
@click.option(
    "--estimator",
    default="wls",
    help="wls (least squares, each joint weighted by its residual), ols (without weights), sensorwise (bounds from the "
    "noise of the sensors), eiv (errors in variables), iv (instrumental variables), output_error (fits the simulated "
    "motion), frisch (a point of the classical Frisch box, the paper's eq. 24), or frisch_squared (least squares in "
    "that box).",
)
@click.option(
    "--horizon",
    type=click.FloatRange(min=0, min_open=True),
    help="With output_error: seconds of a simulated stretch; 1 by default.",
)
@click.option(
    "--prior",
    type=click.Choice(["urdf", "none"]),
    help="Use the URDF's links as a prior (urdf) or not (none). Default: urdf with the estimator wls, else none.",
)
@click.option(
    "--bbrf",
    default="strict",
    help="Bounding-box recursion (BBRF): bounds from many short windows of the logs. strict (the paper's), undo "
    "(leaves out a window that would empty the box), calibrated (widens the box of each window by its sampling error), "
    "or none.",
)
@click.option("--window", type=int, help="Rows in each window of the bounding-box recursion.")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Read the logs in parallel, as those of a fleet: on a Dask scheduler (tcp://host:8786), on this machine's "
    "cores (local), or in one process (none).",
)
@click.option("--force", is_flag=True, help="Identify although the log check found errors.")
@click.option("--parameters", is_flag=True, help="List the parameters with their errors and bounds.")
@click.option("-o", "--output", type=OutputPath(), help="Write the model here (JSON).")
@json_option
def identify(
    robot: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    effects: str | None,
    mapping: MapFiles,
    torque_joints: str | None,
    cutoff: str,
    torque_lag: str,
    velocity: str,
    estimator: str,
    horizon: float | None,
    prior: Literal["urdf", "none"] | None,
    bbrf: str,
    window: int | None,
    scheduler: str | None,
    force: bool,
    parameters: bool,
    output: str | None,
    controller: ControllerArguments,
    as_json: bool,
    **options: Any,
) -> None:
    """Identify a robot's parameters from logs, with bounds.

    Test logs (--valid) give the error on logs that were not fitted. Logs of commanded positions need a --controller.
    """
    if scheduler is not None:
        fitted = estimator != "wls" or horizon or window or bbrf not in {"strict", "none"}
        if valid or fitted or force or parameters or controller != ControllerArguments(None, {}):
            raise InputError(
                "--scheduler sums moments and cannot be combined with --valid, --estimator, --horizon, --bbrf, "
                "--window, --force, --parameters, --controller and the options of a controller; leave these out, or "
                "identify on this machine without --scheduler"
            )
        fleet = FleetArguments(
            effects, mapping, torque_joints, cutoff, velocity, prior or "urdf", output, scheduler, torque_lag=torque_lag
        )
        run_fleet(robot, RobotArguments(**options), logs, fleet, as_json)
        return
    from frischid.cli.pages import fitting as show
    from frischid.forward.output_error import output_error
    from frischid.forward.shooting import OutputErrorOptions
    from frischid.model.identification import identify as run
    from frischid.model.identify_options import ESTIMATORS

    if estimator not in (names := (*ESTIMATORS, "output_error")):
        raise UnknownNameError("estimator", estimator, names)
    simulated = estimator == "output_error"
    if horizon is not None and not simulated:
        raise InputError("--horizon is the length of a simulated motion; give it with --estimator output_error")
    with working(as_json) as progress:
        progress("reading logs")
        machine, data = load(robot, RobotArguments(**options), logs, mapping, whole=False, progress=progress)
        tests = opened(valid, machine, mapping, progress)
        found = run(
            machine,
            data,
            valid=tests,
            effects=None if effects is None else effects_of(effects),
            torque_joints=matching(torque_joints, machine.joints),
            cutoff=cutoff_of(cutoff),
            torque_lag=torque_lag_of(torque_lag),
            velocity=velocity,
            estimator="wls" if simulated else estimator,
            prior=prior,
            recursion=bbrf,
            window=window,
            force=force,
            controller=controller.read(names_of(machine)),
            currents=controller.currents(names_of(machine)),
            progress=progress,
        )
        if simulated:
            chosen = OutputErrorOptions() if horizon is None else OutputErrorOptions(horizon=horizon)
            moved = output_error(found.model, data, valid=tests, options=chosen, progress=progress)
            if output:
                moved.model.save(output)
    if simulated:
        show_page(show.moved(moved, (*tests, *data), output), as_json)
        return
    if output:
        found.model.save(output)
    show_page(show.identification(found, output, whole=parameters), as_json)


@main.command()
@click.argument("model", type=InputPath())
@click.argument("logs", type=InputPath(), nargs=-1, required=True)
@map_option
@torque_joints_option
@click.option("--simulate", is_flag=True, help="Also simulate the motion, and print its error against the horizon.")
@json_option
def compare(
    model: str,
    logs: tuple[str, ...],
    mapping: MapFiles,
    torque_joints: str | None,
    simulate: bool,
    as_json: bool,
) -> None:
    """Compare measured and predicted torque, joint by joint.

    With --simulate, the model also moves under the recorded torque alone, from many moments of the logs. A model with a
    controller follows the recorded commands instead.
    """
    from frischid.cli.pages import comparing as show
    from frischid.forward.motion_error import compare_simulated
    from frischid.model.comparison import compare as run
    from frischid.model.headline import headline

    loaded = model_of(model, torque_joints)
    with working(as_json) as progress:
        progress("reading logs")
        data = opened(logs, loaded.robot, mapping, progress)
        comparison = run(loaded, data, progress=progress)
        error = headline(loaded, data, comparison)
        motion = compare_simulated(loaded, data, progress=progress) if simulate else None
    show_page(show.comparison(comparison, error, motion), as_json)
