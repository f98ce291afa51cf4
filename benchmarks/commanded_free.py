"""Are values free that a log of commands leaves open? Each is moved within its range, and the motion is simulated.

The logs are those of `commanded_mujoco.py`. `frischid.drive_parameters` calls a value identified where its 95 % range
lies within 5 %, and otherwise *roughly*, *in a sum* or *open*. Here every value goes to both ends of its range, and all
other parameters are fitted again with this value held: with the posterior covariance C of all parameters,

    θ(x) = θ + C e_k (x − θ_k) / C_kk.

The robot with these parameters follows the recorded commands, and commands of another motion, in closed loop from the
first sample to the last. *Moved*: rms difference from the positions that the fitted model simulates, as the largest
over the joints. If a value is free, the difference is below the noise of the encoders, count / √12. *Alone*: the same
difference with all other parameters kept, to show that the value acts on the motion at all.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from commanded_mujoco import ROBOTS, TRUE, recorded
from common import parser, publish

import frischid as fr
from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.forward.commanded_motion import moved
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

STEP = 0.002
"""s. Longest step of the simulation."""


def directions(model: fr.Model) -> tuple[Array, Array, list[str]]:
    """Change of the columns' values (C, n) per change of each parameter, others fitted again and others kept."""
    reduction = structure(Regressor(model.robot, model.effects), model.joints)
    base, K = list(reduction.base), reduction.mapping
    prior = model.prior
    assert prior is not None
    assert tuple(base) == tuple(model.base)
    before = prior.parameters.total_spread**2
    # the logs know base parameters only: C = G C_b Gᵀ + what the prior leaves, with K G = 1
    G = before[:, None] * K.T @ np.linalg.inv((K * before) @ K.T)
    after = before * (1.0 - prior.from_log)
    again, kept = np.zeros((2, K.shape[1], K.shape[1]))
    again[base] = model.estimate.covariance @ G.T / after
    kept[base] = K
    return again, kept, [c.name for c in columns_of(model.robot, model.effects)]


def positions(model: fr.Model, log: fr.Log, thetas: Array) -> Array:
    """Simulated positions (P, N, J) under the commands of a log, from the same start with each set of parameters."""
    (motion, source), *_ = moved(model, [log])
    forward = fr.ForwardDynamics(model, thetas, begin=motion.start)
    P = len(thetas)
    start = fr.Starts(
        np.repeat(motion.q[:1], P, axis=0), np.repeat(motion.v[:1], P, axis=0), np.repeat(motion.t[:1], P), np.arange(P)
    )
    return forward.simulate(source, start, motion.t - motion.t[0], step=STEP).q


def one(name: str, seed: int) -> list[dict[str, Any]]:
    """Every value of one run: its word, how far it was moved, and how far the simulated motion moved."""
    robot, log, _, controller = recorded(name, seed)
    other = recorded(name, seed, other=seed + 1000)[1]
    model = fr.identify(robot, [log], controller=controller, recursion="none").model
    again, kept, names = directions(model)
    values = [x for x in fr.drive_parameters(model) if x.quantity in TRUE]
    symbols = {"armature": "Ia", "viscous": "fv", "coulomb": "fc"}
    places = [names.index(f"{symbols[x.quantity]}{robot.numbers[x.joint]}") for x in values]
    ends = [(x, k, end - x.value) for x, k in zip(values, places, strict=True) for end in (x.lower, x.upper)]
    fitted = model.full_theta
    thetas = [fitted, *(fitted + way[:, k] * by for way in (again, kept) for _, k, by in ends)]
    logs = {"": log, " elsewhere": other}
    simulated = {said: positions(model, of, np.array(thetas)) for said, of in logs.items()}
    n, rows = len(ends), []
    for i, (x, _, by) in enumerate(ends):
        row = {"joint": x.joint, "quantity": x.quantity, "known": x.known, "seed": seed, "by": abs(by) / x.value}
        for said, q in simulated.items():
            for what, place in (("moved", 1 + i), ("alone", 1 + n + i)):
                off = np.sqrt(((q[place] - q[0]) ** 2).mean(axis=0)).max()
                row[what + said] = float(off) if np.isfinite(off) else float("inf")
        rows.append(row)
    return rows


def summary(name: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One line for each word."""
    noise = 2 * np.pi / ROBOTS[name]["counts"] / np.sqrt(12.0)
    lines = []
    for known in ("identified", "roughly", "in a sum", "open"):
        of = [r for r in rows if r["known"] == known]
        if not of:
            continue
        line: dict[str, Any] = {"robot": name, "runs": len({r["seed"] for r in rows}), "known": known}
        line |= {"moves": len(of), "by": float(np.median([r["by"] for r in of])), "noise mrad": 1e3 * noise}
        for what in ("moved", "moved elsewhere", "alone"):
            found = 1e3 * np.array([r[what] for r in of])
            line |= {f"{what} mrad": float(np.median(found)), f"most {what} mrad": float(found.max())}
        line["below noise"] = float(np.mean([r["moved"] <= noise for r in of]))
        lines.append(line)
    return lines


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--runs", type=int, default=5, help="seeds per robot")
    options.add_argument("--first", type=int, default=0, help="first seed")
    options.add_argument("--robots", nargs="+", choices=list(ROBOTS), default=list(ROBOTS))
    given = options.parse_args()
    seeds = range(given.first, given.first + given.runs)
    rows = [x for n in given.robots for x in summary(n, [r for seed in seeds for r in one(n, seed)])]
    publish("Values moved within their ranges: how far the simulated motion moves", rows, given.json)


if __name__ == "__main__":
    main()
