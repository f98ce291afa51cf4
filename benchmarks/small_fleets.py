"""Fleets of a dozen simulated arms whose friction varies: whether two altered arms are found, and others named.

Each arm is the first three joints of a UR5. Friction varies from arm to arm by a lognormal factor. One arm carries
2 kg, another one has 60 % more dry friction in the elbow.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from common import parser, publish
from fleet import FRICTION

import frischid as fr
from frischid.core.parallel import Here
from frischid.fleet.fleet import identify_fleet
from frischid.fleet.log_paths import find_logs

LOADED, WORN = "r003", "r008"


def record(robot: fr.Robot, size: int, spread: float, seed: int, folder: Path) -> None:
    """Write one log per arm."""
    for k in range(size):
        name, rng = f"r{k:03d}", np.random.default_rng([seed, k])
        friction = {n: x * float(np.exp(spread * rng.normal())) for n, x in FRICTION.items()}
        if name == WORN:
            friction["fc3"] *= 1.6
        load = ", payload@elbow_joint" if name == LOADED else ""
        log = fr.simulate(
            robot,
            fr.random_fourier(robot, 30.0, seed=1000 * seed + k),
            rate=50.0,
            effects=fr.parse_effects(f"viscous, coulomb, offset, rotor_inertia{load}"),
            parameters=friction | ({"dm3": 2.0, "dmx3": 0.8} if load else {}),
            noise=fr.Noise(q=2e-5, tau=0.02),
            channels=(),
            seed=1000 * seed + k,
        )
        (folder / name).mkdir()
        fr.write_log(log, folder / name / "log.parquet")


def fleet(size: int, spread: float, seed: int) -> dict[str, Any]:
    """What is named in one fleet."""
    robot = fr.Robot.load("ur5")
    robot = robot.keep(robot.joints[:3])
    with tempfile.TemporaryDirectory() as folder:
        record(robot, size, spread, seed, Path(folder))
        found = identify_fleet(robot, find_logs([f"{folder}/**/*.parquet"]), workers=Here())
    different = {member.name for member in found.different}
    return {
        "seed": seed,
        "arms": size,
        "friction varies by": spread,
        "load found": LOADED in different,
        "friction found": WORN in different,
        "unchanged arms named": len(different - {LOADED, WORN}),
    }


def main() -> None:
    """Print one row per fleet."""
    options = parser(__doc__)
    options.add_argument("--fleets", type=int, default=12)
    options.add_argument("--seed", type=int, default=0, help="seed of the first fleet")
    chosen = options.parse_args()
    seeds = range(chosen.seed, chosen.seed + chosen.fleets)
    rows = [fleet(12 + 2 * (k % 3), 0.03 if k % 2 else 0.1, seed) for k, seed in enumerate(seeds)]
    named = [sum(bool(row[key]) for row in rows) for key in ("load found", "friction found", "unchanged arms named")]
    note = f"{len(rows)} fleets: load found in {named[0]}, friction in {named[1]}, an unchanged arm named in {named[2]}"
    publish("Small fleets with two altered arms", rows, chosen.json, [note])


if __name__ == "__main__":
    main()
