"""The group of all commands, which also prints frischid's own errors."""

from __future__ import annotations

import errno
import gc
import os
import sys
from typing import Any

import click

from frischid.cli.output import prepare_streams
from frischid.cli.paths import Command, options_of_the_output
from frischid.core.text import printable
from frischid.errors import FrischidError

STOPPED = 130  # exit code of a command that Ctrl-C ended, as shells have it: 128 + SIGINT


SECTIONS = {
    "Begin": ("demo", "info", "doctor", "fetch", "schema", "completion"),
    "Record": ("excite", "simulate", "map", "check", "cut"),
    "Model": ("identify", "compare", "history", "report", "studio"),
    "Missing effects": ("diagnose", "add", "improve", "effects"),
    "Use": ("consistent", "export", "payload", "gains", "fleet"),
    "The paper": ("paper",),
}
"""Sections of ``frischid --help``, in the order of the work; a command in none of them stands under Others."""


class _Commands(click.Group):
    """Turns errors of the input, of a file and of memory into one line on stderr and exit code 2; Ctrl-C into 130."""

    command_class = Command

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """The options of the output, then the group's own."""
        return [*options_of_the_output(), *super().get_params(ctx)]

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the command line."""
        # Matrices here have a few hundred rows: a second BLAS thread costs more than it saves, and on a busy machine
        # threads wait for each other for minutes. OpenBLAS reads the variable when a command loads it.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Imports make many objects and no garbage: looking for it every 700 objects takes a tenth of a start.
        gc.set_threshold(100_000, 20, 100)
        prepare_streams()
        return super().main(*args, **options)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands in the order of the work."""
        shown = {name for names in SECTIONS.values() for name in names}
        sections = SECTIONS | {"Others": tuple(sorted(set(self.commands) - shown))}
        for title, names in sections.items():
            if rows := [(name, self.commands[name].get_short_help_str(70)) for name in names if name in self.commands]:
                with formatter.section(title):
                    formatter.write_dl(rows, col_spacing=max(2, 14 - max(len(name) for name, _ in rows)))

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except FrischidError as error:
            message = str(error)
        except MemoryError as error:
            message = f"this needs more memory than there is ({error}); give shorter logs, or fewer at a time"
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader has seen enough: click ends quietly
                raise
            message = f"{error.filename or 'the output'}: {error.strerror or error}"
        except KeyboardInterrupt:
            click.echo("stopped by Ctrl-C; no file was changed after that", err=True)
            sys.exit(STOPPED)
        click.echo(f"error: {printable(message)}", err=True)
        sys.exit(2)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(package_name="frischid")
def main() -> None:
    """Identify the dynamic parameters of a robot from its URDF and measured logs.

    Try `frischid demo`, then `frischid info ROBOT` with your own URDF or a name such as panda.
    """
