"""The whole of least squares against figaroh: regressor, reduction to base parameters, OLS, standard errors.

A UR10, 84 columns (60 inertial, viscous and Coulomb friction, rotor inertia, offset), nothing filtered or decimated,
the same states and torques in one run: figaroh in a process of its own (its pins may conflict; give `--python` an
interpreter that has it, `pip install figaroh`), frischid here, and a bare Pinocchio loop that stores nothing, in turn.
Both must predict the same torques. Times are processor time; ratios are medians over rounds.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from common import Worker, parser, publish

import frischid as fr
from frischid.estimators.least_squares import ols
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.accumulation import accumulate
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

WORKER = Path(__file__).with_name("figaroh_worker.py")
EFFECTS = "viscous, coulomb(width=1e-9), offset, rotor_inertia"
AGREE = 1e-6  # of a torque's spread


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--python", default=sys.executable, help="interpreter that has figaroh")
    arguments.add_argument("--samples", type=int, default=20_000)
    arguments.add_argument("--rounds", type=int, default=5)
    options = arguments.parse_args()
    robot = fr.Robot.load("ur10")
    effects = fr.parse_effects(EFFECTS)
    rate = 100.0
    log = fr.simulate(
        robot,
        fr.random_fourier(robot, (options.samples + 1) / rate, seed=1),
        rate=rate,
        effects=effects,
        parameters={f"{name}{i}": value for i in range(1, 7) for name, value in (("fv", 2.0), ("fc", 3.0))},
        noise=fr.Noise(tau=0.01),
    )
    log = log.slice(1, -1)  # it begins and ends at rest, where the sign of a speed is that of its rounding
    assert log.v is not None
    assert log.a is not None
    assert log.tau is not None
    motion = Motion(log.t, log.q, log.v, log.a, log.tau, np.zeros(log.q.shape, bool), "simulated")

    def ours() -> Any:
        regressor = Regressor(robot, effects)
        reduction = structure(regressor, robot.joints)
        grams = accumulate(regressor, [motion], LowPass(None), robot.joints, base=reduction.base)
        columns = reduction.base_columns()
        return regressor, reduction, ols([replace(g, columns=columns) for g in grams])

    full = robot.configuration(log.q)

    def bare() -> None:
        for x, y, z in zip(full, log.v, log.a, strict=True):
            pin.computeJointTorqueRegressor(robot.model, robot.data, x, y, z)

    times: dict[str, list[float]] = {"bare Pinocchio loop": [], "frischid": [], "figaroh": []}
    with tempfile.TemporaryDirectory() as folder:
        inputs = Path(folder) / "inputs.npz"
        np.savez(inputs, q=log.q, v=log.v, a=log.a, tau=log.tau)
        (Path(folder) / "robot.urdf").write_text(robot.urdf, encoding="utf-8")
        with Worker(options.python, WORKER, folder, "pip install figaroh") as other:
            for _ in range(options.rounds + 1):
                times["bare Pinocchio loop"].append(timed(bare)[0])
                seconds, (regressor, reduction, estimate) = timed(ours)
                times["frischid"].append(seconds)
                answer = other.run()
                times["figaroh"].append(answer["seconds"])
        theirs = np.load(Path(folder) / "answer.npz")
    Y = regressor(log.t, log.q, log.v, log.a)[:, list(reduction.base)]
    predicted = np.einsum("ncj,c->nj", Y, estimate.theta)
    difference = float((np.abs(predicted - theirs["predicted"]).max(axis=0) / log.tau.std(axis=0)).max())
    agree = difference < AGREE and len(estimate.theta) == len(theirs["stdev"])
    rows = [
        {
            "variant": name,
            "µs a sample": 1e6 * statistics.median(seconds[1:]) / len(log),
            "× bare loop": _ratio(seconds, times["bare Pinocchio loop"]),
            "× frischid": _ratio(seconds, times["frischid"]),
        }
        for name, seconds in times.items()
    ]
    faster, against_bare = _ratio(times["figaroh"], times["frischid"]), rows[1]["× bare loop"]
    notes = [
        f"{len(log)} samples of a UR10, {len(regressor.columns)} columns, {len(estimate.theta)} base parameters "
        f"(figaroh {len(theirs['stdev'])}), figaroh {answer['version']}, median of {options.rounds} rounds",
        f"frischid is {faster:.1f} × faster than figaroh (target 8): {'yes' if faster >= 8 else 'NO'}",
        f"frischid costs {against_bare:.2f} × the bare loop (target 3): {'yes' if against_bare <= 3 else 'NO'}",
        f"predicted torques differ by at most {difference:.1e} of their spread: {'same' if agree else 'NOT THE SAME'}",
    ]
    publish("regressor + reduction + OLS + standard errors", rows, options.json, notes)
    sys.exit(0 if agree else 1)


def timed(job: Callable[[], Any]) -> tuple[float, Any]:
    """Processor seconds of a call, and what it returned."""
    start = time.process_time()
    result = job()
    return time.process_time() - start, result


def _ratio(seconds: list[float], others: list[float]) -> float:
    return statistics.median(a / b for a, b in zip(seconds[1:], others[1:], strict=True))


if __name__ == "__main__":
    main()
