"""Options that name the controller of a log of commands, and the controller that they describe."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from frischid.cli.arguments import matching, number
from frischid.cli.paths import InputPath
from frischid.core.text import shortened
from frischid.errors import InputError

if TYPE_CHECKING:
    from frischid.logs.controller import PDController
    from frischid.logs.current_gains import CurrentGains

KEYS = {
    "kp": "kp",
    "kd": "kd",
    "effort_limit": "limit",
    "dead_band": "dead_band",
    "delay": "delay",
    "delay_doubt": "delay_doubt",
}
"""Option -> field of `PDController`."""
SIGNALS = ("current", "voltage")
"""Drives whose torque is a gain times a signal of the log."""


@dataclass(frozen=True)
class ControllerArguments:
    """The options of `controller_options`, as text."""

    controller: str | None
    """``pd``, ``current``, ``voltage``, or a TOML file."""
    values: dict[str, str]
    """Option -> a number, or ``JOINT=VALUE,...``; options that were not given are absent."""
    held: bool = False
    """Whether the drive keeps each command until the next one."""
    gain: str | None = None

    def currents(self, joints: Sequence[str]) -> CurrentGains | None:
        """The torque per ampere or volt that ``--gain`` names; None without it.

        Parameters
        ----------
        joints : sequence of str
            All joints of the robot, against which names and patterns are matched.

        Raises
        ------
        InputError
            The controller has no such gain, or a value is not usable.
        """
        from frischid.logs.current_gains import CurrentGains

        if self.gain is None:
            return None
        if self.controller not in SIGNALS:
            raise InputError(
                "--gain is the torque per ampere or volt; add --controller current or --controller voltage"
            )
        found = _values("gain", self.gain, joints)
        each = found if isinstance(found, Mapping) else dict.fromkeys(joints, found)
        return CurrentGains({n: x for n, x in each.items() if x is not None})

    def read(self, joints: Sequence[str]) -> PDController | None:
        """The controller; None without one.

        Parameters
        ----------
        joints : sequence of str
            All joints of the robot, against which names and patterns are matched.

        Raises
        ------
        InputError
            An option is given without ``--controller``, or a value is not usable.
        """
        from dataclasses import replace

        from frischid.logs.controller import PDController

        options = ", ".join(f"--{n.replace('_', '-')}" for n in [*self.values, *["held_commands"] * self.held])
        if self.controller is None:
            if options:
                raise InputError(f"{options} describes a controller; add --controller pd (or --controller FILE.toml)")
            return None
        if self.controller in SIGNALS:
            if options:
                raise InputError(
                    f"{options} is of a controller of positions (--controller pd); a drive of {self.controller} has "
                    "--gain alone"
                )
            return None
        path = Path(self.controller)
        if self.controller != "pd" and not path.suffix and not path.exists():
            raise InputError(
                f"--controller {shortened(self.controller)}: there is no such controller; give pd "
                "(kp, kd, saturation, dead band and delay are its options), current or voltage (with --gain), or a "
                "TOML file that describes a pd controller"
            )
        found = PDController() if self.controller == "pd" else PDController.load(self.controller)
        values: dict[str, Any] = {KEYS[name]: _values(name, text, joints) for name, text in self.values.items()}
        found = replace(found, **values, held=found.held or self.held)
        found.check_joints(joints)
        return found


def _values(option: str, text: str, joints: Sequence[str]) -> float | Mapping[str, float | None] | None:
    name = f"--{option.replace('_', '-')}"
    if text == "auto" and option in ("kp", "kd", "delay"):
        return None
    if "=" not in text:
        return number(name, text)
    found: dict[str, float | None] = {}
    for item in text.split(","):
        pattern, _, value = item.partition("=")
        given = None if value == "auto" and option == "kd" else number(f"{name} {pattern}", value)
        found |= dict.fromkeys(matching(pattern, joints) or [], given)
    return found


def controller_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options of a controller; the command gets them as ``controller``, a `ControllerArguments`."""

    @functools.wraps(command)
    def collected(*args: Any, controller: str | None, held_commands: bool, gain: str | None, **given: Any) -> Any:
        values = {name: text for name in KEYS if (text := given.pop(name)) is not None}
        return command(*args, controller=ControllerArguments(controller, values, held_commands, gain), **given)

    each = "one number, or JOINT=VALUE,... (* and ? match)."
    options = [
        click.option(
            "--controller",
            type=InputPath(),
            metavar="pd|current|voltage|FILE",
            help="What makes torque, for logs without torque. Commanded positions (qcmd_<joint>): pd, or a TOML file. "
            "Drives of current or voltage (current_<joint>): current, or voltage.",
        ),
        click.option(
            "--gain",
            metavar="VALUES",
            help=f"With a drive of current or voltage, torque per ampere or volt, N·m/A (N·m/V): {each} Gains that are "
            "left out are found from the URDF's masses.",
        ),
        click.option(
            "--kp",
            metavar="VALUES",
            help=f"The controller's torque per position error, N·m/rad: {each} "
            "Gains that are left out are found from the URDF's masses.",
        ),
        click.option(
            "--kd",
            metavar="VALUES",
            help=f"The controller's torque per velocity error, N·m·s/rad: {each} With auto (or JOINT=auto), "
            "kd is found from logs with vcmd columns, and without these only the sum of kd and viscous friction.",
        ),
        click.option("--effort-limit", metavar="VALUES", help=f"The drive's largest torque, N·m: {each}"),
        click.option(
            "--dead-band", metavar="VALUES", help=f"Position error below which the drive gives no torque, rad: {each}"
        ),
        click.option(
            "--delay",
            metavar="VALUES",
            help=f"Age of a command when it begins to act, s: {each} With auto, one delay of all joints is found.",
        ),
        click.option("--delay-doubt", metavar="VALUES", help=f"Standard error of the delay, s: {each}"),
        click.option(
            "--held-commands", is_flag=True, help="The drive keeps each command until the next row of the log."
        ),
    ]
    wrapped: Callable[..., Any] = collected
    for option in reversed(options):
        wrapped = option(wrapped)
    return wrapped
