"""Cost of the regressor and of its moments, as multiples of a bare Pinocchio loop that stores nothing.

All variants run in turn, for several rounds, in one process; the figures are medians of the ratios of processor time
within a round.
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from common import parser, publish

import frischid as fr
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.accumulation import accumulate
from frischid.regression.regressor import Regressor

TARGETS = {"full regressor": 1.6, "streamed into moments": 1.7}


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--robot", default="ur10")
    arguments.add_argument("--samples", type=int, default=20_000)
    arguments.add_argument("--rounds", type=int, default=7)
    options = arguments.parse_args()
    robot = fr.Robot.load(options.robot)
    regressor = Regressor(robot, fr.BASELINE)
    N, J = options.samples, len(robot.joints)
    rng = np.random.default_rng(0)
    q, v, a, tau = rng.uniform(-1, 1, (4, N, J))
    t = np.arange(N) * 1e-2
    motion = Motion(t, q, v, a, tau, np.zeros((N, J), bool), "random states")
    model, data, compute = robot.model, robot.data, pin.computeJointTorqueRegressor
    full_q = robot.configuration(q)

    def bare() -> None:
        for i in range(N):
            compute(model, data, full_q[i], v[i], a[i])

    variants: dict[str, Callable[[], object]] = {
        "bare Pinocchio loop": bare,
        "full regressor": lambda: regressor(t, q, v, a),
        "streamed into moments": lambda: accumulate(regressor, [motion], LowPass(None), robot.joints),
        "streamed, filtered at 8 Hz": lambda: accumulate(regressor, [motion], LowPass(8.0), robot.joints),
    }
    times: dict[str, list[float]] = {name: [] for name in variants}
    for _ in range(options.rounds + 1):
        for name, run in variants.items():
            start = time.process_time()
            run()
            times[name].append(time.process_time() - start)
    rows = []
    for name, seconds in times.items():
        ratios = [x / b for x, b in zip(seconds[1:], times["bare Pinocchio loop"][1:], strict=True)]
        target = TARGETS.get(name)
        rows.append(
            {
                "variant": name,
                "µs per sample": 1e6 * statistics.median(seconds[1:]) / N,
                "ratio": statistics.median(ratios),
                "target": "" if target is None else f"{target:g}",
                "reached": "" if target is None else ("yes" if statistics.median(ratios) <= target else "NO"),
            }
        )
    notes = [
        f"{options.robot}: {J} joints, {len(regressor.columns)} columns, {N} samples, median of {options.rounds} rounds"
    ]
    notes += [_memory(regressor, robot, length) for length in (N, 4 * N)]
    publish("regressor and moments against a bare Pinocchio loop", rows, options.json, notes)


def _memory(regressor: Regressor, robot: fr.Robot, samples: int) -> str:
    """Peak memory while a motion of some length streams into moments; the motion itself is a view of one row."""
    one = np.zeros((1, len(robot.joints)))
    still = np.zeros((1, len(robot.joints)), bool)
    view = [np.broadcast_to(x, (samples, len(robot.joints))) for x in (one, one + 0.1, one + 0.2, one + 0.3)]
    motion = Motion(np.arange(samples) * 1e-2, *view, np.broadcast_to(still, view[0].shape), "constant state")
    accumulate(regressor, [motion], LowPass(None), robot.joints)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return f"peak resident memory of the process after streaming {samples} samples: {peak:.0f} MiB"


if __name__ == "__main__":
    main()
