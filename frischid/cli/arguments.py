"""Options that several commands share, and functions that read their text."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import click

from frischid.cli.paths import InputPath
from frischid.errors import InputError, UnknownNameError


@dataclass(frozen=True)
class RobotArguments:
    """The options of `robot_options`, as text."""

    joints: str | None
    """Joints that move, as a list of names and patterns."""
    lock: tuple[str, ...]
    """``JOINT`` or ``JOINT=ANGLE``."""
    gravity: tuple[float, float, float] | None
    """In the world, m/s²; None: as the robot's file says."""
    base_rpy: tuple[float, float, float] | None
    """Roll, pitch and yaw of the base, rad."""
    frames: str
    """Frames of the link parameters."""
    known: tuple[str, ...]
    """``NAME=VALUE``."""


def robot_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options that describe the robot."""
    options = [
        click.option("--joints", help="Joints that move, comma separated; * and ? match. Others are locked."),
        click.option(
            "--lock", multiple=True, metavar="JOINT[=ANGLE]", help="Lock a joint at an angle, rad (m); repeatable."
        ),
        click.option(
            "--gravity",
            type=float,
            nargs=3,
            metavar="X Y Z",
            default=None,
            help="Gravity in the world, m/s². [default: that of an MJCF file, else 0 0 -9.81]",
        ),
        click.option(
            "--base-rpy", type=float, nargs=3, metavar="R P Y", default=None, help="Roll, pitch, yaw of the base, rad."
        ),
        click.option(
            "--frames",
            default="joint",
            help="Frames of the link parameters: joint, far_end, or JOINT=URDF_FRAME,...",
        ),
        click.option(
            "--known", multiple=True, metavar="NAME=VALUE", help="A known rigid parameter, not fitted; repeatable."
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


def logs_argument(metavar: str = "[LOGS]...") -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Logs to show a model with; without one, `frischid.cli.inputs.opened_or_own` takes the model's own."""
    return click.argument("logs", type=InputPath(), nargs=-1, metavar=metavar)


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON for machines.")
MapFiles = str | tuple[str, ...] | None
"""Mapping files of ``--map``: none, one for all logs, or several, of which the one that fits a log is used."""


def torque_joints_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The option that names the joints whose torque is judged, as ``torque_joints``."""
    said = "Joints whose torque is judged, comma separated, * and ? match; all by default. The others only move."
    return click.option("--torque-joints", help=said)(command)


fitted_joints_option = click.option(
    "--torque-joints", help="Joints whose torque is fitted, comma separated; all that have one by default."
)
velocity_option = click.option(
    "--velocity",
    type=click.Choice(["auto", "measured", "derived"]),
    default="auto",
    help="Velocities as measured, or derived from the positions; auto: measured ones if they agree with the positions.",
)
torque_lag_option = click.option(
    "--torque-lag",
    default="auto",
    help="Time by which the recorded torque is late: s, none, or auto. auto estimates the lag, and corrects it up to "
    "1.5 samples where the cross-validated error falls.",
)
cutoff_option = click.option(
    "--cutoff", default="auto", help="Cut-off of the low-pass filter of torque and regressor: Hz, auto, or none."
)


def _map_files(_: click.Context, __: click.Parameter, given: tuple[str, ...]) -> MapFiles:
    return given if len(given) > 1 else (given or (None,))[0]


map_option = click.option(
    "--map",
    "mapping",
    type=InputPath(),
    multiple=True,
    callback=_map_files,
    help="Mapping file (TOML): the meaning of the logs' columns; repeatable, each log takes the one that fits.",
)
effects_option = click.option(
    "--effects",
    help="Effects besides the rigid links, for example 'viscous,coulomb(width=0.01),offset@joint2'.",
)


situation_option = click.option(
    "--situation",
    type=click.Choice(["auto", "always", "changed"]),
    default="auto",
    help="always: the robot has not changed since it was identified; changed: it has; auto: decided from the logs.",
)
scheduler_option = click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Compute on a Dask scheduler (tcp://host:8786), on this machine's cores (local), or in one process (none).",
)
workers_option = click.option(
    "--workers", type=click.IntRange(min=1), help="Processes of a local cluster, one per core by default."
)
valid_option = click.option(
    "--valid",
    multiple=True,
    type=InputPath(),
    help="Test log: the model's error on this log is printed, and decides nothing; repeatable.",
)


def matching(text: str | None, valid: Sequence[str]) -> list[str] | None:
    """Valid names that match a comma separated list of names and patterns."""
    if text is None:
        return None
    found: list[str] = []
    for pattern in filter(None, (p.strip() for p in text.split(","))):
        names = [pattern] if pattern in valid else fnmatch.filter(valid, pattern)
        if not names:
            raise UnknownNameError("joint", pattern, valid)
        found += [n for n in names if n not in found]
    if not found:
        raise InputError(f"'{text}' names no joint; the joints are {', '.join(valid)}")
    return found


def pairs(items: Sequence[str]) -> dict[str, str]:
    """NAME=VALUE pairs, each name once."""
    found: dict[str, str] = {}
    for item in items:
        name, given, value = (part.strip() for part in item.partition("="))
        if not (name and given and value):
            raise InputError(f"'{item}' must have the form NAME=VALUE")
        if found.setdefault(name, value) != value:
            raise InputError(f"{name} has two values, {found[name]} and {value}; name it once")
    return found


def number(name: str, text: str, unless: str = "") -> float:
    """A number, or an error that names the option; `unless` says what else the option takes."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: '{text}' is not a number{unless}") from None


def angle_of(joint: str, text: str) -> float:
    """Angle at which a joint is locked: a finite number, or an error that names the option."""
    if not math.isfinite(angle := number(f"--lock {joint}", text)):
        raise InputError(f"--lock {joint}={text}: the angle must be a finite number of rad (m)")
    return angle


def cutoff_of(text: str) -> Any:
    """Cut-off frequency in Hz, ``auto``, or none."""
    if text in {"auto", "none"}:
        return {"auto": "auto", "none": None}[text]
    return number("--cutoff", text, " of Hz, nor auto or none")


def torque_lag_of(text: str) -> Any:
    """Lag of the torque in s, ``auto``, or zero for none."""
    if text in {"auto", "none"}:
        return {"auto": "auto", "none": 0.0}[text]
    return number("--torque-lag", text, " of seconds, nor auto or none")


def channels_of(text: str) -> list[str]:
    """Names of derivative channels."""
    channels = [] if text == "none" else [c.strip() for c in text.split(",")]
    for channel in channels:
        if channel not in {"v", "a"}:
            raise UnknownNameError("channel", channel, ["v", "a", "none"])
    return channels


def effects_of(text: str | None) -> Any:
    """Effects as the user wrote them; the baseline when the option is not given."""
    from frischid.effects import BASELINE, parse_effects

    return BASELINE if text is None else parse_effects(text, complete=True)
