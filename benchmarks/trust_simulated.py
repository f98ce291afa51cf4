"""Does an alarm come before a bad surprise? Simulated identifications with random motions, lengths and model errors.

The truth differs from the URDF by a factor of 0.5 to 2 per link, and holds effects that the model lacks (up to 3 % of
the torque each). Those are functions of the motion: no alarm can precede a change of the robot over time. The motion to
fit has a random length and a random amplitude; so has the motion of the other log. The model fails *elsewhere* when its
error on the other log is more than twice the cross-validated one. Both errors are in N·m, as shares of the torque of
the fitted log: relative to its own torque, a gentle motion has a large error from the same noise, and no model is wrong
there. An alarm came *before* when `identify` raised it, or when the comparison raised it from the other log's motion.

Prints, of the identifications that fail elsewhere, the share with an alarm, and of the others the share without.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from common import parser, publish

import frischid as fr

ROBOTS = ("planar2", "z1", "kinova", "ur10", "panda", "xarm7")
HIDDEN = ("stribeck(0.1)", "quadratic_viscous", "cogging(12)", "hysteresis(0.05)", "load_friction")
BEFORE = {"log-leaves-open", "log-too-short", "cut-off-admits-noise", "extrapolation"}
"""Severe alarms that need no torque of the other log."""
WORSE = 2.0
"""Held-out over cross-validated error, both in N·m, from which a model fails elsewhere."""


USUAL = {"fv": 0.1, "fc": 0.1, "off": 0.02, "Ia": 0.02}
"""Size of a parameter of the baseline, as a share of the joint's torque at unit acceleration."""


def truth(robot: fr.Robot, effects: Sequence[fr.Effect], rng: np.random.Generator) -> dict[str, float]:
    """Parameters of the simulated robot: each link wrong by one factor in the URDF, friction of usual size."""
    factor = {name: float(np.exp(rng.uniform(np.log(0.5), np.log(2.0)))) for name in robot.joints}
    still = np.zeros((1, len(robot.joints)))
    load = np.abs(robot.inverse_dynamics(still, still, np.ones_like(still)))[0] + 0.1
    link = {f"{number}": name for name, number in robot.numbers.items()}
    values = {
        name: float(value) * factor[link[name.lstrip("mxyzI")]]
        for name, value in zip(robot.all_names, robot.nominal, strict=True)
        if link[name.lstrip("mxyzI")] in factor
    }
    for column in (c for effect in effects for c in effect.columns(robot)):
        size = USUAL.get(column.name.rstrip("0123456789"), 0.0)
        values[column.name] = size * abs(rng.normal()) * float(load[robot.joints.index(column.joint)])
    return values


def hidden(
    robot: fr.Robot, motion: fr.Fourier, known: Sequence[fr.Effect], values: dict[str, float], rng: np.random.Generator
) -> tuple[list[fr.Effect], dict[str, float]]:
    """Effects that the model lacks, each up to 3 % of its joint's torque along the fitted motion."""
    names = [str(name) for name in rng.choice(HIDDEN, size=int(rng.integers(0, 4)), replace=False)]
    effects, found = fr.parse_effects(", ".join(names)) if names else (), dict(values)
    base = fr.simulate(robot, motion, rate=50.0, effects=known, parameters=values).tau.std(axis=0)
    for effect in effects:
        columns = effect.columns(robot)
        for column in columns:
            j = robot.joints.index(column.joint)
            alone = {c.name: float(c is column) for c in columns}
            unit = fr.simulate(robot, motion, rate=50.0, effects=[effect], parameters={**zero(robot), **alone}).tau
            sign = float(column.sign) if column.sign else float(rng.choice([-1.0, 1.0]))
            power = float(np.sqrt(np.mean(unit[:, j] ** 2)))
            found[column.name] = sign * rng.uniform(0.0, 0.03) * float(base[j]) / power if power > 0 else 0.0
    return list(effects), found


def zero(robot: fr.Robot) -> dict[str, float]:
    """No links at all."""
    return dict.fromkeys(robot.all_names, 0.0)


def case(seed: int) -> dict[str, Any]:
    """One identification, its alarms, and its error elsewhere."""
    rng = np.random.default_rng([seed, 19])
    name = str(rng.choice(ROBOTS))
    robot = fr.Robot.load(name)
    known = fr.parse_effects("viscous, coulomb(0.005), offset, rotor_inertia")
    seconds = float(np.exp(rng.uniform(np.log(3.0), np.log(60.0))))
    fit, other = (
        fr.random_fourier(robot, length, seed=int(rng.integers(2**31)), scale=float(rng.uniform(0.1, 0.9)))
        for length in (seconds, float(rng.uniform(5.0, 30.0)))
    )
    values = truth(robot, known, rng)
    missing, values = hidden(robot, fit, known, values, rng)
    noise = fr.Noise(q=float(10 ** rng.uniform(-6, -4)), tau=float(10 ** rng.uniform(-2.5, -1.5)))
    logs = [
        fr.simulate(
            robot,
            motion,
            rate=200.0,
            effects=(*known, *missing),
            parameters=values,
            noise=noise,
            channels=(),
            seed=number,
        )
        for number, motion in enumerate((fit, other))
    ]
    found = fr.identify(robot, logs[:1], recursion="none", force=True)
    there = fr.compare(found.model, logs[1:])
    within, spread = float(np.mean(list(found.cross_validation.values()))), found.model.fitted.spread
    error = float(np.mean(np.array([j.rmse for j in there.joints]) / spread))
    before = sorted({a.id for a in (*found.alarms, *there.alarms)} & BEFORE)
    return {
        "seed": seed,
        "robot": name,
        "seconds": seconds,
        "missing": ", ".join(e.id for e in missing) or "–",
        "cross-validated": within,
        "held out": there.nrmse,
        "expected": float(np.mean([j.expected for j in there.joints])),
        "ratio": error / within,
        "before": ", ".join(before) or "–",
        "at identify": ", ".join(a.id for a in found.alarms) or "–",
        "after": ", ".join(sorted({a.id for a in there.alarms} - BEFORE)) or "–",
    }


def summary(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Share of bad surprises that an alarm precedes, and of the others without an alarm."""
    bad = [row for row in rows if row["ratio"] > WORSE]
    good = [row for row in rows if row["ratio"] <= WORSE]
    warned = sum(row["before"] != "–" for row in bad)
    silent = sum(row["before"] == "–" for row in good)
    return [
        f"fail elsewhere: {len(bad)} of {len(rows)}, an alarm came before in {warned}",
        f"do not: {len(good)}, without an alarm {silent}",
    ]


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--seed", type=int, default=0, help="first seed")
    options.add_argument("--count", type=int, default=60, help="identifications")
    chosen = options.parse_args()
    rows = [case(seed) for seed in range(chosen.seed, chosen.seed + chosen.count)]
    publish("trust: alarms before a bad surprise", rows, chosen.json, summary(rows))


if __name__ == "__main__":
    main()
