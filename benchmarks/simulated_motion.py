"""Simulated motion of the electro-mechanical positioning system, scored as its benchmark does.

The models are fitted to the log `train` alone. Then each moves in open loop under the recorded force of a log. The
score is the rms error of its position over all samples after the first 20, in mm. These 20 samples give the start: a
parabola through them. `test_pulses`, the official test, decides nothing.

Run ``python benchmarks/simulated_motion.py`` with FRISCHID_DATA set. Each fit of the motion takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, parser, publish

import frischid as fr

START = 20
"""Samples that give the start; the benchmark's rule."""
PUBLISHED = {"m1": 95.109, "fv1": 203.503, "fc1": 20.394, "off1": -3.165}
"""Janot, Gautier and Brunot 2019: IDIM-LS."""
MODELS = {
    "baseline": "viscous, coulomb(width=0.001), offset",
    "with asymmetric_viscous and time_delay": (
        "viscous, coulomb(width=0.001), offset, asymmetric_viscous, time_delay(size=-0.003)"
    ),
}
NOTES = (
    "rms of the simulated less the measured position in mm, open loop, after the first 20 samples",
    "fitted to train; test_pulses, with its force pulses, is the official test",
    "published: the parameters of Janot, Gautier and Brunot 2019 in the same simulation",
)


def score(model: fr.Model, log: fr.Log) -> float:
    """Rms error of the simulated position, mm."""
    assert log.tau is not None
    t = log.t[: START + 1] - log.t[START]
    _, speed, place = np.polyfit(t, log.q[: START + 1, 0], 2)
    starts = fr.Starts(np.array([[place]]), np.array([[speed]]), log.t[START : START + 1])
    forward = fr.ForwardDynamics(model)
    moved = forward.simulate(fr.RecordedTorque(log.t, log.tau), starts, log.t[START:] - log.t[START], step=0.001)
    return float(1e3 * np.sqrt(((moved.q[0, :, 0] - log.q[START:, 0]) ** 2).mean()))


def published(linear: fr.Model) -> fr.Model:
    """The model with the published parameters."""
    theta = np.array([PUBLISHED[c.name.removesuffix("R")] for c in linear.estimate.columns])
    return replace(linear, estimate=replace(linear.estimate, theta=theta), standard=None)


def rows(folder: Path, horizon: float) -> Iterator[dict[str, Any]]:
    robot = fr.Robot.load(folder / "emps.urdf")
    train, test = (fr.read_log(folder / "logs" / f"{name}.parquet", robot.joints) for name in ("train", "test_pulses"))

    def row(name: str, fitted_by: str, model: fr.Model) -> dict[str, Any]:
        return {"model": name, "parameters": fitted_by, "train mm": score(model, train), "test mm": score(model, test)}

    for name, effects in MODELS.items():
        linear = fr.identify(robot, [train], effects=fr.parse_effects(effects), recursion="none").model
        if name == "baseline":
            yield row(name, "published", published(linear))
        yield row(name, "linear", linear)
        options = fr.OutputErrorOptions(horizon=horizon, samples=int(20 * horizon), rounds=1)
        yield row(name, "output_error", fr.output_error(linear, [train], options=options).model)


def main() -> None:
    options = parser(__doc__)
    help_text = "seconds of a fitted stretch; the whole log by default"
    options.add_argument("--horizon", type=float, default=24.7, help=help_text)
    given = options.parse_args()
    folder = data_folder()
    if folder is None:
        raise SystemExit("set FRISCHID_DATA to the folder with the measured logs")
    publish("EMPS: simulated position", list(rows(folder / "emps", given.horizon)), given.json, NOTES)


if __name__ == "__main__":
    main()
