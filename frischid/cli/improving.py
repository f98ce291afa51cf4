"""Effects that a model misses: diagnose, add, improve, and the history of these steps."""

from __future__ import annotations

from typing import Any

import click

from frischid.cli.arguments import (
    json_option,
    map_option,
    matching,
    scheduler_option,
    situation_option,
    valid_option,
    workers_option,
)
from frischid.cli.group import main
from frischid.cli.inputs import opened
from frischid.cli.output import elsewhere, show_page, working
from frischid.errors import InputError


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@valid_option
@map_option
@situation_option
@click.option("--try", "only", help="Effects to try, comma separated; all by default.")
@scheduler_option
@workers_option
@json_option
def diagnose(
    model: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    mapping: str | None,
    situation: Any,
    only: str | None,
    scheduler: str | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Which physical effect the model is missing, by cross-validated evidence."""
    from frischid.cli.pages import improving as show
    from frischid.diagnosis.diagnosis import diagnose as run
    from frischid.model.model import Model

    loaded = Model.load(model)
    with working(as_json) as progress, elsewhere(scheduler, workers) as pool:
        progress("reading logs")
        found = run(
            loaded,
            opened(logs, loaded.robot, mapping),
            valid=opened(valid, loaded.robot, mapping),
            situation=situation,
            effects=None if only is None else [x.strip() for x in only.split(",")],
            workers=pool,
            progress=progress,
        )
    show_page(show.diagnosis(found), as_json)


@main.command()
@click.argument("model")
@click.argument("effect")
@click.argument("logs", nargs=-1, required=True)
@click.option("--joints", help="Joints it acts on, comma separated; * and ? match. All by default.")
@valid_option
@map_option
@situation_option
@click.option("-o", "--output", type=click.Path(), required=True, help="Write the new model here (JSON).")
@json_option
def add(
    model: str,
    effect: str,
    logs: tuple[str, ...],
    joints: str | None,
    valid: tuple[str, ...],
    mapping: str | None,
    situation: Any,
    output: str,
    as_json: bool,
) -> None:
    """Add an effect to a model, refit, and show the error before and after.

    EFFECT is written as for `identify --effects`: stribeck(v_s=0.1)@joint3.
    """
    from frischid.cli.pages import improving as show
    from frischid.core.files import check_writable
    from frischid.diagnosis.improvement import add as run
    from frischid.diagnosis.improvement import searched
    from frischid.effects import parse_effects
    from frischid.model.model import Model

    check_writable(output)
    if joints is not None and "@" in effect:
        raise InputError(f"'{effect}' says where it acts, and so does --joints {joints}; give one of them")
    loaded = Model.load(model)
    names = matching(joints, loaded.robot.joints)
    with working(as_json) as progress:
        progress("refitting")
        data, test = opened(logs, loaded.robot, mapping), opened(valid, loaded.robot, mapping)
        chosen = parse_effects(effect if names is None else f"{effect}@{'+'.join(names)}")
        chosen = searched(loaded, chosen, effect, data, situation)
        step = run(loaded, chosen, data, valid=test, situation=situation)
    step.model.save(output)
    show_page(show.added(step, output), as_json)


@main.command()
@click.argument("model")
@click.argument("logs", nargs=-1, required=True)
@valid_option
@map_option
@situation_option
@click.option("--max-steps", default=8, show_default=True, help="Largest number of effects to add.")
@click.option("-o", "--output", type=click.Path(), help="Write the final model here (JSON).")
@json_option
def improve(
    model: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    mapping: str | None,
    situation: Any,
    max_steps: int,
    output: str | None,
    as_json: bool,
) -> None:
    """Diagnose and add until nothing passes; print how the error falls. A step that harms a joint is refused."""
    from frischid.cli.pages import improving as show
    from frischid.core.files import check_writable
    from frischid.diagnosis.improvement import improve as run
    from frischid.model.model import Model

    if output:
        check_writable(output)
    loaded = Model.load(model)
    with working(as_json) as progress:
        progress("reading logs")
        data, test = opened(logs, loaded.robot, mapping), opened(valid, loaded.robot, mapping)
        steps, last = run(loaded, data, valid=test, situation=situation, max_steps=max_steps, progress=progress)
    final = steps[-1].model if steps else loaded
    if output:
        final.save(output)
    show_page(show.improvement(steps, last, output), as_json)


@main.command()
@click.argument("model")
@click.option("--undo", is_flag=True, help="Take the last step back.")
@click.option("-o", "--output", type=click.Path(), help="Where to write the model without its last step.")
@json_option
def history(model: str, undo: bool, output: str | None, as_json: bool) -> None:
    """What was done to a model, step by step; any step can be undone."""
    from frischid.cli.pages import improving as show
    from frischid.diagnosis.improvement import undo as run
    from frischid.model.model import Model

    loaded = Model.load(model)
    if undo:
        if not output:
            raise InputError("--undo needs -o FILE, the model to write")
        loaded = run(loaded)
        loaded.save(output)
    show_page(show.history(loaded), as_json)
