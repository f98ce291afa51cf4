"""The commands `consistent` and `export`: physical links for a model, and the model as a file for other programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from frischid.cli.arguments import json_option, number, pairs
from frischid.cli.group import main
from frischid.cli.inputs import model_of
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath, OutputPath
from frischid.errors import InputError

Corners = tuple[list[float], list[float]]


def box_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options that limit where centres of mass may lie."""
    command = click.option(
        "--no-shapes", is_flag=True, help="Do not keep centres of mass within the URDF's own shapes."
    )(command)
    return click.option(
        "--box",
        "box",
        multiple=True,
        metavar="JOINT=X,Y,Z:X,Y,Z",
        help="Two corners (m, in the joint's frame) of a box in which the centre of mass of the joint's link must lie.",
    )(command)


@main.command()
@click.argument("model", type=InputPath())
@box_options
@click.option("-o", "--output", type=OutputPath(), help="Write the physical model here (JSON).")
@json_option
def consistent(model: str, box: tuple[str, ...], no_shapes: bool, output: str | None, as_json: bool) -> None:
    """Find physically consistent links with a model's base parameters.

    Physical means: positive mass, possible inertia, and the centre of mass within the link.
    """
    from frischid.cli.pages import exporting as show
    from frischid.export.consistency import make_consistent

    loaded = model_of(model)
    with working(as_json) as progress:
        progress("physical links")
        found = make_consistent(loaded, boxes=_corners(box), shapes=not no_shapes)
    if output:
        found.model.save(output)
    show_page(show.consistency(found, output), as_json)


@main.command()
@click.argument("model", type=InputPath())
@click.option(
    "-o",
    "--output",
    type=OutputPath(),
    required=True,
    help="robot.urdf, robot.xml (MJCF), x.c, x.py, or drives.json or .csv.",
)
@click.option("--into", type=InputPath(), help="The robot's own MJCF file: only its numbers change in the written one.")
@click.option(
    "--step",
    type=float,
    metavar="S",
    help="Step of the simulator, s; 0.005 by default. drives.json and .csv count delays in steps.",
)
@box_options
@click.option("--force", is_flag=True, help="Export the model as identified, even if it is not physical.")
@json_option
def export(
    model: str,
    box: tuple[str, ...],
    no_shapes: bool,
    output: str,
    into: str | None,
    step: float | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write a model as URDF, MJCF, or C or NumPy code.

    The code is a function for a control loop, without further dependencies. A model with memory (presliding, backlash,
    a delay) becomes a function that is called at every sample, with a state. Effects for which MJCF has no place go to
    robot_effects.py beside robot.xml: its attach(model) applies them in MuJoCo. JSON and CSV hold a table of the drives
    (stiffness, damping, armature, friction, effort limit, delay) with ranges, for simulators.

    Links that are not physical are made physical first (see `frischid consistent`); the changes are printed.
    """
    from frischid.cli.pages import exporting as show
    from frischid.export.export import export as run

    loaded = model_of(model)
    with working(as_json) as progress:
        progress("physical links")
        done = run(loaded, output, force=force, boxes=_corners(box) or None, shapes=not no_shapes, into=into, step=step)
    show_page(show.export(done), as_json)


def _corners(items: tuple[str, ...]) -> dict[str, Corners]:
    """Boxes written as JOINT=x,y,z:x,y,z."""
    found = {}
    for joint, text in pairs(items).items():
        corners = [[number(f"--box {joint}", x) for x in corner.split(",")] for corner in text.split(":")]
        if [len(c) for c in corners] != [3, 3]:
            raise InputError(f"--box {joint}: '{text}' must be two corners X,Y,Z:X,Y,Z in metres")
        found[joint] = (corners[0], corners[1])
    return found
