"""The commands `effects`, `demo`, `doctor`, `schema` and `completion`: a first run, and pages about frischid itself."""

from __future__ import annotations

import json
from pathlib import Path

import click

from frischid.cli.arguments import json_option
from frischid.cli.group import main
from frischid.cli.output import show_page, working
from frischid.cli.paths import OutputFolder, OutputPath
from frischid.errors import InputError, UnknownNameError

SHELLS = ("bash", "zsh", "fish")
COMPLETION_HELP = """Print a script that completes commands and options in a shell.

\b
bash: frischid completion bash >> ~/.bashrc
zsh:  frischid completion zsh >> ~/.zshrc
fish: frischid completion fish > ~/.config/fish/completions/frischid.fish
"""


@main.command()
@click.argument("name", required=False)
@json_option
def effects(name: str | None, as_json: bool) -> None:
    """List the catalogue of effects, or show the page of one."""
    from frischid.cli.pages import learning as show
    from frischid.effects import EFFECTS

    if name is not None and name not in EFFECTS:
        raise UnknownNameError("effect", name, EFFECTS)
    show_page(show.catalogue() if name is None else show.effect(EFFECTS[name]), as_json)


@main.command()
@click.option("--seed", default=0, show_default=True, help="Seed of the motions and the noise.")
@click.option("-o", "--output", type=OutputPath(), help="Write the model here (JSON).")
@click.option(
    "--report", "page", type=OutputPath(), default="frischid-demo.html", show_default=True, help="Report to write."
)
@click.option(
    "--practice",
    type=OutputFolder(),
    help="Only write this new folder: the robot, the logs and the model that the guides name.",
)
@json_option
def demo(seed: int, output: str | None, page: str, practice: str | None, as_json: bool) -> None:
    """Run the whole procedure on a simulated planar arm.

    Simulate, identify, compare with the truth, find a hidden effect, and write a report.
    """
    if practice is not None:
        _practise(Path(practice), as_json)
        return
    from frischid.cli.demo import run
    from frischid.cli.pages import learning as show
    from frischid.reports.page import report

    with working(as_json) as progress:
        result = run(seed, progress)
        report(result.model, result.logs, page, diagnosis=result.diagnosis, truth=result.truth, progress=progress)
    if output:
        result.found.model.save(output)
    show_page(show.demo(result, output, page), as_json)


def _practise(folder: Path, as_json: bool) -> None:
    """Write the folder in which the guides' commands run; nothing that is there is overwritten."""
    from rich.markup import escape

    from frischid.cli.pages.page import Page
    from frischid.cli.practice import fill

    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"--practice: the folder {folder} is not empty; name a new folder")
    with working(as_json) as progress:
        fill(folder, progress)
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    words = f"{escape(str(folder))}: {', '.join(files)}. Change to this folder; the commands of the guides run there."
    show_page(Page({"folder": str(folder), "files": files}, [words]), as_json)


@main.command()
@json_option
def doctor(as_json: bool) -> None:
    """Show versions and optional parts, and run a self-test.

    Attach the output to a report of a fault. Exit code 1: the self-test failed.
    """
    from frischid.cli.pages import doctor as show
    from frischid.cli.self_test import self_test

    with working(as_json) as progress:
        progress("testing")
        trials = self_test()
    show_page(show.health(trials), as_json)
    if not all(trial.passed for trial in trials):
        raise SystemExit(1)


@main.command()
@click.argument("name", required=False)
@json_option
def schema(name: str | None, as_json: bool) -> None:
    """Print the JSON Schema of an output or a file. Without NAME, list the names."""
    from frischid.cli.outputs.schemas import TYPES, schema_of
    from frischid.cli.pages.page import Page

    if name is None:
        show_page(Page(list(TYPES), [", ".join(TYPES)]), as_json)
        return
    if name not in TYPES:
        raise UnknownNameError("schema", name, tuple(TYPES))
    click.echo(json.dumps(schema_of(name), indent=1))


@main.command(help=COMPLETION_HELP)
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print a script for a shell."""
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None  # click knows these three
    click.echo(kind(main, {}, "frischid", "_FRISCHID_COMPLETE").source())
