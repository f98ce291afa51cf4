"""How often the bounds of an identified payload hold: random bodies on simulated arms.

A model is identified from logs of the bare robot, whose links differ from the URDF's. Bodies of random mass, centre and
inertia are carried through another motion, with friction that changed by some per cent. Printed are the error of the
mass and the share of truths inside the 95 % bounds.
"""

from __future__ import annotations

import numpy as np
from common import parser, publish

import frischid as fr
from frischid.effects import BASELINE
from frischid.regression.regressor import Regressor
from frischid.robot.inertia import dynamic_parameters

ROBOTS = {"ur10": {}, "xarm7": {}, "panda": {"joints": [f"panda_joint{k}" for k in range(1, 8)]}}


def body(rng: np.random.Generator, most: float) -> np.ndarray:
    """Ten parameters of a random body about the joint's frame: a cloud of mass around its centre."""
    m = float(rng.uniform(0.1, 1.0)) * most
    c = rng.normal(size=3) * 0.05 + np.array([0.0, 0.0, 0.05])
    spread = 0.04 * rng.uniform(0.5, 1.5, 3)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    P = np.zeros((4, 4))
    P[:3, :3] = m * (axes @ np.diag(spread**2) @ axes.T + np.outer(c, c))
    P[:3, 3] = P[3, :3] = m * c
    P[3, 3] = m
    return np.asarray(dynamic_parameters(P))


def main() -> None:
    """Run the benchmark and print its table."""
    options = parser(__doc__)
    options.add_argument("--runs", type=int, default=34, help="bodies of each robot")
    options.add_argument("--seed", type=int, default=500)
    options.add_argument("--friction-change", type=float, default=0.05)
    given = options.parse_args()
    rows = []
    for name, choice in ROBOTS.items():
        rng = np.random.default_rng(given.seed)
        robot = fr.Robot.load(name, **choice)
        known = {c.name for c in Regressor(robot, BASELINE).columns}
        true = {n: float(x * np.exp(0.1 * rng.normal())) for n, x in zip(robot.all_names, robot.nominal, strict=True)}
        for joint in robot.joints:
            k = robot.numbers[joint]
            true |= {f"fv{k}": 1.0, f"fc{k}": 1.5, f"Ia{k}": 0.1}
        true = {n: x for n, x in true.items() if n in known}
        noise = fr.Noise(q=2e-5, tau=0.02)
        motions = [fr.random_fourier(robot, 20, seed=given.seed + k) for k in (0, 1)]
        bare = [fr.simulate(robot, m, rate=100, parameters=true, noise=noise, seed=k) for k, m in enumerate(motions)]
        model = fr.identify(robot, bare, recursion="none").model
        last = robot.numbers[robot.joints[-1]]
        names = [f"{p}{last}" for p in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")]
        errors, inside, centres = [], [], []
        for run in range(given.runs):
            phi = body(rng, 0.1 * float(robot.nominal[0::10].sum()))
            loaded = dict(true)
            for n, x in zip(names, phi, strict=True):
                loaded[n] += float(x)
            for n in loaded:
                if n.startswith(("fv", "fc")):
                    loaded[n] *= 1 + given.friction_change * rng.normal()
            motion = fr.random_fourier(robot, 15, seed=given.seed + 100 + run)
            log = fr.simulate(robot, motion, rate=100, parameters=loaded, noise=noise, seed=100 + run)
            link = robot.frame_placement(robot.joints[-1])
            found = fr.payload(model, [log])
            flange = next((f for f in robot.model.frames if f.name == found.frame), None)
            place = link if flange is None else flange.placement
            truth = np.linalg.inv(place.homogeneous) @ np.append(phi[1:4] / phi[0], 1.0)
            errors.append(abs(found.mass / phi[0] - 1))
            inside.append(abs(found.mass - phi[0]) <= found.bound["mass"])
            bounds = [found.bound[k] for k in "xyz"]
            centres += list(np.abs(found.centre - truth[:3]) <= bounds)
        rows.append(
            {"robot": name, "bodies": given.runs, "median error of mass": float(np.median(errors)),
             "mass inside": float(np.mean(inside)), "centre inside": float(np.mean(centres))}
        )  # fmt: skip
    publish("identified payloads: bounds", rows, given.json)


if __name__ == "__main__":
    main()
