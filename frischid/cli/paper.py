"""The paper frischid began with, computed again."""

from __future__ import annotations

from typing import Literal

import click

from frischid.cli.arguments import json_option
from frischid.cli.group import main
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath, OutputFolder
from frischid.errors import InputError


@main.command()
@click.option(
    "-o", "--output", type=OutputFolder(), help="Folder for the page (paper.html) and all figures (paper.json)."
)
@click.option("--points", type=InputPath(), help="The authors' final.mat, or a table of the 100 points.")
@click.option("--own-motion", is_flag=True, help="A random motion instead of the authors' points; nothing to compare.")
@click.option("--runs", default=250, show_default=True, help="Monte Carlo runs of each study.")
@click.option("--as-published", is_flag=True, help="Only the study as published: eq. (16), the rules of their code.")
@click.option("--as-corrected", is_flag=True, help="Only the study as corrected.")
@click.option("--seed", default=0, show_default=True, help="Seed of the noise.")
@json_option
def paper(
    output: str | None,
    points: str | None,
    own_motion: bool,
    runs: int,
    as_published: bool,
    as_corrected: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Compute the paper's tables and figures again, beside the printed ones."""
    from frischid.cli.pages import paper as show
    from frischid.paper.reproduction import reproduce_paper

    if own_motion and points:
        raise InputError("--points and --own-motion exclude each other; leave one of the two out")
    which: Literal["both", "published", "corrected"] = "both"
    if as_published != as_corrected:
        which = "published" if as_published else "corrected"
    with working(as_json) as progress:
        found = reproduce_paper(
            points,
            runs=runs,
            which=which,
            own_motion=own_motion,
            seed=seed,
            search=output is not None,
            progress=progress,
        )
        written = () if output is None else found.write(output)
    show_page(show.reproduction(found, written), as_json)
