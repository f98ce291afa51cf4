"""Physical links and exported files, as pages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from frischid.cli.pages.joint_drives import drives
from frischid.cli.pages.page import Page, figure, table_of
from frischid.core.text import listed
from frischid.export.consistency import Consistency, free_masses, free_parameters
from frischid.export.export import Export
from frischid.model.alarms import Alarm, by_severity
from frischid.model.headline import alarms_of_fit, headline_of
from frischid.model.model import Model

MEANING_OF_LINKS = (
    "least eigenvalue: of the link's pseudo-inertia relative to the URDF's link, without unit: 1 as the URDF's, 0 a "
    "link that cannot exist. divergence: log-det divergence from the URDF's link, without unit: 0 as the URDF's"
)


def consistency(found: Consistency, output: str | None) -> Page:
    """Links, the limits that they reach, and the change of the base parameters."""
    parts: list[Any] = [
        _verdict(found),
        links(found.model, found),
        MEANING_OF_LINKS,
        *_free(found.model),
        *_changes(found),
        *_held(found),
    ]
    if output:
        parts.append(f"model written to {output}")
    alarms = alarms_of(found.model)
    return Page(consistency_data(found) | {"model": output, "alarms": [a.to_dict() for a in alarms]}, parts, alarms)


def alarms_of(model: Model) -> tuple[Alarm, ...]:
    """The model's own alarms, and those of the last test: whoever uses an export has to know both."""
    own, last = alarms_of_fit(model.history), next((e for e in reversed(model.history) if "test" in e), None)
    test = None if last is None else headline_of(last)
    if last is None or test is None:
        return own
    known, logs = {a.id for a in (*own, *alarms_of_fit([last]))}, listed([Path(name).name for name in test.logs])
    there = [replace(a, sentence=f"In the test on {logs}: {a.sentence}") for a in test.alarms if a.id not in known]
    return by_severity([*own, *there])


def consistency_data(found: Consistency) -> dict[str, Any]:
    """Plain JSON values."""
    result, bodies = found.result, found.model.robot.bodies
    return {
        "feasible": result.feasible,
        "reproduces": result.reproduces,
        "misfit": result.misfit,
        "change_in_standard_errors": dict(
            zip((c.name for c in found.model.estimate.columns), map(float, found.change), strict=True)
        ),
        "least_eigenvalue": dict(zip(bodies, map(float, result.eigenvalues), strict=True)),
        "divergence": dict(zip(bodies, map(float, result.divergence), strict=True)),
        "active": [a._asdict() for a in result.active],
        "blame": [{"where": name, "misfit": share} for name, share in result.blame],
        "boxes": {joint: [low.tolist(), high.tolist()] for joint, (low, high) in found.boxes.items()},
        "free_masses": list(free_masses(found.model)),
        "free_parameters": {body: list(names) for body, names in free_parameters(found.model).items()},
        "standard": dict(found.model.standard or {}),
        "notes": list(found.notes),
    }


def links(model: Model, found: Consistency | None = None) -> Table:
    """Mass, centre of mass and principal inertias of each body, beside the URDF's mass; and what of them is free."""
    more, free = [] if found is None else ["least eigenvalue", "divergence"], free_parameters(model)
    own = ("centre of mass m", "principal inertias kg·m²", "free besides")
    table = table_of("joint", "mass kg", "URDF's", "mass is", *own, *more)
    for i, name in enumerate(model.robot.bodies):
        m, h, nominal = model.links[i, 0], model.links[i, 1:4], model.robot.nominal.reshape(-1, 10)[i, 0]
        source = (
            "free" if "m" in free[name] else "known" if model.robot.all_names[10 * i] in model.robot.known else "fitted"
        )
        row = [
            name,
            figure(m),
            figure(nominal),
            source,
            " ".join(f"{round(x, 3) + 0.0:.3f}" for x in h / m),
            _principal(model.links[i]),
            " ".join(symbol for symbol in free[name] if symbol != "m") or "–",
        ]
        if found is not None:
            row += [figure(found.result.eigenvalues[i]), figure(found.result.divergence[i])]
        table.add_row(*row)
    return table


def _free(model: Model) -> list[str]:
    """The meaning of a free parameter, if there is one."""
    if not any(free_parameters(model).values()):
        return []
    return [
        "free: the logs determine this mass only in a sum with other parameters. The sum is divided so that the links "
        "are nearest to the URDF's; every other division gives the same torque. Do not read such a mass as measured. "
        "free besides: the first moments mx, my, mz and the inertias about the joint, Ixx to Izz, that are free in the "
        "same way, or do not act on the torque. Centre of mass and principal inertias follow from them and the mass"
    ]


def _principal(theta: Any) -> str:
    """Inertias about the principal axes through the centre of mass."""
    m, c = theta[0], theta[1:4] / theta[0]
    xx, xy, yy, xz, yz, zz = theta[4:]
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (c @ c * np.eye(3) - np.outer(c, c))
    return " ".join(f"{x:.3g}" for x in np.linalg.eigvalsh(about))


def _verdict(found: Consistency) -> str:
    result = found.result
    if result.reproduces:
        return (
            f"[bold]physically consistent links found[/bold]: they reproduce the base parameters within their "
            f"bounds (χ² {result.chi_squared:.1f} for {len(found.change)} parameters), and are nearest to the URDF's "
            "links"
        )
    blame = ", ".join(f"{name} ({share:.0f})" for name, share in result.blame[:3])
    return (
        f"[bold]no physically consistent links have these base parameters within their bounds[/bold]: the nearest are "
        f"{found.unexplained:.1f} standard errors away (χ² {result.misfit:.0f}). The misfit is largest at "
        f"{blame or 'no single link'}"
    )


def _changes(found: Consistency) -> list[str]:
    columns, change = found.model.estimate.columns, found.change
    worst = [i for i in np.argsort(-np.abs(change))[:5] if abs(change[i]) > 0.5]
    listing = ", ".join(f"{columns[i].name} {change[i]:+.1f}" for i in worst)
    return [f"base parameters that change most, in standard errors: {listing or 'none by more than half of one'}"]


def _held(found: Consistency) -> list[str]:
    return [
        *(f"  {escape(a.where)}: {escape(a.constraint)}" for a in found.active),
        *(f"  {escape(n)}" for n in found.notes),
    ]


def export(done: Export) -> Page:
    """The file that was written, and the effects that its format cannot hold."""
    parts: list[Any] = []
    data: dict[str, Any] = {"file": str(done.path), "format": done.format, "notes": list(done.notes)}
    if done.consistency is not None:
        parts += [_verdict(done.consistency), *_changes(done.consistency), *_held(done.consistency)]
        data["consistency"] = consistency_data(done.consistency)
    data["difference"] = done.difference
    tables = [drives(done.model)] if done.format == "actuators" else [links(done.model), *_free(done.model)]
    told = () if done.consistency is None else done.consistency.notes
    parts += [*tables, *(f"  {escape(n)}" for n in done.notes if n not in told)]
    if done.difference is not None:
        parts.append(
            f"loaded again: the rigid torque (links without friction) on 50 random states differs from the model's by "
            f"{done.difference:.1e} of the largest torque"
        )
    alarms = alarms_of(done.model)
    data["alarms"] = [alarm.to_dict() for alarm in alarms]
    said = [f"{done.format} written to {done.path}"]
    if done.format == "MJCF":
        data["effects_file"] = None if done.effects_path is None else str(done.effects_path)
    if done.effects_path is not None:
        said.append(
            f"effects that the XML lacks written to {done.effects_path}: import the file, and call attach(model) "
            "before you simulate"
        )
    return Page(data, [*parts, *said], alarms)
