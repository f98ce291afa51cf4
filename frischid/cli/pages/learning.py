"""The catalogue and the demonstration, as pages."""

from __future__ import annotations

from typing import Any

import numpy as np

from frischid.cli.demo import HIDDEN, STRENGTH, Demo
from frischid.cli.pages.comparing import comparison
from frischid.cli.pages.fitting import identified, parameters, summary
from frischid.cli.pages.improving import diagnosis, fall_of
from frischid.cli.pages.page import Page, quantities, table_of, warning_lines
from frischid.core.text import sentence
from frischid.effects import EFFECTS, Effect
from frischid.effects.symbols import symbols_of

SYMBOLS_OF_ALL = (
    "q, v, a: position, velocity and acceleration of the joint; τ_rigid: torque of the links; τ_model: torque of the "
    "whole model; t: time. The other symbols are identified coefficients and shape parameters: frischid effects NAME "
    "explains each."
)


def catalogue() -> Page:
    """Every effect in a line."""
    foreign = any(EFFECTS.package(kind) is not None for kind in EFFECTS.values())
    table = table_of("effect", "stands for", "equation", *(["from"] if foreign else []))
    for name, kind in EFFECTS.items():
        table.add_row(name, kind.title, kind.equation, *([_origin(kind)] if foreign else []))
    return Page([_effect_data(kind) for kind in EFFECTS.values()], [table, SYMBOLS_OF_ALL])


def effect(kind: type[Effect]) -> Page:
    """One effect's page."""
    data = _effect_data(kind)
    lines = [
        f"[bold]{kind.id}[/bold]: {kind.title}",
        f"  equation      {kind.equation}",
        *(
            f"  {'  with' if k == 0 else '':13} {symbol}: {text}"
            for k, (symbol, text) in enumerate(data["symbols"].items())
        ),
        f"  in words      {kind.sentence.format(joint='the joint', joints='two joints')}",
        f"  looks like    {kind.looks_like}",
        f"  confused with {', '.join(kind.confused_with) or 'not stated'}",
        f"  confirmed by  {kind.confirmed_by}",
        f"  source        {kind.reference}",
        f"  shape         {', '.join(_default(kind(), name) for name in data['parameters']) or 'no shape parameters'}",
    ]
    if data["package"] is not None:
        lines.append(f"  comes from    {_origin(kind)}")
    return Page(data, lines)


def _origin(kind: type[Effect]) -> str:
    """Package that an effect comes from; empty for the effects of frischid."""
    package = EFFECTS.package(kind)
    return "" if package is None else str(package)


def _default(effect: Effect, name: str) -> str:
    unit = effect.unit(name)
    return f"{name} (default {effect.parameters[name]}{f', {unit}' if unit else ''})"


def _effect_data(kind: type[Effect]) -> dict[str, Any]:
    return {
        "effect": kind.id,
        "title": kind.title,
        "equation": kind.equation,
        "symbols": symbols_of(kind),
        "sentence": kind.sentence,
        "looks_like": kind.looks_like,
        "confused_with": list(kind.confused_with),
        "confirmed_by": kind.confirmed_by,
        "reference": kind.reference,
        "parameters": kind().parameters,
        "package": None if (package := EFFECTS.package(kind)) is None else package.to_dict(),
    }


def _hidden(result: Demo) -> list[Any]:
    """The second part: the hidden effect, the diagnosis, the fall of the error."""
    step, best = result.step, result.diagnosis.findings[0]
    found = quantities(best.found(result.model.robot))
    values = ", ".join(f"{k} = {v:.4g}" for k, v in STRENGTH.items())
    return [
        f"[bold]A hidden effect.[/bold] The same arm has a spring now: {HIDDEN} with {values}. Its model has none. "
        "frischid diagnose prints:",
        *diagnosis(result.diagnosis).parts[:3],
        f"{sentence(best.sentence, best.joints)}. Found: {found}.",
        f"Added: {fall_of(step)}",
    ]


def demo(result: Demo, output: str | None, page: str) -> Page:
    """The demonstration, with the truth beside every estimate."""
    found = result.found
    assert found.comparison is not None  # the demonstration always holds a motion out
    assert found.headline is not None
    within = np.abs(found.model.estimate.theta - result.truth) <= 2 * found.model.estimate.stderr
    story = (
        f"A planar arm with known parameters made two motions of {result.seconds:g} s, recorded at {result.rate:g} "
        "Hz with noisy positions and torques. The parameters were identified on motion A; motion B was only predicted."
    )
    verdict = f"{int(within.sum())} of {len(within)} true values lie within two standard errors."
    parts: list[Any] = [story, summary(found), parameters(found.model, result.truth.tolist())]
    parts += [
        *comparison(found.comparison, found.headline).parts,
        verdict,
        *warning_lines(found.warnings),
        "",
        *_hidden(result),
    ]
    if output:
        parts.append(f"model written to {output}")
    parts += [
        f"report on the arm with the hidden effect written to {page}: open it in a browser",
        "next, with a log and a URDF of your own: frischid map LOG ROBOT -o map.toml",
    ]
    data = identified(found)
    for row, true in zip(data["parameters"], result.truth, strict=True):
        row["true"] = float(true)
    data["report"] = page
    data["hidden"] = {
        "truth": HIDDEN,
        "diagnosis": result.diagnosis.to_dict(),
        "headline": None if result.step.headline is None else result.step.headline.to_dict(),
    }
    return Page(data, parts)
