"""The commands `diagnose`, `add`, `improve` and `history`: missing effects, and the steps that add them to a model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import click

from frischid.cli.arguments import (
    MapFiles,
    json_option,
    logs_argument,
    map_option,
    matching,
    scheduler_option,
    situation_option,
    torque_joints_option,
    valid_option,
    workers_option,
)
from frischid.cli.group import main
from frischid.cli.inputs import model_of, opened, opened_or_own
from frischid.cli.output import elsewhere, show_page, working
from frischid.cli.paths import InputPath, OutputPath
from frischid.errors import InputError


@main.command()
@click.argument("model", type=InputPath())
@logs_argument()
@valid_option
@map_option
@situation_option
@torque_joints_option
@click.option("--try", "only", help="Effects to try at every joint, comma separated; all by default.")
@click.option("--simulate", "simulated", is_flag=True, help="Show what each finding does to the simulated motion.")
@scheduler_option
@workers_option
@json_option
def diagnose(
    model: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    mapping: MapFiles,
    situation: Any,
    torque_joints: str | None,
    only: str | None,
    simulated: bool,
    scheduler: str | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Find the physical effect that a model is missing.

    The most probable cause stands first; the evidence is cross-validated. Without LOGS, the logs that the model was
    fitted to are read again.
    """
    from frischid.cli.pages import improving as show
    from frischid.diagnosis.motion_space import simulate_findings
    from frischid.diagnosis.roles import diagnose_with, roles

    loaded, moved = model_of(model, torque_joints), None
    with working(as_json) as progress, elsewhere(scheduler, workers) as pool:
        progress("reading logs")
        data = opened_or_own(logs, loaded, mapping, progress)
        test = opened(valid, loaded.robot, mapping, progress)
        given = roles(loaded, data, valid=test, situation=situation)
        found = diagnose_with(
            loaded,
            given,
            effects=None if only is None else [x.strip() for x in only.split(",")],
            workers=pool,
            progress=progress,
        )
        if simulated:
            moved = simulate_findings(given.before or loaded, found, given.select, valid=given.test, progress=progress)
    show_page(show.diagnosis(found, moved), as_json)


@main.command()
@click.argument("model", type=InputPath())
@click.argument("effect")
@logs_argument()
@click.option("--joints", help="Joints the effect acts on, comma separated; * and ? match. Default: all.")
@valid_option
@map_option
@situation_option
@torque_joints_option
@click.option("-o", "--output", type=OutputPath(), required=True, help="Write the new model here (JSON).")
@json_option
def add(
    model: str,
    effect: str,
    logs: tuple[str, ...],
    joints: str | None,
    valid: tuple[str, ...],
    mapping: MapFiles,
    situation: Any,
    torque_joints: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Add an effect to a model, refit, and show the errors.

    EFFECT is written as for `identify --effects`: stribeck(speed=0.1)@joint3. Without LOGS, the logs that the model was
    fitted to are read again. The output says what the new model can be exported to.
    """
    from frischid.cli.pages import improving as show
    from frischid.diagnosis.addition import add as run
    from frischid.diagnosis.roles import decided_situation
    from frischid.diagnosis.shape_choice import searched
    from frischid.effects import parse_effects
    from frischid.effects.notation import states_shape

    if joints is not None and "@" in effect:
        raise InputError(f"'{effect}' names its joints, and so does --joints {joints}; name them only once")
    loaded = model_of(model, torque_joints)
    names = matching(joints, loaded.robot.joints)
    with working(as_json) as progress:
        progress("refitting")
        data = opened_or_own(logs, loaded, mapping, progress)
        test = opened(valid, loaded.robot, mapping, progress)
        chosen = parse_effects(effect, complete=True)
        chosen = chosen if names is None else tuple(replace(one, joints=tuple(names)) for one in chosen)
        if situation == "auto" and not all(states_shape(effect)):  # shapes are searched as they are fitted
            situation = decided_situation(loaded, data, valid=test).situation
        chosen = searched(loaded, chosen, effect, data, situation)
        step = run(loaded, chosen, data, valid=test, situation=situation, progress=progress)
    step.model.save(output)
    show_page(show.added(step, output), as_json)


@main.command()
@click.argument("model", type=InputPath())
@logs_argument()
@valid_option
@map_option
@situation_option
@torque_joints_option
@click.option(
    "--max-steps",
    type=click.IntRange(min=0),
    default=8,
    show_default=True,
    help="Largest number of effects to add.",
)
@click.option(
    "--exportable", type=click.Choice(["c", "mjcf", "urdf"]), help="Try only effects that such an export holds whole."
)
@click.option("-o", "--output", type=OutputPath(), help="Write the final model here (JSON).")
@json_option
def improve(
    model: str,
    logs: tuple[str, ...],
    valid: tuple[str, ...],
    mapping: MapFiles,
    situation: Any,
    torque_joints: str | None,
    max_steps: int,
    exportable: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Add missing effects one by one until none is found.

    A step that harms a joint is refused, with the reason. Without LOGS, the logs that the model was fitted to are read
    again. The output says what the final model can be exported to.
    """
    from frischid.cli.pages import improving as show
    from frischid.diagnosis.improvement import improve as run
    from frischid.export.reach import exportable as held_by

    loaded = model_of(model, torque_joints)
    only = None if exportable is None else held_by(loaded, exportable)
    with working(as_json) as progress:
        progress("reading logs")
        data = opened_or_own(logs, loaded, mapping, progress)
        test = opened(valid, loaded.robot, mapping, progress)
        steps, last = run(
            loaded, data, valid=test, situation=situation, max_steps=max_steps, effects=only, progress=progress
        )
    final = steps[-1].model if steps else loaded
    if output:
        final.save(output)
    show_page(show.improvement(steps, last, output), as_json)


@main.command()
@click.argument("model", type=InputPath())
@click.option("--undo", is_flag=True, help="Take the last step back.")
@click.option("-o", "--output", type=OutputPath(), help="Where to write the model without its last step.")
@json_option
def history(model: str, undo: bool, output: str | None, as_json: bool) -> None:
    """List the steps of a model, or take the last one back."""
    from frischid.cli.pages import improving as show
    from frischid.diagnosis.addition import undo as run

    if undo != bool(output):
        raise InputError(
            "--undo needs -o FILE, the model to write" if undo else "-o writes the model of --undo; give both or none"
        )
    loaded = model_of(model)
    if output:
        loaded = run(loaded)
        loaded.save(output)
    show_page(show.history(loaded), as_json)
