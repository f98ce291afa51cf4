"""Speed of least squares compared with figaroh: regressor, reduction to base parameters, OLS, standard errors.

The problem is a UR10 with 84 columns (60 inertial, viscous and Coulomb friction, rotor inertia, offset), without filter
or decimation. Three programs take turns on the same states and torques: figaroh, frischid, and a bare Pinocchio loop
that stores nothing. figaroh runs in a process of its own, because its pinned versions may conflict: `pip install
figaroh` in another environment, and pass its interpreter as `--python`. figaroh and frischid must predict the same
torques. Times are processor time; ratios are medians over rounds.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
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
AGREE = 1e-6  # share of a torque's standard deviation


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--python", default=sys.executable, help="interpreter that has figaroh")
    arguments.add_argument("--samples", type=int, default=20_000)
    arguments.add_argument("--rounds", type=int, default=5)
    options = arguments.parse_args()
    robot = fr.Robot.load("ur10")
    effects = fr.parse_effects(EFFECTS)
    motion = motion_of(robot, effects, options.samples)

    def ours() -> Any:
        regressor = Regressor(robot, effects)
        reduction = structure(regressor, robot.joints)
        grams = accumulate(regressor, [motion], LowPass(None), robot.joints, base=reduction.base)
        columns = reduction.base_columns()
        return regressor, reduction, ols([replace(g, columns=columns) for g in grams])

    full = robot.configuration(motion.q)

    def bare() -> None:
        for x, y, z in zip(full, motion.v, motion.a, strict=True):
            pin.computeJointTorqueRegressor(robot.model, robot.data, x, y, z)

    times: dict[str, list[float]] = {"bare Pinocchio loop": [], "frischid": [], "figaroh": []}
    with tempfile.TemporaryDirectory() as folder:
        inputs = Path(folder) / "inputs.npz"
        np.savez(inputs, q=motion.q, v=motion.v, a=motion.a, tau=motion.tau)
        (Path(folder) / "robot.urdf").write_text(robot.urdf, encoding="utf-8")
        with Worker(options.python, WORKER, folder, "pip install figaroh") as other:
            for _ in range(options.rounds + 1):
                times["bare Pinocchio loop"].append(timed(bare)[0])
                seconds, (regressor, reduction, estimate) = timed(ours)
                times["frischid"].append(seconds)
                answer = other.run()
                times["figaroh"].append(answer["seconds"])
        theirs = np.load(Path(folder) / "answer.npz")
    Y = regressor(motion.t, motion.q, motion.v, motion.a)[:, list(reduction.base)]
    predicted = np.einsum("ncj,c->nj", Y, estimate.theta)
    difference = float((np.abs(predicted - theirs["predicted"]).max(axis=0) / motion.tau.std(axis=0)).max())
    agree = difference < AGREE and len(estimate.theta) == len(theirs["stdev"])
    rows = [
        {
            "variant": name,
            "µs per sample": 1e6 * statistics.median(seconds[1:]) / len(motion.t),
            "× bare loop": _ratio(seconds, times["bare Pinocchio loop"]),
            "× frischid": _ratio(seconds, times["frischid"]),
        }
        for name, seconds in times.items()
    ]
    faster, against_bare = _ratio(times["figaroh"], times["frischid"]), rows[1]["× bare loop"]
    notes = [
        f"{len(motion.t)} samples of a UR10, {len(regressor.columns)} columns, {len(estimate.theta)} base parameters "
        f"(figaroh {len(theirs['stdev'])}), figaroh {answer['version']}, median of {options.rounds} rounds",
        f"frischid is {faster:.1f} × faster than figaroh (target 8): {'yes' if faster >= 8 else 'NO'}",
        f"frischid costs {against_bare:.2f} × the bare loop (target 3): {'yes' if against_bare <= 3 else 'NO'}",
        f"predicted torques differ by at most {difference:.1e} of their spread: {'same' if agree else 'NOT THE SAME'}",
    ]
    publish("regressor + reduction + OLS + standard errors", rows, options.json, notes)
    sys.exit(0 if agree else 1)


def motion_of(robot: fr.Robot, effects: Sequence[fr.Effect], samples: int, rate: float = 100.0) -> Motion:
    """Random motion with friction and noise, without the first and last sample."""
    log = fr.simulate(
        robot,
        fr.random_fourier(robot, (samples + 1) / rate, seed=1),
        rate=rate,
        effects=effects,
        parameters={f"{name}{i}": value for i in range(1, 7) for name, value in (("fv", 2.0), ("fc", 3.0))},
        noise=fr.Noise(tau=0.01),
    )
    log = log.slice(1, -1)  # the log begins and ends at standstill, where rounding decides the sign of a speed
    assert log.v is not None
    assert log.a is not None
    assert log.tau is not None
    return Motion(log.t, log.q, log.v, log.a, log.tau, np.zeros(log.q.shape, bool), "simulated")


def timed(job: Callable[[], Any]) -> tuple[float, Any]:
    """Processor seconds of a call, and its result."""
    start = time.process_time()
    result = job()
    return time.process_time() - start, result


def _ratio(seconds: list[float], others: list[float]) -> float:
    return statistics.median(a / b for a, b in zip(seconds[1:], others[1:], strict=True))


if __name__ == "__main__":
    main()
