"""The lag of the torque that every fit estimates: simulated logs whose lag is known, and the measured robots.

Two simulated arms record three motions each: without a lag, with a torque half a sample late at 200 Hz, with a torque
that is held for one sample at 500 Hz, with friction that has memory, and with a model whose friction is smoothed 50
times too sharply. A table of the site shows the least and the greatest lag of each kind, and how often a lag is said.
Every log is fitted twice: with the torque as recorded, and as `identify` does by default, which takes a lag of about a
sample back. Both cross-validated errors are compared with that of the same log without a lag. With FRISCHID_DATA, the
pairs of measured logs of `trust.py` follow: both errors on the log that was not fitted.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from common import data_folder, parser, publish
from scipy.interpolate import make_interp_spline
from trust import Pair, loaded, pairs

import frischid as fr
from frischid.core.types import Array
from frischid.effects import BASELINE, parse_effects
from frischid.motions.simulation import parameters_of, torque
from frischid.motions.trajectory import Trajectory

ARMS = ("planar2", "ur10")
SEEDS = (2, 3, 4)
SECONDS, NOISE, ENCODER = 20.0, 0.01, 1e-5
VISCOUS, DRY, ARMATURE = 0.05, 0.06, 0.05  # shares of the torque's range a joint, over its speed and acceleration
MEMORY = "hysteresis(distance=0.01)"
WIDTH, SHARP = 0.05, 0.001
AS_RECORDED_OR_BACK: tuple[float | Literal["auto"], ...] = (0.0, "auto")


@dataclass(frozen=True)
class Kind:
    """One way of recording: rate, Hz; delay of the torque, s; effects of the arm and of the model."""

    name: str
    rate: float
    late: Callable[[Array, Array], Array] | None = None
    arm: str = "viscous,coulomb,rotor_inertia"
    model: str = "viscous,coulomb,rotor_inertia"


def half_a_sample(t: Array, tau: Array) -> Array:
    """The torque of half a sample ago."""
    spline = make_interp_spline(t, tau, k=3, axis=0)
    return np.asarray(spline(np.clip(t - 0.5 * (t[1] - t[0]), t[0], t[-1])))


def held(t: Array, tau: Array) -> Array:
    """The mean of this sample's torque and the last one: a command that is held for a sample, half a sample late."""
    return np.concatenate([tau[:1], 0.5 * (tau[1:] + tau[:-1])])


KINDS = (
    Kind("no lag", 200.0),
    Kind("half a sample late at 200 Hz", 200.0, half_a_sample),
    Kind("held for a sample at 500 Hz", 500.0, held),
    Kind("friction with memory", 200.0, arm=f"viscous,coulomb,rotor_inertia,{MEMORY}"),
    Kind(
        "friction smoothed too sharply",
        200.0,
        arm=f"viscous,coulomb(width={WIDTH}),rotor_inertia",
        model=f"viscous,coulomb(width={SHARP}),rotor_inertia",
    ),
)


def parameters(robot: fr.Robot, motion: Trajectory) -> dict[str, float]:
    """Friction and armature in proportion to each joint's torque on this motion."""
    t = np.arange(round(SECONDS * 100)) / 100
    q, v, a = motion(t)
    load = torque(robot, BASELINE, parameters_of(robot, BASELINE), t, q, v, a).std(axis=0)
    sizes: Mapping[str, Array] = {
        "fv": VISCOUS * load / v.std(axis=0),
        "fc": DRY * load,
        "fh": DRY * load,
        "Ia": ARMATURE * load / a.std(axis=0),
    }
    return {f"{kind}{k + 1}": float(x[k]) for kind, x in sizes.items() for k in range(len(robot.joints))}


def fitted(kind: Kind, log: fr.Log, robot: fr.Robot, lag: float | Literal["auto"]) -> fr.Identification:
    """The model of a log."""
    return fr.identify(robot, [log], effects=parse_effects(kind.model), recursion="none", torque_lag=lag)


def simulated(kind: Kind, name: str, seed: int) -> dict[str, Any]:
    """One motion of one arm: the lag, what is said, and the error over that of the log without the lag."""
    robot = fr.Robot.load(name)
    motion = fr.random_fourier(robot, SECONDS, seed=seed)
    effects = parse_effects(kind.arm)
    values = {name: x for name, x in parameters(robot, motion).items() if "fh" not in name or MEMORY in kind.arm}
    true = fr.simulate(
        robot, motion, rate=kind.rate, effects=effects, parameters=values, noise=fr.Noise(q=ENCODER, tau=NOISE),
        channels=(), seed=seed,
    )  # fmt: skip
    assert true.tau is not None
    log = true if kind.late is None else replace(true, tau=kind.late(true.t, true.tau))
    left, found = (fitted(kind, log, robot, lag) for lag in AS_RECORDED_OR_BACK)
    clean = None if kind.late is None else error(fitted(kind, true, robot, 0.0))
    return row(found, kind=kind.name, robot=name, seed=seed) | errors(error(left), error(found), clean)


def errors(left: float, taken: float, clean: float | None) -> dict[str, Any]:
    """Errors with the torque as recorded and with the lag taken back, and over the error without a lag."""
    return {
        "error, torque as recorded": left,
        "error, lag taken back": taken,
        "error over that without the lag": None if clean is None else left / clean,
        "taken back, over that without the lag": None if clean is None else taken / clean,
    }


def error(found: fr.Identification) -> float:
    """Cross-validated NRMSE."""
    return fr.headline(found.model).nrmse


def row(found: fr.Identification, *, kind: str, robot: str, seed: int | None = None, logs: str = "") -> dict[str, Any]:
    """The lag of a fit; `said` is the sentence, or else the note."""
    lag = found.torque_lag
    said = "nothing"
    if lag is not None and lag.significant:
        said = "behind" if lag.lag > 0 else "ahead"
    elif any(note.startswith("the torque seems to lag") for note in found.notes):
        said = "the joints differ"
    return {
        "kind": kind,
        "robot": robot,
        "seed": seed,
        "logs": logs,
        "lag, ms": None if lag is None else 1e3 * lag.lag,
        "standard error, ms": None if lag is None else 1e3 * lag.error,
        "taken back, ms": None if lag is None else 1e3 * lag.taken,
        "said": said,
    }


def measured(folder: Path, pair: Pair) -> dict[str, Any]:
    """One pair of measured logs, with the errors on the log that was not fitted."""
    robot, fit, valid, options = loaded(pair, folder)
    left, found = (fr.identify(robot, fit, torque_lag=lag, **options) for lag in AS_RECORDED_OR_BACK)
    there = [fr.compare(x.model, [valid]).nrmse for x in (left, found)]
    named = f"{pair.fitted} → {pair.valid}"
    if pair.cutoff or pair.effects:
        named += f" ({pair.effects or f'{pair.cutoff:g} Hz'})"
    return row(found, kind="measured", robot=pair.robot, logs=named) | errors(*there, None)


def main() -> None:
    """Print every run."""
    options = parser(__doc__)
    options.add_argument("--kinds", type=int, default=len(KINDS), help="kinds of simulated logs, from the first")
    chosen = options.parse_args()
    rows = [simulated(kind, arm, seed) for kind in KINDS[: chosen.kinds] for arm in ARMS for seed in SEEDS]
    folder = data_folder()
    if folder is None:
        print("FRISCHID_DATA is not set: the measured robots are left out", file=sys.stderr)
    else:
        rows += [measured(folder, pair) for pair in pairs()]
    publish("the lag of the torque", rows, chosen.json, ["one fit per row; lags with one standard error"])


if __name__ == "__main__":
    main()
