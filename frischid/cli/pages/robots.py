"""Robots and their identifiable parameters, as pages."""

from __future__ import annotations

from collections.abc import Sequence

from frischid.cli.pages.page import Page, figure, plain, table_of
from frischid.core.text import counted, listed
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.robot.mjcf_reading import unread_forces
from frischid.robot.robot import LINK_PARAMETERS, LINK_UNITS, Robot


def robots(names: Sequence[str]) -> Page:
    """Robots that can be loaded by name."""
    return Page(sorted(names), [", ".join(sorted(names))])


def robot(machine: Robot, regressor: Regressor, reduction: Reduction) -> Page:
    """Joints and identifiable parameters."""
    limits = machine.limits
    table = table_of(
        "joint", "", "kind", "lower", "upper", "speed", "torque", title=f"{machine.name}: {machine.source}"
    )
    joints = []
    for i, name in enumerate(machine.joints):
        kind = "prismatic" if machine.prismatic[i] else "revolute"
        values = [limits.lower[i], limits.upper[i], limits.velocity[i], limits.effort[i]]
        table.add_row(name, str(machine.numbers[name]), kind, *(figure(x) for x in values))
        keys = ("lower", "upper", "velocity", "effort")
        joints.append(
            {"name": name, "number": machine.numbers[name], "kind": kind}
            | dict(zip(keys, map(plain, values), strict=True))
        )
    base = [
        {"name": c.name, "expression": e, "unit": c.unit, "joint": c.joint, "effect": c.effect}
        for c, e in zip(reduction.base_columns(), reduction.expressions(), strict=True)
    ]
    columns = [c.name for c in reduction.columns]
    groups = {
        "identifiable_alone": [columns[i] for i in reduction.absolute],
        "identifiable_in_combination": [columns[i] for i in reduction.linear],
        "not_identifiable": [*(columns[i] for i in reduction.none), *machine.known],
    }
    regrouped = table_of("base parameter", "stands for", "unit", title=counted(reduction.rank, "base parameter"))
    for b in base:
        regrouped.add_row(b["name"], b["expression"], b["unit"])
    notes = [f"mimic joint {n} follows {x[0]}" for n, x in machine.mimics.items()]
    notes += [f"locked at {x:.4g} rad (m): {n}" for n, x in machine.locked.items()]
    unread = unread_forces(machine.urdf)
    notes += [f"not read, so not in the nominal torque: {listed(unread)}"] if unread else []
    notes += ["the URDF has no inertials: nominal torques are zero"] * (not machine.nominal.any())
    counts = (
        f"{counted(len(columns) + len(machine.known), 'parameter')}: "
        f"{len(groups['identifiable_alone'])} identifiable alone, "
        f"{len(groups['identifiable_in_combination'])} only in combination, {len(groups['not_identifiable'])} not "
        "at all"
        f"{f' ({len(machine.known)} of them known)' if machine.known else ''}; "
        f"rank {reduction.rank}, and the next singular value is {reduction.gap:.2g} times smaller"
        f"{f'; {cost}' if (cost := reduction.described_cost()) else ''}"
    )
    units = ", ".join(f"{p} {u}" for p, u in zip(LINK_PARAMETERS, LINK_UNITS, strict=True))
    data = {
        "name": machine.name,
        "source": machine.source,
        "gravity": list(machine.gravity),
        "joints": joints,
        "mimic": list(machine.mimics),
        "locked": dict(machine.locked),
        "effects": [str(e) for e in regressor.effects],
        "rank": reduction.rank,
        "gap": reduction.gap,
        "merging_cost": reduction.cost,
        "base_parameters": base,
        **groups,
    }
    return Page(data, [table, *notes, f"each link: {units}", counts, regrouped])
