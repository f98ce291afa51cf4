"""Commands planned for the drives, beside a plain Fourier motion of the same length: width of the 95 % ranges.

The robots are those of `commanded_mujoco.py`: MuJoCo moves a robot with position actuators, whose links are 5 to 20 %
off the URDF, and the log has commands and quantised positions. Every motion has the same length, limits and budget of
its search:

- *random*: 25 random harmonics, as in the other benchmarks of commands;
- *plain*: `frischid excite`, the Fourier motion with the least condition number;
- *fourier*, *steps*, *chirps*, *steps+chirps*: `frischid excite --drives --family ...`.

`frischid.identify` gets the gains and the delay, once exactly and once with a doubt of 5 ms. Per kind of value: the
width of the 95 % range over the true value, geometric mean over the joints; and how many ranges hold the truth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from commanded_mujoco import BANDWIDTH, FINE_STEP, ROBOTS, SECONDS, TRUE, drawn_drive, followed, load
from common import parser, publish
from hidden_mujoco import mjcf
from hidden_physics import Drive, perturbed

import frischid as fr
from frischid.core.types import Array
from frischid.motions.collision import Clearance
from frischid.motions.trajectory import Trajectory

DOUBT = 0.005
"""s. Standard error of the delay in the second fit."""
AIMS = ("fourier", "steps", "chirps", "steps+chirps")


def motions(name: str, robot: fr.Robot, seed: int, budget: int) -> dict[str, Trajectory]:
    """Every motion by its name."""
    # A leg hangs from its clamped base; an arm stands on the floor.
    clearance = Clearance.of(robot, floor=None if "joints" in ROBOTS[name] else 0.0)
    options = fr.PlanOptions(duration=SECONDS, budget=budget, seed=seed, clearance=clearance)
    found: dict[str, Trajectory] = {"random": fr.random_fourier(robot, SECONDS, seed=seed, harmonics=25, scale=0.8)}
    found["plain"] = fr.plan(robot, options=options).trajectory
    for family in AIMS:
        found[family] = fr.plan_for_drives(robot, replace(options, family=family)).plan.trajectory
    return found


def recorded(
    name: str, robot: fr.Robot, drive: tuple[Drive, Array, Array], motion: Trajectory, seed: int
) -> tuple[fr.Log, fr.PDController]:
    """The log of one motion, and the true controller; `drive` with its gains kp and kd."""
    rule, (values, kp, kd) = ROBOTS[name], drive
    hold = round(1.0 / rule["rate"] / FINE_STEP)
    q = motion(np.arange(0.0, SECONDS, hold * FINE_STEP))[0]
    true = mjcf(perturbed(robot.model, np.random.default_rng(seed)), values, kp, kd, stiff=True)
    count = 2 * np.pi / rule["counts"]
    moved = np.round(followed(true, q, hold) / count) * count
    log = fr.Log(np.arange(len(q)) * hold * FINE_STEP, robot.joints, q=moved, qcmd=q, source=f"{name} {seed}")
    gains = [dict(zip(robot.joints, map(float, x), strict=True)) for x in (kp, kd)]
    return fr.stretch(log, start=0.5), fr.PDController(*gains, delay=2.0 * hold * FINE_STEP, held=True)


def compared(name: str, seed: int, budget: int) -> list[dict[str, Any]]:
    """One row per motion."""
    robot, rule = load(name), ROBOTS[name]
    t = np.arange(0.0, SECONDS, 1.0 / rule["rate"])
    found = motions(name, robot, seed, budget)
    values, _, _, inertia = drawn_drive(robot, found["random"](t), 0.4, np.random.default_rng(seed))
    drive = values, inertia * BANDWIDTH**2, 1.4 * inertia * BANDWIDTH
    rows = []
    for motion_name, motion in found.items():
        log, controller = recorded(name, robot, drive, motion, seed)
        row: dict[str, Any] = {"robot": name, "seed": seed, "motion": motion_name}
        inside, count = 0, 0
        for doubt in (0.0, DOUBT):
            told = replace(controller, delay_doubt=doubt)
            model = fr.identify(robot, [log], controller=told, recursion="none").model
            widths: dict[str, list[float]] = {}
            for x in fr.drive_parameters(model):
                if x.quantity not in TRUE and not (x.quantity == "delay" and doubt):
                    continue
                truth = float(controller.values("delay", robot.joints)[0])
                if x.quantity in TRUE:
                    truth = float(getattr(values, TRUE[x.quantity])[robot.joints.index(x.joint)])
                widths.setdefault(x.quantity, []).append(np.log((x.upper - x.lower) / truth))
                inside, count = inside + bool(x.lower <= truth <= x.upper), count + 1
            late = ", delay in doubt" if doubt else ""
            row |= {f"{kind}{late} %": 100 * float(np.exp(np.mean(w))) for kind, w in widths.items()}
        rows.append(row | {"inside": inside, "ranges": count})
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--robots", nargs="+", choices=list(ROBOTS), default=list(ROBOTS))
    options.add_argument("--seeds", nargs="+", type=int, default=[40])
    options.add_argument("--budget", type=int, default=3000, help="evaluations of each search")
    given = options.parse_args()
    rows = [row for name in given.robots for seed in given.seeds for row in compared(name, seed, given.budget)]
    publish("Commands planned for the drives: width of the 95 % ranges", rows, given.json)


if __name__ == "__main__":
    main()
