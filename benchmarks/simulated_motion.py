"""Simulated motion of the electro-mechanical positioning system, scored as its benchmark does.

The models are fitted to the log `train` alone. Then each moves in open loop under the recorded force of a log. The
score is the rms error of its position over all samples after the first 20, in mm. These 20 samples give the start: a
parabola through them. `test_pulses`, the official test, decides nothing.

A model is chosen within `train`: each model is fitted to one half of `train` and scored on the other half, and the
lowest rms of the two scores wins.

One more row is no score: the same structure fitted to `test_pulses` itself. This row and the mean forces at steady
speeds show which part of a score is the model's, and which part is a change of the axis between the logs.

Run ``python benchmarks/simulated_motion.py`` with FRISCHID_DATA set. Each fit of the motion takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from typing import Any, Literal

import numpy as np
from common import data_folder, parser, publish
from scipy.ndimage import uniform_filter1d

import frischid as fr

START = 20
"""Samples that give the start; the benchmark's rule."""
PUBLISHED = {"m1": 95.109, "fv1": 203.503, "fc1": 20.394, "off1": -3.165}
"""Janot, Gautier and Brunot 2019: IDIM-LS."""
BASELINE = "viscous, coulomb(width=0.001), offset"
MODELS = {
    "baseline": "",
    "with asymmetric_viscous and time_delay": ", asymmetric_viscous, time_delay(size=-0.003)",
    "with asymmetric_viscous": ", asymmetric_viscous",
    "with asymmetric_viscous and torque_drift": ", asymmetric_viscous, torque_drift(constant=100)",
}
AS_RECORDED = ", torque as recorded"
"""Ending of the name of a model that does not take the lag of the torque back."""
REFITTED = "with asymmetric_viscous"
"""The model that is fitted to the test log too."""
SPEEDS = (0.125, 0.083, 0.042, -0.042, -0.083, -0.125)
"""Steady speeds of both logs, m/s."""
NOTES = (
    "rms of the simulated less the measured position in mm, open loop, after the first 20 samples",
    "fitted to train; test_pulses, with its force pulses, is the official test",
    "published: the parameters of Janot, Gautier and Brunot 2019 in the same simulation",
    "output_error fits the motion of the whole log at once; in stretches: of one second, as the command does",
    "other half: fitted to one half of train, scored on the other half; rms of both",
    "output_error on test_pulses: fitted to the test log itself, so its test error is no score",
)


def score(model: fr.Model, log: fr.Log) -> float:
    """Rms error of the simulated position, mm. A force that the model counts as late acts that much earlier."""
    assert log.tau is not None
    force = fr.RecordedTorque(log.t - model.lowpass.torque_lag, log.tau)
    t = log.t[: START + 1] - log.t[START]
    _, speed, place = np.polyfit(t, log.q[: START + 1, 0], 2)
    starts = fr.Starts(np.array([[place]]), np.array([[speed]]), log.t[START : START + 1])
    forward = fr.ForwardDynamics(model)
    moved = forward.simulate(force, starts, log.t[START:] - log.t[START], step=0.001)
    return float(1e3 * np.sqrt(((moved.q[0, :, 0] - log.q[START:, 0]) ** 2).mean()))


def published(linear: fr.Model) -> fr.Model:
    """The model with the published parameters."""
    theta = np.array([PUBLISHED[c.name.removesuffix("R")] for c in linear.estimate.columns])
    return replace(linear, estimate=replace(linear.estimate, theta=theta), standard=None)


def steady_forces(log: fr.Log) -> list[float]:
    """Mean force at each of `SPEEDS`, N."""
    assert log.tau is not None
    speed = np.gradient(uniform_filter1d(log.q[:, 0], 51), log.t)
    forces = []
    for steady in SPEEDS:
        near = uniform_filter1d((np.abs(speed - steady) < 0.003).astype(float), 101) > 0.999
        forces.append(float(log.tau[near, 0].mean()))
    return forces


Fit = Callable[[fr.Model, fr.Log], fr.Model]


def as_identified(model: fr.Model, log: fr.Log) -> fr.Model:
    """The least-squares answer."""
    return model


def in_stretches(model: fr.Model, log: fr.Log) -> fr.Model:
    """The motion of stretches of one second: the options of the command."""
    return fr.output_error(model, [log]).model


def at_once(model: fr.Model, log: fr.Log, horizon: float) -> fr.Model:
    """The motion of the whole log, or of stretches as long as given."""
    horizon = min(horizon, log.t[-1] - log.t[0])
    options = fr.OutputErrorOptions(horizon=horizon, samples=int(20 * horizon), rounds=1)
    return fr.output_error(model, [log], options=options).model


def halves(log: fr.Log) -> tuple[fr.Log, fr.Log]:
    """The first and the second half of a log."""
    middle = len(log) // 2
    return log.slice(stop=middle), log.slice(middle)


def linear(robot: fr.Robot, log: fr.Log, effects: str, lag: float | Literal["auto"]) -> fr.Model:
    """The least-squares model of one log."""
    basis = fr.parse_effects(BASELINE + effects)
    return fr.identify(robot, [log], effects=basis, recursion="none", torque_lag=lag).model


def rows(robot: fr.Robot, train: fr.Log, test: fr.Log, horizon: float, name: str) -> list[dict[str, Any]]:
    """Scores of one structure, fitted in each way."""
    effects = MODELS[name.removesuffix(AS_RECORDED)]
    lag: float | Literal["auto"] = 0.0 if name.endswith(AS_RECORDED) else "auto"

    def row(fitted_by: str, model: fr.Model) -> dict[str, Any]:
        return {"model": name, "parameters": fitted_by, "train mm": score(model, train), "test mm": score(model, test)}

    model, first, second = (linear(robot, log, effects, lag) for log in (train, *halves(train)))
    found = [row("published", published(model))] if name == "baseline" + AS_RECORDED else []
    whole = partial(at_once, horizon=horizon)
    fits: dict[str, Fit] = {"linear": as_identified, "output_error in stretches": in_stretches, "output_error": whole}
    for fitted_by, fit in fits.items():
        one, other = halves(train)
        scores = [score(fit(first, one), other), score(fit(second, other), one)]
        found.append(row(fitted_by, fit(model, train)) | {"other half mm": float(np.sqrt(np.mean(np.square(scores))))})
    if name == REFITTED:
        found.append(row("output_error on test_pulses", whole(linear(robot, test, effects, lag), test)))
    return found


def main() -> None:
    options = parser(__doc__)
    help_text = "seconds of a fitted stretch; the whole log by default"
    options.add_argument("--horizon", type=float, default=24.7, help=help_text)
    options.add_argument("--workers", type=int, default=2, help="processes")
    given = options.parse_args()
    folder = data_folder()
    if folder is None:
        raise SystemExit("set FRISCHID_DATA to the folder with the measured logs")
    robot = fr.Robot.load(folder / "emps" / "emps.urdf")
    train, test = (
        fr.read_log(folder / "emps" / "logs" / f"{name}.parquet", robot.joints) for name in ("train", "test_pulses")
    )
    forces = [
        f"mean force at {speed} m/s: {before:.1f} N in train, {after:.1f} N in test_pulses"
        for speed, before, after in zip(SPEEDS, steady_forces(train), steady_forces(test), strict=True)
    ]
    names = ("baseline" + AS_RECORDED, *MODELS)
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as there:
        scored = [row for each in there.map(partial(rows, robot, train, test, given.horizon), names) for row in each]
    best = min((row for row in scored if "other half mm" in row), key=lambda row: row["other half mm"])
    best["chosen"] = True
    title = f"EMPS: simulated position, {best['test mm']:.1f} mm on test_pulses by the model chosen within train"
    publish(title, scored, given.json, (*NOTES, *forces))


if __name__ == "__main__":
    main()
