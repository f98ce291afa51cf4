"""Options that commands share, how their text is read, and how results are printed."""

from __future__ import annotations

import fnmatch
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from frischid.errors import InputError, UnknownNameError

IN_MEMORY = 32 * 2**20
"""Size of all files together, in bytes, up to which they are read as a whole."""

if TYPE_CHECKING:
    from frischid.core.parallel import Workers
    from frischid.logs.log import Log
    from frischid.robot.robot import Robot


def robot_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options that say what robot is meant."""
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


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON for machines.")
map_option = click.option("--map", "mapping", type=click.Path(), help="TOML file that explains the log's columns.")
effects_option = click.option(
    "--effects",
    help="Effects besides the rigid links, for example 'viscous,coulomb(width=0.01),offset@joint1+joint2'.",
)


situation_option = click.option(
    "--situation",
    type=click.Choice(["auto", "always", "changed"]),
    default="auto",
    help="Was the effect always there, or did the robot change since it was identified?",
)
scheduler_option = click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Where to work: the address of a Dask scheduler (tcp://host:8786), local (this machine's cores), or none.",
)
workers_option = click.option(
    "--workers", type=click.IntRange(min=1), help="Processes of a local cluster, one a core by default."
)
valid_option = click.option("--valid", multiple=True, help="Log to measure the error on; repeatable. Never fitted.")


# ---------------------------------------------------------------------- arguments


def load(
    robot: str, options: dict[str, Any], paths: Sequence[str] = (), mapping: str | None = None, *, whole: bool = True
) -> tuple[Robot, list[Any]]:
    """The robot as the options want it, and its logs; a joint locked without an angle: its median in the log.

    Not `whole`: logs that are long together come as recordings.
    """
    from statistics import median

    from frischid.logs.recording import chunks_of
    from frischid.robot.robot import Robot

    nominal = Robot.load(robot)
    logs = (read if whole else opened)(paths, nominal, mapping)
    locks: dict[str, float] = {}
    for item in options["lock"]:
        pattern, given, angle = item.partition("=")
        for joint in matching(pattern, nominal.joints) or []:
            locks[joint] = number(joint, angle) if given else float("nan")
    joints = matching(options["joints"], nominal.joints)
    if joints is not None:
        locks |= {j: float("nan") for j in nominal.joints if j not in joints and j not in locks}
    free = [joint for joint, angle in locks.items() if angle != angle]
    first = next(chunks_of(logs[0])) if logs and free else None
    for joint in free:
        if first is not None and joint in first.joints:
            locks[joint] = median(first.select([joint]).q[:, 0].tolist())
    frames = options["frames"]
    machine = Robot.load(
        robot,
        lock=locks,
        gravity=options["gravity"],
        base_rpy=options["base_rpy"],
        frames=pairs(frames.split(",")) if "=" in frames else frames,
        known={k: number(k, v) for k, v in pairs(options["known"]).items()},
    )
    return machine, logs


def matching(text: str | None, valid: Sequence[str]) -> list[str] | None:
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


def pairs(items: Sequence[str]) -> dict[str, str]:
    """NAME=VALUE pairs."""
    found = {}
    for item in items:
        name, given, value = item.partition("=")
        if not (name and given and value):
            raise InputError(f"'{item}' should be NAME=VALUE")
        found[name.strip()] = value.strip()
    return found


def number(name: str, text: str) -> float:
    """A number, or an error that names the option."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: '{text}' is not a number") from None


def cutoff_of(text: str) -> Any:
    """Cut-off frequency in Hz, ``auto``, or none."""
    return {"auto": "auto", "none": None}.get(text) if text in {"auto", "none"} else number("--cutoff", text)


def channels_of(text: str) -> list[str]:
    """Names of derivative channels."""
    channels = [] if text == "none" else [c.strip() for c in text.split(",")]
    for channel in channels:
        if channel not in {"v", "a"}:
            raise UnknownNameError("channel", channel, ["v", "a", "none"])
    return channels


def effects_of(text: str | None) -> Any:
    """Effects as written by the user; the baseline when nothing is said."""
    from frischid.effects import BASELINE, parse_effects

    return BASELINE if text is None else parse_effects(text)


def read(paths: Sequence[str], robot: Robot, mapping: str | None) -> list[Log]:
    """Logs of a robot, through a mapping when there is one."""
    from frischid.logs.mapping import LogMap
    from frischid.logs.readers import read_log

    # A mapping may name joints that are locked in this robot; they are read and then not used.
    form = LogMap.of(mapping)
    return [read_log(path, (*robot.joints, *robot.locked), form) for path in paths]


def opened(paths: Sequence[str], robot: Robot, mapping: str | None) -> list[Any]:
    """Logs of a robot, in memory where they are small together, otherwise as recordings that are read in pieces."""
    from frischid.logs.mapping import LogMap
    from frischid.logs.recording import Recording

    sizes = [path.stat().st_size for path in map(Path, paths) if path.is_file()]
    if len(sizes) == len(paths) and sum(sizes) <= IN_MEMORY:
        return list(read(paths, robot, mapping))
    form = LogMap.of(mapping)
    return [Recording.open(path, (*robot.joints, *robot.locked), form) for path in paths]


# ---------------------------------------------------------------------- output


@contextmanager
def working(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show what is being done while it lasts, on stderr, when a person is watching."""
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("working") as status:
        yield lambda text: status.update(text)


@contextmanager
def elsewhere(scheduler: str | None, count: int | None) -> Iterator[Workers | None]:
    """Where to work if the user says so; otherwise None, which is this process."""
    if scheduler is None and count is None:
        yield None
        return
    from frischid.core.parallel import workers

    with workers(scheduler, count) as pool:
        yield pool


def show_page(page: Any, as_json: bool) -> None:
    """Print a page: ``.data`` for machines, ``.parts`` for people."""
    if as_json:
        click.echo(json.dumps(page.data, indent=1, ensure_ascii=False, allow_nan=False))
        return
    from rich.console import Console

    # A pipe has no width of its own; tables cut at 80 columns would lose what they are for.
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    for part in page.parts:
        console.print(part)
