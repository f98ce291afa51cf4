"""Physical links behind a model, and the model taken home."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from frischid.cli.arguments import json_option, number, pairs
from frischid.cli.group import main
from frischid.cli.output import show_page, working
from frischid.errors import InputError

Corners = tuple[list[float], list[float]]


def box_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options that say where centres of mass may lie."""
    command = click.option(
        "--no-shapes", is_flag=True, help="Do not keep centres of mass within the URDF's own shapes."
    )(command)
    return click.option(
        "--box",
        "box",
        multiple=True,
        metavar="JOINT=X,Y,Z:X,Y,Z",
        help="Corners (m, in the joint's frame) of a box that holds the centre of mass of the body behind the joint.",
    )(command)


@main.command()
@click.argument("model")
@box_options
@click.option("-o", "--output", type=click.Path(), help="Write the physical model here (JSON).")
@json_option
def consistent(model: str, box: tuple[str, ...], no_shapes: bool, output: str | None, as_json: bool) -> None:
    """Find links that could exist (positive mass, physical inertia) and have the model's base parameters."""
    from frischid.cli.pages import exporting as show
    from frischid.core.files import check_writable
    from frischid.export.consistency import make_consistent
    from frischid.model.model import Model

    if output:
        check_writable(output)
    loaded = Model.load(model)
    with working(as_json) as progress:
        progress("physical links")
        found = make_consistent(loaded, boxes=_corners(box), shapes=not no_shapes)
    if output:
        found.model.save(output)
    show_page(show.consistency(found, output), as_json)


@main.command()
@click.argument("model")
@click.option("-o", "--output", type=click.Path(), required=True, help="robot.urdf, robot.xml (MJCF), x.c or x.py.")
@box_options
@click.option("--force", is_flag=True, help="Export a model that no robot can have, as it was identified.")
@json_option
def export(model: str, box: tuple[str, ...], no_shapes: bool, output: str, force: bool, as_json: bool) -> None:
    """Write a model as a URDF, an MJCF file, or a C or NumPy function for a control loop.

    The links are made physical first, unless they are (see `frischid consistent`), and it is said what that changed.
    """
    from frischid.cli.pages import exporting as show
    from frischid.export.urdf import export as run
    from frischid.model.model import Model

    loaded = Model.load(model)
    with working(as_json) as progress:
        progress("physical links")
        done = run(loaded, output, force=force, boxes=_corners(box) or None, shapes=not no_shapes)
    show_page(show.export(done), as_json)


def _corners(items: tuple[str, ...]) -> dict[str, Corners]:
    """JOINT=x,y,z:x,y,z pairs."""
    found = {}
    for joint, text in pairs(items).items():
        corners = [[number(f"--box {joint}", x) for x in corner.split(",")] for corner in text.split(":")]
        if [len(c) for c in corners] != [3, 3]:
            raise InputError(f"--box {joint}: '{text}' should be two corners X,Y,Z:X,Y,Z in metres")
        found[joint] = (corners[0], corners[1])
    return found
