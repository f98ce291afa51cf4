"""The catalogue of effects, and the whole job on a simulated arm."""

from __future__ import annotations

import click

from frischid.cli.arguments import json_option, show_page, working
from frischid.cli.group import main
from frischid.errors import UnknownNameError


@main.command()
@click.argument("name", required=False)
@json_option
def effects(name: str | None, as_json: bool) -> None:
    """The catalogue of physical effects, or the page of one of them."""
    from frischid.effects import EFFECTS
    from frischid.show import learning as show

    if name is not None and name not in EFFECTS:
        raise UnknownNameError("effect", name, EFFECTS)
    show_page(show.catalogue() if name is None else show.effect(EFFECTS[name]), as_json)


@main.command()
@click.option("--seed", default=0, show_default=True, help="Of the motions and the noise.")
@click.option("-o", "--output", type=click.Path(), help="Write the model here (JSON).")
@json_option
def demo(seed: int, output: str | None, as_json: bool) -> None:
    """The whole job on a simulated planar arm: simulate, identify, compare with the truth."""
    from frischid.demo import run
    from frischid.model import check_writable
    from frischid.show import learning as show

    if output:
        check_writable(output)
    with working(as_json) as progress:
        result = run(seed, progress)
    if output:
        result.found.model.save(output)
    show_page(show.demo(result, output), as_json)
