"""Missing effects of models of real robots: effects are added one by one, and the error is measured on a test log.

Needs FRISCHID_DATA. Three tables:

1. `improve` adds effects until none passes, on the logs the model was identified from. The validation log is a test
   log; the printed errors are those on the test log.
2. The loaded UR10e is diagnosed with the model of the unloaded one.
3. Candidates that cannot be true (columns of noise with the spectrum of the motion) are tried on measured logs, the
   validation log included, and on healthy simulated logs. The share that is accepted is the false alarm rate of the
   whole chain of tests.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, parser, publish
from real_robots import CASES, Case

import frischid as fr
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import passes, scored
from frischid.diagnosis.situation import cross_validator
from frischid.effects import Formula
from frischid.model.comparison import compare

PAYLOAD = 2.805  # kg, as weighed (the data set's card)
TRIALS = 200


def read(case: Case, folder: Path, paths: Any) -> list[fr.Log]:
    robot = fr.Robot.load(folder / case.urdf)
    return [fr.read_log(folder / path, robot.joints, case.mapping) for path in paths]


def row(added: str, error: float, why: str, *, robot: str = "", where: str = "") -> dict[str, Any]:
    return {"robot": robot, "added": added, "where": where, "NRMSE": error, "why": why}


def improved(case: Case, folder: Path) -> tuple[list[dict[str, Any]], fr.Model, fr.Model]:
    """The steps of one robot."""
    start = time.perf_counter()
    robot = fr.Robot.load(folder / case.urdf)
    fit, valid = read(case, folder, case.fit), read(case, folder, case.valid)
    base = fr.identify(robot, fit, torque_joints=case.torque_joints, recursion="none").model
    steps, last = fr.improve(base, fit, valid=valid)
    seconds = time.perf_counter() - start
    first = compare(base, valid).nrmse
    rows = [row("–", first, f"noise floor {last.noise_floor:.4f}", robot=case.name)]
    for step in steps:
        finding = step.finding
        assert finding is not None
        where = ", ".join(finding.joints) or "the robot"
        why = f"explains {finding.share:.0%} of the error above the sensor noise there, p {finding.p_value:.0e}"
        assert step.test_after is not None
        rows.append(row(finding.effect, step.test_after, why, where=where))
    final = steps[-1].model if steps else base
    last_error = compare(final, valid).nrmse
    rows.append(row("in all", last_error, f"{last_error / first - 1:+.0%}, {seconds:.0f} s"))
    return rows, base, final


def loaded(folder: Path, case: Case, base: fr.Model) -> list[dict[str, Any]]:
    """The loaded UR10e, diagnosed with the model of the unloaded one."""
    logs = read(case, folder, ["ur10e/logs/loaded_2805g_50s_14harm.parquet"])
    found = fr.diagnose(base, logs)
    best = found.findings[0]
    mass = next((x for name, x in best.parameters.items() if name.startswith("dm")), float("nan"))
    off = f"{mass / PAYLOAD - 1:+.1%}"
    return [{"verdict": found.verdict, "first": best.effect, "mass kg": mass, "true": PAYLOAD, "off": off}]


def irrelevant(validator: CrossValidator, rng: np.random.Generator) -> bool:
    """Whether a column that cannot be true is accepted as an effect on one joint."""
    row = int(rng.integers(len(validator.joints)))
    effect = Formula((validator.joints[row],), "t")
    candidate = validator.data.cache.given(effect, row, [made_up(t, rng) for t in validator.data.times])
    found = scored(validator, [candidate])
    return found is not None and passes(validator, found, 1)


def made_up(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random function of time as smooth as a robot's motion, or the sign of such a function, similar to friction."""
    frequency, phase = rng.uniform(0.03, 1.0, 12), rng.uniform(0, 2 * np.pi, 12)
    x = (rng.normal(size=12) * np.sin(2 * np.pi * frequency * t[:, None] + phase)).sum(axis=1)
    return np.sign(x) if rng.random() < 0.5 else x


def healthy(name: str, seed: int) -> CrossValidator:
    """Cross-validator of a simulated robot whose model misses no effect."""
    robot = fr.Robot.load(name)
    rng = np.random.default_rng(seed)
    dry = {f"{p}{k}": float(rng.uniform(0.5, 2.0)) for p in ("fv", "fc", "Ia") for k in robot.numbers.values()}
    logs = [
        fr.simulate(
            robot,
            fr.random_fourier(robot, 25.0, seed=seed + k),
            rate=200.0,
            parameters=dry,
            noise=fr.Noise(q=1e-5, tau=0.01),
            channels=(),
            seed=seed + k,
            name=f"{name} {k}",
        )
        for k in range(2)
    ]
    return cross_validator(fr.identify(robot, logs[:1], recursion="none").model, logs)[0]


def trials(validators: Mapping[str, CrossValidator], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Share of made-up candidates that are accepted."""
    rows = []
    for name, validator in validators.items():
        accepted = sum(irrelevant(validator, rng) for _ in range(TRIALS))
        rows.append({"logs of": name, "made-up candidates": TRIALS, "accepted": accepted, "share": accepted / TRIALS})
    total = sum(row["accepted"] for row in rows)
    tried = TRIALS * len(rows)
    return [*rows, {"logs of": "all", "made-up candidates": tried, "accepted": total, "share": total / tried}]


def main() -> None:
    options = parser(__doc__).parse_args()
    folder = data_folder()
    if folder is None:
        sys.exit("set FRISCHID_DATA to the folder of the measured logs")
    stairs: list[dict[str, Any]] = []
    validators = {f"{name}, simulated": healthy(name, 100 + k) for k, name in enumerate(("ur5", "planar2"))}
    payload: list[dict[str, Any]] = []
    for case in CASES:
        rows, base, final = improved(case, folder)
        stairs += rows
        validators[case.name] = cross_validator(base, [*read(case, folder, case.fit), *read(case, folder, case.valid)])[
            0
        ]
        if case.name == "ur10e":
            other = read(case, folder, ["ur10e/logs/valid_ptp_10_points.parquet"])
            before, after = (compare(model, other).nrmse for model in (base, final))
            stairs.append(row("point-to-point log", after, f"not used before; {before:.4f} without the effects"))
            payload = loaded(folder, case, base)
    publish("real robots: effects added, NRMSE on the test log", stairs, options.json)
    publish("the loaded UR10e with the model of the unloaded one", payload, None)
    publish("candidates that cannot be true", trials(validators, np.random.default_rng(0)), None)


if __name__ == "__main__":
    main()
