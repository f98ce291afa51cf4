"""The commands `effects` and `demo`: the catalogue of effects, and the whole procedure on a simulated arm."""

from __future__ import annotations

import click

from frischid.cli.arguments import json_option
from frischid.cli.group import main
from frischid.cli.output import show_page, working
from frischid.cli.paths import OutputPath
from frischid.errors import UnknownNameError


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
@json_option
def demo(seed: int, output: str | None, page: str, as_json: bool) -> None:
    """Run the whole procedure on a simulated planar arm.

    Simulate, identify, compare with the truth, find a hidden effect, and write a report.
    """
    from frischid.cli.demo import run
    from frischid.cli.pages import learning as show
    from frischid.reports.page import report

    with working(as_json) as progress:
        result = run(seed, progress)
        report(result.model, result.logs, page, diagnosis=result.diagnosis, truth=result.truth, progress=progress)
    if output:
        result.found.model.save(output)
    show_page(show.demo(result, output, page), as_json)
