"""Files that commands read and write, and the one place that keeps them apart.

Every option or argument that names a file has the type `InputPath` or `OutputPath`. Before a command begins, `Command`
holds all outputs against all inputs (`frischid.core.files.check_outputs`). Files that only the work itself finds (logs
that a pattern matches, meshes of a URDF) are held against the outputs by `check_found`, before they are read.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import click

from frischid.cli.output import ASKED_WIDTH, QUIET
from frischid.core.files import check_outputs, check_writable

_OUTPUTS = "frischid.outputs"  # key in click's own store of a running command


class _FilePath(click.Path):
    """A path; a null character, which no path can hold, is an error of the argument."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Check, then convert as click does."""
        if "\0" in os.fspath(value):
            self.fail("a path holds no null character", param, ctx)
        return super().convert(value, param, ctx)


class InputPath(_FilePath):
    """A file or folder that is read, or the name of a robot."""


class OutputPath(_FilePath):
    """A file that is written."""


class OutputFolder(_FilePath):
    """A folder that is filled."""


class Command(click.Command):
    """A command that first of all refuses to write over a file that it reads; with the options that all have."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """The command's own parameters, then ``--width`` and ``--quiet``."""
        *own, help_option = super().get_params(ctx)
        return [*own, *options_of_the_output(), help_option]

    def invoke(self, ctx: click.Context) -> Any:
        """Check the files, then run."""
        outputs = list(_given(self, ctx, OutputPath))
        for path in outputs:
            check_writable(path)
        ctx.meta[_OUTPUTS] = outputs
        check_found(_given(self, ctx, InputPath))
        return super().invoke(ctx)


def options_of_the_output() -> list[click.Parameter]:
    """``--width`` and ``--quiet``, before or after the name of the command; the one after it counts."""

    def keep(key: str) -> Callable[[click.Context, click.Parameter, Any], None]:
        return lambda context, _, value: context.meta.update({key: value} if value else {})

    return [
        click.Option(
            ["--width"],
            type=click.IntRange(20, 1000),
            expose_value=False,
            callback=keep(ASKED_WIDTH),
            help="Characters per line of output. Default: the terminal's width or COLUMNS; 140 into a pipe.",
        ),
        click.Option(["--quiet"], is_flag=True, expose_value=False, callback=keep(QUIET), help="Show no progress."),
    ]


def check_found(inputs: Iterable[str | Path] | Callable[[], Iterable[str | Path]]) -> None:
    """Hold files that are read against the outputs of the running command.

    Parameters
    ----------
    inputs : iterable of str or Path, or callable
        A callable is asked only where an output is a file that exists already.

    Raises
    ------
    InputError
        The command would write over one of them.
    """
    context = click.get_current_context(silent=True)
    outputs = [] if context is None else context.meta.get(_OUTPUTS, [])
    if callable(inputs):
        inputs = inputs() if any(Path(path).exists() for path in outputs) else ()
    check_outputs(outputs, inputs)


def also_written(path: str | Path) -> None:
    """Claim one more output, which the command chooses by itself.

    Raises
    ------
    InputError
        The path cannot be written, or the command reads it.
    """
    check_writable(path)
    context = click.get_current_context()
    outputs = context.meta.setdefault(_OUTPUTS, [])
    outputs.append(str(path))
    check_found(_given(context.command, context, InputPath))


def _given(command: click.Command, ctx: click.Context, kind: type[click.Path]) -> Iterator[str]:
    """Values of the parameters of a kind, one by one."""
    for parameter in command.params:
        if isinstance(parameter.type, kind):
            value = ctx.params.get(str(parameter.name))
            if value is not None:
                yield from (value if isinstance(value, tuple) else (value,))
