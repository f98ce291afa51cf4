"""The group all commands join, and how frischid's own errors are shown."""

from __future__ import annotations

import sys
from typing import Any

import click

from frischid.errors import FrischidError


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
