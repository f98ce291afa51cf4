"""The command line: reads arguments, calls the library, prints. No mathematics.

Every command takes ``--json`` for machines. Heavy imports wait until a command runs, so ``--help`` is quick.
"""

from __future__ import annotations

import fnmatch
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from frischid.errors import FrischidError, InputError, UnknownNameError

if TYPE_CHECKING:
    from frischid.log import Log
    from frischid.robot import Robot


class _Commands(click.Group):
    """Turns frischid's own errors into one line on stderr and exit code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except FrischidError as error:
            click.echo(f"error: {error}", err=True)
            sys.exit(2)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="frischid")
def main() -> None:
    """Identify the dynamic parameters of a robot from its URDF and what was measured on it.

    Try `frischid demo`, then `frischid info ROBOT` with your own URDF or a name such as panda.
    """


def _robot_options(command: Callable[..., Any]) -> Callable[..., Any]:
    options = [
        click.option("--joints", help="Joints that move, comma separated; * and ? match. Others are locked."),
        click.option("--lock", multiple=True, metavar="JOINT[=ANGLE]", help="Hold a joint still, rad (m); repeatable."),
        click.option("--gravity", type=float, nargs=3, default=(0.0, 0.0, -9.81), help="Gravity in the world, m/s²."),
        click.option("--base-rpy", type=float, nargs=3, default=None, help="Roll, pitch, yaw of the base, rad."),
        click.option(
            "--frames",
            default="joint",
            help="Frames of the link parameters: joint, far_end, or JOINT=URDF_FRAME,...",
        ),
        click.option(
            "--known", multiple=True, metavar="NAME=VALUE", help="A rigid parameter known outright; repeatable."
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


_json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON for machines.")
_map_option = click.option("--map", "mapping", type=click.Path(), help="TOML file that explains the log's columns.")
_effects_option = click.option(
    "--effects",
    help="Effects besides the rigid links, for example 'viscous,coulomb(width=0.01),offset@joint1+joint2'.",
)


_situation_option = click.option(
    "--situation",
    type=click.Choice(["auto", "always", "changed"]),
    default="auto",
    help="Was the effect always there, or did the robot change since it was identified?",
)
_valid_option = click.option("--valid", multiple=True, help="Log to measure the error on; repeatable. Never fitted.")


@main.command()
@click.argument("robot", required=False)
@_robot_options
@_effects_option
@_json_option
def info(robot: str | None, effects: str | None, as_json: bool, **options: Any) -> None:
    """What a robot is: joints, limits, and the parameters that can be identified.

    ROBOT is a URDF file or the name of one that example-robot-data ships; without it, the names are listed.
    """
    from frischid import show
    from frischid.identification import structure
    from frischid.regressor import Regressor
    from frischid.robot import robot_names

    if robot is None:
        _print(show.robots(list(robot_names())), as_json)
        return
    machine, _ = _load(robot, options)
    regressor = Regressor(machine, _effects(effects))
    with _working(as_json) as progress:
        progress("base parameters")
        reduction = structure(regressor, machine.joints)
    _print(show.robot(machine, regressor, reduction), as_json)


@main.command()
@click.argument("robot")
@click.argument("logs", nargs=-1, required=True)
@_robot_options
@_map_option
@_json_option
def check(robot: str, logs: tuple[str, ...], mapping: str | None, as_json: bool, **options: Any) -> None:
    """Whether logs can be used with a robot, and what is suspicious in them. Exit code 1 if anything is."""
    from frischid import show
    from frischid.identification import examine

    machine, data = _load(robot, options, logs, mapping)
    findings = examine(machine, data)
    _print(show.check(findings), as_json)
    sys.exit(1 if any(f.warnings for f in findings) else 0)


@main.command()
@click.argument("robot")
@click.argument("logs", nargs=-1, required=True)
@_valid_option
@_robot_options
@_effects_option
@_map_option
@click.option("--torque-joints", help="Joints whose torque is fitted, comma separated; all that have one by default.")
@click.option("--cutoff", default="auto", help="Cut-off of the parallel filter: Hz, auto, or none.")
@click.option("--velocity", type=click.Choice(["auto", "measured", "derived"]), default="auto")
@click.option("--estimator", default="wls", help="wls, ols, frisch (best point of the box), sensorwise, eiv, iv.")
@click.option("--bbrf", default="strict", help="Bounding-box recursion: strict, undo, calibrated, or none.")
@click.option("--window", type=int, help="BBRF window, rows.")
@click.option("-o", "--output", type=click.Path(), help="Write the model here (JSON).")
@_json_option
def identify(
    robot: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    effects: str | None,
    mapping: str | None,
    torque_joints: str | None,
    cutoff: str,
    velocity: str,
    estimator: str,
    bbrf: str,
    window: int | None,
    output: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Identify a robot's parameters from logs: values, bounds, and the error on logs that were not fitted."""
    from frischid import show
    from frischid.identification import identify as run
    from frischid.model import check_writable

    if output:
        check_writable(output)
    with _working(as_json) as progress:
        progress("reading logs")
        machine, data = _load(robot, options, logs, mapping)
        found = run(
            machine,
            data,
            valid=_read(valid, machine, mapping),
            effects=_effects(effects),
            torque_joints=_matching(torque_joints, machine.joints),
            cutoff=_cutoff(cutoff),
            velocity=velocity,
            estimator=estimator,
            recursion=bbrf,
            window=window,
            progress=progress,
        )
    if output:
        found.model.save(output)
    _print(show.identification(found, output), as_json)


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@_map_option
@_json_option
def compare(model: str, logs: tuple[str, ...], mapping: str | None, as_json: bool) -> None:
    """Measured torque against the model's, joint by joint."""
    from frischid import show
    from frischid.comparison import compare as run
    from frischid.model import Model

    loaded = Model.load(model)
    with _working(as_json) as progress:
        progress("comparing")
        comparison = run(loaded, _read(logs, loaded.robot, mapping))
    _print(show.comparison(comparison), as_json)


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@_valid_option
@_map_option
@_situation_option
@click.option("--try", "only", help="Effects to try, comma separated; all by default.")
@_json_option
def diagnose(
    model: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    mapping: str | None,
    situation: Any,
    only: str | None,
    as_json: bool,
) -> None:
    """Which physical effect the model is missing, by held-out evidence."""
    from frischid import show
    from frischid.diagnosis import diagnose as run
    from frischid.model import Model

    loaded = Model.load(model)
    with _working(as_json) as progress:
        progress("reading logs")
        found = run(
            loaded,
            _read(logs, loaded.robot, mapping),
            valid=_read(valid, loaded.robot, mapping),
            situation=situation,
            effects=None if only is None else [x.strip() for x in only.split(",")],
            progress=progress,
        )
    _print(show.diagnosis(found), as_json)


@main.command()
@click.argument("model")
@click.argument("effect")
@click.argument("logs", nargs=-1, required=True)
@click.option("--joints", help="Joints it acts on, comma separated; * and ? match. All by default.")
@_valid_option
@_map_option
@_situation_option
@click.option("-o", "--output", type=click.Path(), required=True, help="Write the new model here (JSON).")
@_json_option
def add(
    model: str,
    effect: str,
    logs: tuple[str, ...],
    joints: str | None,
    valid: tuple[str, ...],
    mapping: str | None,
    situation: Any,
    output: str,
    as_json: bool,
) -> None:
    """Add an effect to a model, refit, and show the error before and after.

    EFFECT is written as for `identify --effects`: stribeck(v_s=0.1)@joint3.
    """
    from frischid import show
    from frischid.effects import parse_effects
    from frischid.improvement import add as run
    from frischid.improvement import searched
    from frischid.model import Model, check_writable

    check_writable(output)
    loaded = Model.load(model)
    names = _matching(joints, loaded.robot.joints)
    with _working(as_json) as progress:
        progress("refitting")
        data, held_out = _read(logs, loaded.robot, mapping), _read(valid, loaded.robot, mapping)
        chosen = parse_effects(effect if names is None or "@" in effect else f"{effect}@{'+'.join(names)}")
        chosen = searched(loaded, chosen, effect, [*data, *held_out], situation)
        step = run(loaded, chosen, data, valid=held_out, situation=situation)
    step.model.save(output)
    _print(show.added(step, output), as_json)


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@_valid_option
@_map_option
@click.option("--most", default=8, show_default=True, help="Most effects to add.")
@click.option("-o", "--output", type=click.Path(), help="Write the final model here (JSON).")
@_json_option
def improve(
    model: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    mapping: str | None,
    most: int,
    output: str | None,
    as_json: bool,
) -> None:
    """Diagnose and add until nothing passes; print how the error falls."""
    from frischid import show
    from frischid.improvement import improve as run
    from frischid.model import Model, check_writable

    if output:
        check_writable(output)
    loaded = Model.load(model)
    with _working(as_json) as progress:
        progress("reading logs")
        data, held_out = _read(logs, loaded.robot, mapping), _read(valid, loaded.robot, mapping)
        steps, last = run(loaded, data, valid=held_out, most=most, progress=progress)
    final = steps[-1].model if steps else loaded
    if output:
        final.save(output)
    _print(show.improvement(steps, last, output), as_json)


@main.command()
@click.argument("model")
@click.option("--undo", is_flag=True, help="Take the last step back.")
@click.option("-o", "--output", type=click.Path(), help="Where to write the model without its last step.")
@_json_option
def history(model: str, undo: bool, output: str | None, as_json: bool) -> None:
    """What was done to a model, step by step; any step can be undone."""
    from frischid import show
    from frischid.improvement import undo as run
    from frischid.model import Model

    loaded = Model.load(model)
    if undo:
        if not output:
            raise InputError("--undo needs -o FILE, the model to write")
        loaded = run(loaded)
        loaded.save(output)
    _print(show.history(loaded), as_json)


@main.command()
@click.argument("robot")
@click.option("-o", "--output", type=click.Path(), required=True, help="Log to write: .parquet, .csv or .npz.")
@click.option("--duration", default=30.0, show_default=True, help="Seconds.")
@click.option("--rate", default=100.0, show_default=True, help="Samples a second.")
@click.option(
    "--points", type=click.Path(), help="Log of points (t, q, v, a) to join by quintics, instead of a random motion."
)
@_robot_options
@_effects_option
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="True value of a parameter; repeatable.")
@click.option("--noise-q", default=0.0, help="Noise of the positions, rad (m).")
@click.option("--noise-v", default=0.0, help="Noise of the velocities.")
@click.option("--noise-a", default=0.0, help="Noise of the accelerations.")
@click.option("--noise-tau", default=0.0, help="Noise of the torques, as a share of each joint's spread.")
@click.option("--quantum", default=0.0, help="Resolution of the encoders, rad (m).")
@click.option("--channels", default="v,a", help="Derivatives the log holds: v,a or v or none.")
@click.option("--seed", default=0, show_default=True, help="Of the motion and the noise.")
@_json_option
def simulate(
    robot: str,
    output: str,
    duration: float,
    rate: float,
    points: str | None,
    effects: str | None,
    values: tuple[str, ...],
    channels: str,
    seed: int,
    as_json: bool,
    **options: Any,
) -> None:
    """Record a log of a simulated robot, with noise, for trying things out."""
    from frischid import show
    from frischid.model import check_writable
    from frischid.readers import read_log, write_log
    from frischid.simulation import Noise
    from frischid.simulation import simulate as run
    from frischid.trajectory import Quintic, random_fourier

    check_writable(output)
    names = {"noise_q": "q", "noise_v": "v", "noise_a": "a", "noise_tau": "tau", "quantum": "quantum"}
    noise = Noise(**{short: options.pop(long) for long, short in names.items()})
    machine, _ = _load(robot, options)
    with _working(as_json) as progress:
        progress("simulating")
        motion: Any = random_fourier(machine, duration, seed=seed)
        if points:
            given = read_log(points, machine.joints).select(machine.joints)
            if given.v is None or given.a is None:
                raise InputError(f"{points}: points to join by quintics need v_<joint> and a_<joint> columns too")
            motion = Quintic(given.t, given.q, given.v, given.a)
        log = run(
            machine,
            motion,
            rate=rate,
            effects=_effects(effects),
            parameters={k: _number(k, v) for k, v in _pairs(values).items()},
            noise=noise,
            channels=_channels(channels),
            seed=seed,
            name=output,
        )
        write_log(log, output)
    _print(show.simulated(log, output, any(vars(noise).values())), as_json)


@main.command()
@click.argument("robot")
@click.option("-o", "--output", type=click.Path(), required=True, help="Where the motion (t, q, v, a) goes.")
@click.option("--duration", default=20.0, show_default=True, help="Seconds.")
@click.option("--rate", default=100.0, show_default=True, help="Samples a second.")
@click.option("--family", default="fourier", show_default=True, help="fourier, bspline, or points (quintics).")
@click.option("--criterion", default="condition", show_default=True, help="condition, d_optimal, or paper (eq. 19).")
@click.option("--limits", default=0.9, show_default=True, help="Share of the URDF's limits to use.")
@click.option("--budget", default=30_000, show_default=True, help="Evaluations of the criterion.")
@click.option("--seed", default=0, show_default=True, help="The same seed gives the same motion.")
@click.option("--picture", type=click.Path(), help="Draw the motion and the falling cost here (HTML).")
@_robot_options
@_effects_option
@_json_option
def excite(
    robot: str,
    output: str,
    duration: float,
    rate: float,
    family: str,
    criterion: str,
    limits: float,
    budget: int,
    seed: int,
    picture: str | None,
    effects: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Plan a motion that tells the parameters apart, within the robot's limits everywhere."""
    from frischid import show
    from frischid.excitation import plan
    from frischid.model import check_writable

    for path in filter(None, (output, picture)):
        check_writable(path)
    if budget < 1:
        raise InputError(f"--budget must be at least one evaluation, got {budget}")
    machine, _ = _load(robot, options)
    with _working(as_json) as progress:
        planned = plan(
            machine,
            _effects(effects),
            duration=duration,
            family=family,
            criterion=criterion,
            envelope=limits,
            budget=budget,
            seed=seed,
            progress=lambda share, best: progress(f"planning: {share:.0%} of the budget, {criterion} {best:.4g}"),
        )
    planned.save(output, rate)
    if picture:
        from frischid import figures

        figures.save(figures.excitation(planned), picture)
    _print(show.excitation(planned, output, picture), as_json)


@main.command()
@click.argument("name", required=False)
@_json_option
def effects(name: str | None, as_json: bool) -> None:
    """The catalogue of physical effects, or the page of one of them."""
    from frischid import show
    from frischid.effects import EFFECTS

    if name is not None and name not in EFFECTS:
        raise UnknownNameError("effect", name, EFFECTS)
    _print(show.catalogue() if name is None else show.effect(EFFECTS[name]), as_json)


@main.command()
@click.option("--seed", default=0, show_default=True, help="Of the motions and the noise.")
@click.option("-o", "--output", type=click.Path(), help="Write the model here (JSON).")
@_json_option
def demo(seed: int, output: str | None, as_json: bool) -> None:
    """The whole job on a simulated planar arm: simulate, identify, compare with the truth."""
    from frischid import show
    from frischid.demo import run
    from frischid.model import check_writable

    if output:
        check_writable(output)
    with _working(as_json) as progress:
        result = run(seed, progress)
    if output:
        result.found.model.save(output)
    _print(show.demo(result, output), as_json)


# ---------------------------------------------------------------------- arguments


def _load(
    robot: str, options: dict[str, Any], paths: Sequence[str] = (), mapping: str | None = None
) -> tuple[Robot, list[Log]]:
    """The robot as the options want it, and its logs; a joint locked without an angle: its median in the log."""
    from statistics import median

    from frischid.robot import Robot

    whole = Robot.load(robot)
    logs = _read(paths, whole, mapping)
    locks: dict[str, float] = {}
    for item in options["lock"]:
        pattern, given, angle = item.partition("=")
        for joint in _matching(pattern, whole.joints) or []:
            locks[joint] = _number(joint, angle) if given else float("nan")
    joints = _matching(options["joints"], whole.joints)
    if joints is not None:
        locks |= {j: float("nan") for j in whole.joints if j not in joints and j not in locks}
    for joint in [j for j, x in locks.items() if x != x and logs and j in logs[0].joints]:
        locks[joint] = median(logs[0].select([joint]).q[:, 0].tolist())
    frames = options["frames"]
    machine = Robot.load(
        robot,
        lock=locks,
        gravity=options["gravity"],
        base_rpy=options["base_rpy"],
        frames=_pairs(frames.split(",")) if "=" in frames else frames,
        known={k: _number(k, v) for k, v in _pairs(options["known"]).items()},
    )
    return machine, logs


def _matching(text: str | None, valid: Sequence[str]) -> list[str] | None:
    """Names in a comma separated list of names and patterns."""
    if text is None:
        return None
    found: list[str] = []
    for pattern in filter(None, (p.strip() for p in text.split(","))):
        names = fnmatch.filter(valid, pattern)
        if not names:
            raise UnknownNameError("joint", pattern, valid)
        found += [n for n in names if n not in found]
    return found


def _pairs(items: Sequence[str]) -> dict[str, str]:
    pairs = {}
    for item in items:
        name, given, value = item.partition("=")
        if not (name and given and value):
            raise InputError(f"'{item}' should be NAME=VALUE")
        pairs[name.strip()] = value.strip()
    return pairs


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: '{text}' is not a number") from None


def _cutoff(text: str) -> Any:
    return {"auto": "auto", "none": None}.get(text) if text in {"auto", "none"} else _number("--cutoff", text)


def _channels(text: str) -> list[str]:
    channels = [] if text == "none" else [c.strip() for c in text.split(",")]
    for channel in channels:
        if channel not in {"v", "a"}:
            raise UnknownNameError("channel", channel, ["v", "a", "none"])
    return channels


def _effects(text: str | None) -> Any:
    from frischid.effects import BASELINE, parse_effects

    return BASELINE if text is None else parse_effects(text)


def _read(paths: Sequence[str], robot: Robot, mapping: str | None) -> list[Log]:
    from frischid.mapping import LogMap
    from frischid.readers import read_log

    # A mapping may name joints that are locked in this robot; they are read and then not used.
    form = LogMap.of(mapping)
    return [read_log(path, (*robot.joints, *robot.locked), form) for path in paths]


# ---------------------------------------------------------------------- output


@contextmanager
def _working(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show what is being done while it lasts, on stderr, when a person is watching."""
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("working") as status:
        yield lambda text: status.update(text)


def _print(page: Any, as_json: bool) -> None:
    """Print a page: ``.data`` for machines, ``.parts`` for people."""
    if as_json:
        click.echo(json.dumps(page.data, indent=1, ensure_ascii=False, allow_nan=False))
        return
    from rich.console import Console

    # A pipe has no width of its own; tables cut at 80 columns would lose what they are for.
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    for part in page.parts:
        console.print(part)
