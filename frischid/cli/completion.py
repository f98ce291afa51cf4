"""The command `completion`: the line that makes a shell complete frischid's commands, options and robots."""

from __future__ import annotations

import click

from frischid.cli.group import main

SHELLS = ("bash", "zsh", "fish")


HOW = """Print a script that completes commands and options in a shell.

\b
bash: frischid completion bash >> ~/.bashrc
zsh:  frischid completion zsh >> ~/.zshrc
fish: frischid completion fish > ~/.config/fish/completions/frischid.fish
"""


@main.command(help=HOW)
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print a script for a shell."""
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None  # click knows these three
    click.echo(kind(main, {}, "frischid", "_FRISCHID_COMPLETE").source())
