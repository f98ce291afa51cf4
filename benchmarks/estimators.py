"""Every estimator of frischid on the same noisy logs: bias, error, joint coverage, width of the bounds, processor time.

Two robots: the paper's planar arm along the authors' points (or along a random Fourier motion of the same length if
FRISCHID_DATA is not set), and a UR10 along a random 20 s Fourier motion. White noise σ_q on q, 2σ_q on q̇ and q̈, 1 N·m
on the torque. No run is discarded; a run in which a method gives no bounds counts as one that does not cover.

For each method, over the runs:

- *bias*: the mean error of a parameter in units of its standard deviation over the runs, rms over the parameters;
- *error*: a parameter's rms error over that of OLS, mean over the parameters, and the worst parameter;
- *cover*: share of runs in which the box, or the estimate ± Bonferroni t standard errors, holds all parameters at
  once;
- *width*: median width of a friction parameter's bounds, as a multiple of its true value, mean over the parameters;
- *gain*: the classical Frisch box's median width over the method's, for the friction parameter with the least ratio.

``sensor-wise`` knows nothing about the noise; ``sensor-wise, log`` estimates an upper limit from the log (one and a
half times `noise_levels`); ``sensor-wise, data sheet`` is given the standard deviations of q, q̇, q̈ as ranges from
half to one and a half times the true ones. ``eiv`` is given them exactly; ``eiv, estimated`` estimates them from the
log. ``iv`` makes its reference from the log; ``iv, reference`` has the recorded one.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from common import data_folder, parser, pool, publish
from planar_case import DURATION, EFFECTS, RATE, ROTORS
from scipy.stats import t as student
from threadpoolctl import threadpool_limits

import frischid as fr
from frischid.core.types import Array, Column
from frischid.errors import FrischidError
from frischid.estimators.bbrf import bbrf
from frischid.estimators.box_qp import select
from frischid.estimators.errors_in_variables import eiv
from frischid.estimators.frisch import Box, simplex
from frischid.estimators.instrumental_variables import iv
from frischid.estimators.least_squares import Estimate, ols, wls
from frischid.estimators.sensor_noise import noise_limits, sensor_moments
from frischid.estimators.sensorwise import sensorwise
from frischid.estimators.state_samples import samples
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.motions.simulation import parameters_of, torque
from frischid.motions.trajectory import Trajectory
from frischid.regression.accumulation import accumulate
from frischid.regression.block import stack
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

LEVELS = (1e-3, 1e-2, 5e-2)
TORQUE_NOISE, CONFIDENCE, WINDOW, WINDOWS = 1.0, 0.95, 1000, 400
NOTHING = LowPass(None)
ROBOTS = ("planar2", "ur10")


@dataclass(frozen=True, eq=False)
class Case:
    """A robot with its true parameters and its noise-free motion."""

    regressor: Regressor
    base: tuple[int, ...]
    columns: tuple[Column, ...]
    theta: Array
    trajectory: Trajectory
    clean: Motion

    @property
    def friction(self) -> list[int]:
        """Positions of the friction parameters."""
        return [i for i, c in enumerate(self.columns) if c.effect in {"viscous", "coulomb"}]


@lru_cache(maxsize=2)
def case_of(name: str, folder: Path | None, seed: int) -> Case:
    """Load a robot by name and give it a motion."""
    if name == "planar2":
        robot = fr.Robot.load(name, frames="far_end", known={"my1": 0.0, "my2": 0.0})
        effects, values, rate = fr.parse_effects(EFFECTS), ROTORS, RATE
        motion: Trajectory = fr.random_fourier(robot, DURATION, seed=seed)
        if folder is not None:
            table = np.loadtxt(folder / "frisch_planar" / "exciting_points.csv", delimiter=",", skiprows=1)
            motion = fr.Quintic(table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5:7])
    else:
        robot = fr.Robot.load(name)
        effects, rate = fr.parse_effects("viscous, coulomb(width=1e-6), rotor_inertia"), 100.0
        motion = fr.random_fourier(robot, 20.0, seed=seed, harmonics=8)
        size = np.linspace(10.0, 2.0, len(robot.joints))
        values = {
            f"{p}{j + 1}": float(s * x) for j, x in enumerate(size) for p, s in (("fv", 1), ("fc", 1), ("Ia", 0.3))
        }
    regressor = Regressor(robot, effects)
    reduction = structure(regressor, robot.joints)
    theta = parameters_of(robot, effects, values)
    t = np.arange(round(motion.duration * rate) + 1) / rate
    q, v, a = motion(t)
    tau = torque(robot, effects, theta, t, q, v, a)
    clean = Motion(t, q, v, a, tau, np.zeros(q.shape, bool), name)
    return Case(regressor, reduction.base, reduction.base_columns(), reduction.mapping @ theta, motion, clean)


@dataclass(frozen=True, eq=False)
class Answer:
    """Result of one method on one log; bounds are None where the method gave none."""

    theta: Array
    box: Box | None
    seconds: float


@dataclass(frozen=True, eq=False)
class Noisy:
    """One noisy log, and the data that all methods use; blocks are moments of the base columns in stretches of time."""

    case: Case
    sigma: float
    motion: Motion
    blocks: list[Gram]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints with a torque: all."""
        return self.case.regressor.robot.joints

    @property
    def names(self) -> list[str]:
        """Names of the base parameters."""
        return [c.name for c in self.case.columns]

    @property
    def moments(self) -> Array:
        """Mean moments of [Y τ], rows of equal weight."""
        whole = total(self.blocks)
        return np.asarray(whole.weighted() / whole.rows)

    @property
    def levels(self) -> dict[str, float]:
        """True standard deviations of the noise."""
        return {"q": self.sigma, "v": 2 * self.sigma, "a": 2 * self.sigma, "torque": TORQUE_NOISE}


def noisy(case: Case, sigma: float, rng: np.random.Generator) -> Noisy:
    """Record the motion with fresh noise."""
    m = case.clean
    q, v, a = (x + s * sigma * rng.normal(size=x.shape) for x, s in ((m.q, 1), (m.v, 2), (m.a, 2)))
    motion = replace(m, q=q, v=v, a=a, tau=m.tau + TORQUE_NOISE * rng.normal(size=m.tau.shape))
    blocks = accumulate(case.regressor, [motion], NOTHING, case.regressor.robot.joints)
    return Noisy(case, sigma, motion, [replace(g.select(list(case.base)), columns=case.columns) for g in blocks])


def interval(log: Noisy, estimate: Estimate) -> tuple[Array, Box]:
    """Estimate, and joint bounds from its standard errors."""
    p, B = len(estimate.theta), len(log.blocks)
    reach = student.isf((1 - CONFIDENCE) / (2 * p), B - 1) * estimate.stderr
    return estimate.theta, Box(tuple(log.names), estimate.theta - reach, estimate.theta + reach)


def in_box(log: Noisy, box: Box | None) -> tuple[Array, Box | None]:
    """The point of a box that fits best, NaN where there is no box."""
    if box is None:
        return np.full(len(log.names), np.nan), None
    return select(log.moments, box).theta, box


def recursed(variant: Literal["strict", "undo", "calibrated"]) -> Callable[[Noisy], tuple[Array, Box | None]]:
    """BBRF of one variant."""

    def run(log: Noisy) -> tuple[Array, Box | None]:
        case, p = log.case, len(log.names)
        Y, tau, _ = stack(list(case.regressor.blocks(log.motion, NOTHING)), case.regressor.robot, log.joints)
        rows = np.column_stack([Y[:, list(case.base)], tau])
        if variant == "calibrated":
            found = bbrf(
                rows, log.names, window=len(rows) // 2, signs=[c.sign for c in case.columns], variant="calibrated"
            )
        else:
            window = max(WINDOW, 20 * p)
            stride = max(1, (len(rows) - window) // (10_000 if p < 20 else WINDOWS))
            signs = [c.sign for c in case.columns]
            found = bbrf(rows, log.names, window=window, stride=stride, signs=signs, variant=variant)
        return in_box(log, None if found.emptied is not None else found.box)

    return run


def sensors(known: str) -> Callable[[Noisy], tuple[Array, Box | None]]:
    """Sensor-wise scheme, with limits of the noise from a data sheet, from the log, or without any."""

    def run(log: Noisy) -> tuple[Array, Box | None]:
        case = log.case
        start = ols(log.blocks) if len(log.joints) == 2 else wls(log.blocks)
        data = sensor_moments(case.regressor, [log.motion], NOTHING, log.joints, case.base, start)
        limits: dict[str, tuple[float, float]] = {}
        if known == "log":
            limits = noise_limits([log.motion], case.regressor.robot, NOTHING)
        if known == "sheet":
            true = {n: log.levels[n.split()[0]] for n in data.sensors[:-1]}
            limits = {n: (0.5 * s, 1.5 * s) for n, s in true.items()}
        result = sensorwise(data, limits=limits, confidence=CONFIDENCE)
        return result.theta, result.box

    return run


def likelihood(given: bool) -> Callable[[Noisy], tuple[Array, Box | None]]:
    """Errors in variables, with noise levels that are given or estimated."""

    def run(log: Noisy) -> tuple[Array, Box | None]:
        sigma = log.levels if given else None
        stretches = samples(log.case.regressor, [log.motion], NOTHING, log.joints, log.case.base, sigma=sigma)
        return interval(log, eiv(stretches, log.case.columns, log.joints))

    return run


def instruments(known: bool) -> Callable[[Noisy], tuple[Array, Box | None]]:
    """Instrumental variables, with a reference that is recorded or made from the log."""

    def run(log: Noisy) -> tuple[Array, Box | None]:
        references = [log.case.trajectory] if known else None
        start = wls(log.blocks)
        return interval(log, iv(log.case.regressor, [log.motion], NOTHING, log.case.base, start, references=references))

    return run


METHODS: dict[str, Callable[[Noisy], tuple[Array, Box | None]]] = {
    "ols": lambda log: interval(log, ols(log.blocks)),
    "wls": lambda log: interval(log, wls(log.blocks)),
    "frisch box": lambda log: in_box(log, simplex(log.moments, log.names).box()),
    "bbrf strict": recursed("strict"),
    "bbrf undo": recursed("undo"),
    "bbrf calibrated": recursed("calibrated"),
    "sensor-wise": sensors(""),
    "sensor-wise, log": sensors("log"),
    "sensor-wise, data sheet": sensors("sheet"),
    "eiv": likelihood(True),
    "eiv, estimated": likelihood(False),
    "iv": instruments(False),
    "iv, reference": instruments(True),
}


def answers(work: tuple[str, Path | None, int, float, Sequence[str], Sequence[int]]) -> list[dict[str, Answer]]:
    """Do some runs, in any process."""
    name, folder, seed, sigma, methods, numbers = work
    case = case_of(name, folder, seed)
    found = []
    with threadpool_limits(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for k in numbers:
            log = noisy(case, sigma, np.random.default_rng([seed, round(sigma * 1e9), k]))
            said = {}
            for method in methods:
                start = time.process_time()
                try:
                    theta, box = METHODS[method](log)
                except FrischidError:
                    theta, box = np.full(len(case.theta), np.nan), None
                said[method] = Answer(theta, box, time.process_time() - start)
            found.append(said)
    return found


def summary(case: Case, name: str, sigma: float, runs: Sequence[dict[str, Answer]]) -> list[dict[str, Any]]:
    """One row per method."""
    friction = case.friction
    reference = np.sqrt(np.mean([(r["ols"].theta - case.theta) ** 2 for r in runs], axis=0))
    classical = _median_width(runs, "frisch box")
    rows = []
    for method in runs[0]:
        error = np.array([r[method].theta for r in runs]) - case.theta
        error = error[np.isfinite(error).all(axis=1)]
        boxes = [r[method].box for r in runs]
        width = _median_width(runs, method)
        ratio = np.sqrt(np.mean(error**2, axis=0)) / reference if len(error) else np.full(len(reference), np.nan)
        bias = error.mean(axis=0) / error.std(axis=0) if len(error) > 1 else np.full(len(reference), np.nan)
        rows.append(
            {
                "robot": name,
                "σ_q": sigma,
                "method": method,
                "runs": len(runs),
                "empty %": 100.0 * float(np.mean([b is None for b in boxes])),
                "bias": float(np.sqrt(np.mean(bias**2))),
                "error": float(ratio.mean()),
                "worst": float(ratio.max()),
                "cover %": 100.0 * float(np.mean([b is not None and b.contains(case.theta) for b in boxes])),
                "width": float(np.mean(width[friction] / np.abs(case.theta[friction]))),
                "gain": float((classical / width)[friction].min()),
                "s/run": float(np.median([r[method].seconds for r in runs])),
            }
        )
    return rows


def _median_width(runs: Sequence[dict[str, Answer]], method: str) -> Array:
    boxes = [r[method].box for r in runs]
    widths = [box.width for box in boxes if box is not None]
    return np.median(widths, axis=0) if widths else np.full(len(runs[0][method].theta), np.nan)


def main() -> None:
    """Run and print."""
    arguments = parser(__doc__)
    arguments.add_argument("--runs", type=int, default=50, help="noisy logs per level (50; the targets are for 250)")
    arguments.add_argument("--workers", type=int, default=2, help="processes (2); 1 stays in this one")
    arguments.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on, tcp://host:8786")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    arguments.add_argument("--levels", nargs="+", type=float, default=list(LEVELS), help="σ_q, rad")
    arguments.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS), metavar="METHOD")
    options = arguments.parse_args()
    if options.runs < 2 or options.workers < 1:
        arguments.error("--runs must be at least 2, --workers at least 1")
    methods = [m for m in METHODS if m in {*options.methods, "ols", "frisch box"}]
    rows: list[dict[str, Any]] = []
    folder = data_folder()
    with pool(options.scheduler, options.workers) as there:
        for name in options.robots:
            case = case_of(name, folder, options.seed)
            for sigma in options.levels:
                parts = [p.tolist() for p in np.array_split(np.arange(options.runs), options.workers * 4) if len(p)]
                work = [(name, folder, options.seed, sigma, methods, p) for p in parts]
                runs = [run for part in there.gather(there.map(answers, work)) for run in part]
                rows += summary(case, name, sigma, runs)
    source = "the authors' points" if folder is not None else "a random Fourier motion (FRISCHID_DATA is not set)"
    notes = [f"planar2 along {source}; {options.runs} runs per level, none discarded; nominal cover {CONFIDENCE:.0%}"]
    publish("Estimators on the same noisy logs", rows, options.json, notes)


if __name__ == "__main__":
    main()
