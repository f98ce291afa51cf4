"""The commands `simulate` and `excite`: logs of simulated robots, and motions to run on real robots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from frischid.cli.arguments import (
    RobotArguments,
    channels_of,
    effects_of,
    effects_option,
    json_option,
    number,
    pairs,
    robot_options,
    scheduler_option,
    workers_option,
)
from frischid.cli.group import main
from frischid.cli.inputs import load
from frischid.cli.output import elsewhere, show_page, working
from frischid.cli.paths import InputPath, OutputPath
from frischid.errors import InputError

if TYPE_CHECKING:
    from frischid.effects import Effect


@main.command()
@click.argument("robot", type=InputPath())
@click.option("-o", "--output", type=OutputPath(), required=True, help="Log to write: .parquet, .csv or .npz.")
@click.option("--duration", type=float, help="Seconds of a random motion; 30 by default.")
@click.option("--rate", default=100.0, show_default=True, help="Samples per second.")
@click.option(
    "--points",
    type=InputPath(),
    help="File of ten or more points (t, q, v, a) to join by quintics, instead of a random motion.",
)
@robot_options
@effects_option
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="True value of a parameter; repeatable.")
@click.option("--noise-q", default=0.0, help="Noise of the positions, rad (m).")
@click.option("--noise-v", default=0.0, help="Noise of the velocities, rad/s (m/s).")
@click.option("--noise-a", default=0.0, help="Noise of the accelerations, rad/s² (m/s²).")
@click.option("--noise-tau", default=0.0, help="Noise of the torques, as a share of each joint's standard deviation.")
@click.option("--quantum", default=0.0, help="Resolution of the encoders, rad (m).")
@click.option("--channels", default="v,a", help="Derivatives in the log: v,a or v or none.")
@click.option("--seed", default=0, show_default=True, help="Seed of the motion and the noise.")
@json_option
def simulate(
    robot: str,
    output: str,
    duration: float | None,
    rate: float,
    points: str | None,
    effects: str | None,
    values: tuple[str, ...],
    channels: str,
    seed: int,
    as_json: bool,
    **options: Any,
) -> None:
    """Write a log of a simulated robot, with noise if wanted."""
    from frischid.cli.pages import motions as show
    from frischid.logs.readers import read_log, write_log
    from frischid.motions.simulation import Noise
    from frischid.motions.simulation import simulate as run
    from frischid.motions.trajectory import Quintic, random_fourier

    names = {"noise_q": "q", "noise_v": "v", "noise_a": "a", "noise_tau": "tau", "quantum": "quantum"}
    noise = Noise(**{short: options.pop(long) for long, short in names.items()})
    machine, _ = load(robot, RobotArguments(**options))
    with working(as_json) as progress:
        progress("simulating")
        if points is None:
            motion: Any = random_fourier(machine, 30.0 if duration is None else duration, seed=seed)
        else:
            if duration is not None:
                raise InputError(f"--duration {duration:g}: the points of {points} have their own times; leave it out")
            given = read_log(points, machine.joints).select(machine.joints)
            if given.v is None or given.a is None:
                raise InputError(f"{points}: points to join by quintics need v_<joint> and a_<joint> columns too")
            motion = Quintic(given.t, given.q, given.v, given.a)
        log = run(
            machine,
            motion,
            rate=rate,
            effects=effects_of(effects),
            parameters={k: number(k, v) for k, v in pairs(values).items()},
            noise=noise,
            channels=channels_of(channels),
            seed=seed,
            name=output,
        )
        write_log(log, output)
    show_page(show.simulated(log, output, any(vars(noise).values())), as_json)


@main.command()
@click.argument("robot", type=InputPath())
@click.option(
    "-o",
    "--output",
    type=OutputPath(),
    required=True,
    help="Motion: .csv, .parquet or .npz (t, q, v, a), .yaml (ROS JointTrajectory) or .script (URScript).",
)
@click.option(
    "--home", help="Pose before and after the motion, rad (m): one number per joint, comma separated; or zero."
)
@click.option("--duration", default=20.0, show_default=True, help="Seconds.")
@click.option("--rate", default=100.0, show_default=True, help="Samples per second.")
@click.option(
    "--repeat",
    default=1,
    show_default=True,
    help="Number of runs of the motion; from the differences between runs, diagnose measures the noise.",
)
@click.option(
    "--family",
    help="fourier (default), bspline, points (quintics), chirps (default with --drives), steps, or steps+chirps.",
)
@click.option(
    "--criterion",
    help="What the search makes small: condition (default; condition number of the "
    "regressor), d_optimal (volume of the parameters' uncertainty), or paper (the paper's cost, eq. 19).",
)
@click.option("--limits", default=0.9, show_default=True, help="Share of the URDF's limits to use.")
@click.option(
    "--floor", default="0", show_default=True, help="Height of the floor above the base, m; none: the base hangs."
)
@click.option(
    "--budget",
    default=30_000,
    show_default=True,
    help="Evaluations of the criterion after which a search ends; its first steps, about 70, are always made.",
)
@click.option("--seed", default=0, show_default=True, help="The same seed gives the same motion.")
@click.option("--starts", default=1, show_default=True, help="Searches from different starts; the best is kept.")
@scheduler_option
@workers_option
@click.option(
    "--picture", type=OutputPath(), help="Draw the moving robot, its curves and the falling cost here (HTML)."
)
@click.option(
    "--separate",
    metavar="A,B",
    help="Plan for these two effects: estimate both well, e.g. stribeck@joint2,hysteresis@joint2.",
)
@click.option(
    "--drives",
    is_flag=True,
    help="Plan commands for position drives: estimate armature, friction, delay and gains well.",
)
@robot_options
@effects_option
@json_option
def excite(
    robot: str,
    output: str,
    home: str | None,
    duration: float,
    rate: float,
    repeat: int,
    family: str | None,
    criterion: str | None,
    limits: float,
    floor: str,
    budget: int,
    seed: int,
    starts: int,
    scheduler: str | None,
    workers: int | None,
    picture: str | None,
    separate: str | None,
    drives: bool,
    effects: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Plan a motion that determines all parameters well.

    The motion keeps the limits of position, speed, acceleration and torque at all times. Bodies with collision shapes
    touch neither one another nor the floor, which is at the height of the base (--floor); other obstacles are not
    known. With --home, the way to the motion and the way back keep the same limits. With --drives, the command plans
    position commands for a robot without a torque sensor: chirps (or steps) of every joint, with the amplitudes that
    determine the drives best.
    """
    from frischid.cli.pages import motions as show
    from frischid.model.drive_excitation import DRIVES_FAMILY, plan_for_drives
    from frischid.motions.chirps import check_command_rate
    from frischid.motions.collision import Clearance
    from frischid.motions.discrimination import separate as plan_separation
    from frischid.motions.families import check_return
    from frischid.motions.limits import MotionLimits
    from frischid.motions.motion_request import check_rate, check_runs
    from frischid.motions.plan import plan
    from frischid.motions.plan_options import PlanOptions
    from frischid.motions.programme import checked_home, programme
    from frischid.motions.programme_files import check_file, save

    if budget < 1:
        raise InputError(f"--budget must be at least one evaluation, got {budget}")
    check_rate(rate, duration)
    check_runs(repeat)
    if drives and (separate or criterion):
        other = "--separate" if separate else "--criterion"
        raise InputError(f"--drives plans for the drives' parameters and {other} for other ones; give one of the two")
    family = family or (DRIVES_FAMILY if drives else "fourier")
    check_return(family, repeat)
    machine, _ = load(robot, RobotArguments(**options))
    check_file(output, machine.joints, rate)
    pose = None if home is None else checked_home(machine, home_of(home, len(machine.joints))).tolist()
    pair = () if separate is None else two_effects(separate)
    wanted = PlanOptions(
        duration=duration,
        family=family,
        criterion=criterion or "condition",
        limits=limits,
        budget=budget,
        seed=seed,
        starts=starts,
        clearance=Clearance.of(machine, floor=None if floor == "none" else number("--floor", floor)),
    ).within(MotionLimits.of(machine, limits))
    check_command_rate(family, wanted.highest or 0.0, rate)
    apart = narrower = None
    with working(as_json) as progress, elsewhere(scheduler, workers) as pool:
        told: dict[str, Any] = {
            "workers": pool,
            "progress": lambda share, best: progress(f"planning: {share:.0%} of the budget, cost {best:.4g}"),
        }
        if pair:
            apart = plan_separation(machine, pair[0], pair[1], effects_of(effects), wanted, **told)
            planned = apart.plan
        elif drives:
            found = plan_for_drives(machine, wanted, effects_of(effects), **told)
            planned, narrower = found.plan, found.narrower
        else:
            planned = plan(machine, effects_of(effects), wanted, **told)
        motion = programme(machine, planned, pose, limits, repeat, wanted.clearance)
    save(motion, output, rate)
    if picture:
        from frischid import figures

        figures.save(picture, figures.animated(planned, machine), figures.excitation(planned))
    show_page(show.excitation(planned, motion, output, picture, apart or narrower), as_json)


def two_effects(text: str) -> tuple[Effect, ...]:
    """The two effects of ``--separate``."""
    from frischid.effects import parse_effects

    pair = parse_effects(text, complete=True)
    if len(pair) != 2:
        raise InputError(f"--separate '{text}' must name two effects, for example stribeck@joint2,hysteresis@joint2")
    return pair


def home_of(text: str, count: int) -> list[float]:
    """The pose of ``--home``: comma separated numbers, or ``zero``."""
    return [0.0] * count if text.strip() == "zero" else [number("--home", x) for x in text.split(",")]
