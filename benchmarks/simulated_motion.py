"""Simulated motion of the electro-mechanical positioning system, scored as its benchmark does.

The models are fitted to the log `train` alone. Then each moves in open loop under the recorded force of a log. The
score is the rms error of its position over all samples after the first 20, in mm. These 20 samples give the start: a
parabola through them. `test_pulses`, the official test, decides nothing.

One more row is no score: the same structure fitted to `test_pulses` itself. This row and the mean forces at steady
speeds show which part of a score is the model's, and which part is a change of the axis between the logs.

Run ``python benchmarks/simulated_motion.py`` with FRISCHID_DATA set. Each fit of the motion takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
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
REFITTED = "with asymmetric_viscous"
"""The model that is fitted to the test log too."""
SPEEDS = (0.125, 0.083, 0.042, -0.042, -0.083, -0.125)
"""Steady speeds of both logs, m/s."""
NOTES = (
    "rms of the simulated less the measured position in mm, open loop, after the first 20 samples",
    "fitted to train; test_pulses, with its force pulses, is the official test",
    "published: the parameters of Janot, Gautier and Brunot 2019 in the same simulation",
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


AS_RECORDED = "baseline, torque as recorded"


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


def rows(robot: fr.Robot, train: fr.Log, test: fr.Log, horizon: float) -> Iterator[dict[str, Any]]:
    options = fr.OutputErrorOptions(horizon=horizon, samples=int(20 * horizon), rounds=1)

    def linear(effects: str, log: fr.Log, lag: float | Literal["auto"] = "auto") -> fr.Model:
        basis = fr.parse_effects(BASELINE + effects)
        return fr.identify(robot, [log], effects=basis, recursion="none", torque_lag=lag).model

    def row(name: str, fitted_by: str, model: fr.Model) -> dict[str, Any]:
        return {"model": name, "parameters": fitted_by, "train mm": score(model, train), "test mm": score(model, test)}

    for name, effects in MODELS.items():
        model = linear(effects, train)
        if name == "baseline":
            recorded = linear(effects, train, 0.0)
            yield row(name, "published", published(recorded))
            yield row(AS_RECORDED, "linear", recorded)
            yield row(AS_RECORDED, "output_error", fr.output_error(recorded, [train], options=options).model)
        yield row(name, "linear", model)
        yield row(name, "output_error", fr.output_error(model, [train], options=options).model)
    refitted = fr.output_error(linear(MODELS[REFITTED], test), [test], options=options).model
    yield row(REFITTED, "output_error on test_pulses", refitted)


def main() -> None:
    options = parser(__doc__)
    help_text = "seconds of a fitted stretch; the whole log by default"
    options.add_argument("--horizon", type=float, default=24.7, help=help_text)
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
    publish("EMPS: simulated position", list(rows(robot, train, test, given.horizon)), given.json, (*NOTES, *forces))


if __name__ == "__main__":
    main()
