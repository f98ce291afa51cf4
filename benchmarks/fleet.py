"""A simulated fleet with three altered robots, identified in one process and on a local Dask cluster.

Every robot has the first three joints of a UR5, friction of its own (it varies by one percent), and a motion of its own
(60 s at 50 Hz). One robot carries a payload, one has more friction, one stands on a tilted base, and one log is broken.
On the cluster, one worker is killed when half of the robots are done. Both ways must give the same figures.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import parser, publish

import frischid as fr
from frischid.core.parallel import Dask, Here, Workers
from frischid.fleet.fleet import identify_fleet
from frischid.fleet.log_paths import find_logs
from frischid.fleet.results import Fleet

FRICTION = {"fv1": 4.0, "fv2": 5.0, "fv3": 3.0, "fc1": 6.0, "fc2": 7.0, "fc3": 5.0}
ALTERED = [
    ("payload", ", payload@elbow_joint", {"dm3": 1.0, "dmx3": 0.3}),
    ("coulomb", "", {"fc2": 9.1, "fv2": 6.5}),
    ("gravity_tilt", ", gravity_tilt", {"tilt_x": 0.02}),
]


def main() -> None:
    """Print the tables."""
    arguments = parser(__doc__)
    arguments.add_argument("--robots", type=int, default=200)
    arguments.add_argument("--seconds", type=float, default=60.0)
    arguments.add_argument("--rate", type=float, default=50.0)
    arguments.add_argument("--workers", type=int, default=2)
    options = arguments.parse_args()
    robot = fr.Robot.load("ur5")
    robot = robot.keep(robot.joints[:3])
    places = np.linspace(0.2, 0.8, len(ALTERED)) * options.robots
    altered = {f"r{int(k):04d}": case[0] for k, case in zip(places, ALTERED, strict=True)}
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        record(robot, options, dict(zip(altered, ALTERED, strict=True)), Path(folder))
        made = time.perf_counter() - start
        pattern = [f"{folder}/**/*.parquet"]
        alone, seconds = identified(robot, pattern, Here())
        spread, elapsed, killed = on_a_cluster(robot, pattern, options.workers, options.robots // 2)
    rows = [
        {
            "robot": m.name,
            "altered": altered.get(m.name, ""),
            "named": m.effect,
            "× usual": m.excess,
            "p": f"{m.p_value:.1e}",
            "differs": m.differs,
        }
        for m in alone.members[:6]
    ]
    right = [m.effect.startswith(altered.get(m.name, "?")) for m in alone.members[: len(ALTERED)]]
    correct = all(right) and len(alone.different) == len(ALTERED)
    difference = float(np.abs(spread.model.estimate.theta / alone.model.estimate.theta - 1).max())
    same = difference < 1e-10 and [(m.name, m.effect) for m in spread.members] == [
        (m.name, m.effect) for m in alone.members
    ]
    samples = sum(m.samples for m in alone.members)
    bytes_of = sum(m.seconds for m in alone.members) / 3600
    p = len(alone.model.base)
    notes = [
        f"{len(alone.members)} robots, {samples} samples, {bytes_of:.3g} robot-hours, {p} base parameters; "
        f"simulated and written in {made:.0f} s",
        f"the altered robots first, each with its effect, and no other: {'yes' if correct else 'NO'}",
        f"logs skipped: {len(alone.skipped)}, {Path(alone.skipped[0].address).name}",
        f"one process {seconds:.1f} s; {options.workers} workers, one of them killed: {elapsed:.1f} s (wall clock)",
        f"worker killed: {'yes' if killed else 'NO'}; largest relative difference of a fleet parameter "
        f"{difference:.1e} (target 1e-10), same ranking and names: {'yes' if same else 'NO'}",
        f"moments of one robot: {8 * 3 * (p + 1) ** 2} bytes per block",
    ]
    publish("a fleet with three altered robots", rows, options.json, notes)
    sys.exit(0 if correct and same and killed else 1)


def record(robot: fr.Robot, options: Any, altered: dict[str, Any], folder: Path) -> None:
    """Write every robot's log."""
    for k in range(options.robots):
        rng = np.random.default_rng(k)
        name = f"r{k:04d}"
        _, more, values = altered.get(name, ("", "", {}))
        log = fr.simulate(
            robot,
            fr.random_fourier(robot, options.seconds, seed=k),
            rate=options.rate,
            effects=fr.parse_effects(f"viscous, coulomb, offset, rotor_inertia{more}"),
            parameters={n: x * (1 + 0.01 * rng.normal()) for n, x in FRICTION.items()} | values,
            noise=fr.Noise(q=2e-5, tau=0.02),
            channels=(),
            seed=k,
        )
        (folder / name).mkdir()
        fr.write_log(log, folder / name / "log.parquet")
    whole = folder / "r0003" / "log.parquet"
    (folder / "r0003" / "torn.parquet").write_bytes(whole.read_bytes()[:5000])


def identified(robot: fr.Robot, pattern: list[str], pool: Workers, progress: Any = None) -> tuple[Fleet, float]:
    """The fleet, and the seconds it took."""
    start = time.perf_counter()
    found = identify_fleet(robot, find_logs(pattern), workers=pool, progress=progress or (lambda _: None))
    return found, time.perf_counter() - start


def on_a_cluster(robot: fr.Robot, pattern: list[str], count: int, kill_at: int) -> tuple[Fleet, float, bool]:
    """The same on a local cluster; one of its processes is killed when `kill_at` robots are done."""
    from distributed import Client, LocalCluster

    killed = []
    with (
        LocalCluster(
            n_workers=count, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as cluster,
        Client(cluster) as client,
    ):

        def progress(text: str) -> None:
            if text.startswith(f"moments of {kill_at} ") and not killed:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        found, seconds = identified(robot, pattern, Dask(client), progress)
    return found, seconds, bool(killed)


if __name__ == "__main__":
    main()
