"""How firmly the constants of pushes against a still arm stand: each is halved and doubled.

Found: share of simulated pushes (half-sine of 0.3 to 2 s, 3 to 30 standard deviations of the rest's torque, white noise
or noise with a memory of 0.2 s, on one of six joints). False: contacts that are found on the rests of measured logs
(FRISCHID_DATA), where nothing pushed, and on simulated rests without a push.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from common import data_folder, multiplied, parser, publish
from trust import pairs, read

from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.standing import pushes
from frischid.logs.log import Log
from frischid.robot.robot import Robot

NAMES = ("push.seconds", "push.edge", "push.energy", "settling_seconds", "least_rest")
RATE, SECONDS, JOINTS = 100.0, 20.0, 6


def rest(rng: np.random.Generator, size: float) -> Log:
    """A rest with a push of this size, in standard deviations of the torque; 0: without."""
    t = np.arange(0.0, SECONDS, 1 / RATE)
    noise = rng.normal(size=(len(t), JOINTS))
    if rng.random() < 0.5:  # a drive's current: correlated over 0.2 s
        pole = np.exp(-1 / RATE / 0.2)
        for k in range(1, len(t)):
            noise[k] = pole * noise[k - 1] + np.sqrt(1 - pole**2) * noise[k]
    length, start = rng.uniform(0.3, 2.0), rng.uniform(3.0, 15.0)
    phase = (t - start) / length
    noise[:, rng.integers(JOINTS)] += size * np.sin(np.pi * phase) * ((phase > 0) & (phase < 1))
    names = tuple(f"j{k}" for k in range(JOINTS))
    return Log(t, names, np.zeros((len(t), JOINTS)), tau=5.0 + noise)


def measured_logs() -> list[Log]:
    """Every measured log of arms whose torque was recorded; none of them was pushed."""
    folder = data_folder()
    if folder is None:
        return []
    found: dict[tuple[str, str], Log] = {}
    for pair in pairs():
        urdf = next(p for p in sorted(Path(folder, pair.robot).glob("*.urdf")) if "with_hand" not in p.name)
        for part in (*pair.fit, pair.valid):
            if (pair.robot, part) not in found:
                found[pair.robot, part] = read(Path(folder), Robot.load(urdf), pair.robot, part)
    return list(found.values())


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--runs", type=int, default=60)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    rng = np.random.default_rng(given.seed)
    sizes = np.exp(rng.uniform(np.log(3), np.log(30), given.runs))
    pushed, clean = [rest(rng, size) for size in sizes], [rest(rng, 0.0) for _ in range(given.runs)]
    measured = measured_logs()

    def row(name: str, factor: float, criteria: CheckCriteria) -> dict[str, object]:
        found = np.array([bool(pushes(log, criteria)) for log in pushed])
        return {
            "constant": name, "times": factor, "found": float(found.mean()),
            "found above 8": float(found[sizes > 8].mean()),
            "false (simulated)": float(np.mean([bool(pushes(log, criteria)) for log in clean])),
            "false (measured)": sum(len(pushes(log, criteria)) for log in measured),
        }  # fmt: skip

    rows = [row("as it is", 1.0, DEFAULT_CRITERIA)]
    for name in NAMES:
        for factor in (0.5, 2.0):
            rows.append(row(name, factor, multiplied(DEFAULT_CRITERIA, name, factor)))
    publish("constants of pushes, halved and doubled", rows, given.json, [f"{len(measured)} measured logs"])


if __name__ == "__main__":
    main()
