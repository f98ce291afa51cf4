"""A quadruped's legs without torque: closed-loop simulated positions, beside the simulator model of the data's authors.

Needs FRISCHID_DATA with ``go2_command/logs/chirp.parquet`` (github.com/iit-DLSLab/sim2real-robot-identification). The
first 15.7 s of the chirp are fitted, the faster rest is held out and decides nothing. Each model is simulated under the
drive's law with the recorded commands, from the first sample to the last; the error is the rms of q_simulated − q, rad.

- *authors*: the URDF's links, damping 0.6, armature 0.01, frictionloss 0.2 (their simulator's values);
- *commands*: `frischid identify --controller pd --kp 20 --kd 1.5`;
- *found*: the same with the effect that `frischid diagnose` names first on the fitted part, at the joints it names,
  as `frischid add` adds it.

Then the values of each drive, with their 95 % ranges.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, parser, publish

import frischid as fr
from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.forward.forward_dynamics import ForwardDynamics
from frischid.forward.simulated_motion import Starts
from frischid.forward.torque_sources import PositionController
from frischid.logs.delayed_commands import velocity_of
from frischid.regression.regressor import nominal_parameters

SPLIT = 15.7
"""s. The data's card divides the chirp here."""
KP, KD = 20.0, 1.5
AUTHORS = {"viscous": 0.6, "rotor_inertia": 0.01, "coulomb": 0.2, "offset": 0.0}
STEP = 0.0025
"""s. Step of the simulation, two per sample."""


def authors_parameters(model: fr.Model) -> Array:
    """The URDF's links and the friction and armature of the authors' simulator model."""
    theta = np.array(nominal_parameters(model.robot, model.effects), dtype=float)
    columns = columns_of(model.robot, model.effects)
    return np.array([AUTHORS.get(c.effect, x) for c, x in zip(columns, theta, strict=True)])


def position_error(model: fr.Model, log: fr.Log, theta: Array | None = None) -> Array:
    """Rms error of the closed-loop simulated positions, rad, (J,)."""
    assert log.qcmd is not None
    t = log.t - log.t[0]
    source = PositionController(t, log.qcmd, KP, KD)
    forward = ForwardDynamics(model, None if theta is None else theta[None])
    found = forward.simulate(source, Starts(log.q[:1], velocity_of(log)[:1]), t, step=STEP)
    return np.asarray(np.sqrt(((found.q[0] - log.q) ** 2).mean(axis=0)))


def run(path: Path) -> dict[str, Any]:
    """Every figure of the benchmark."""
    robot = fr.Robot.load("go2")
    whole = fr.read_log(path, robot.joints)
    fitted, held = fr.stretch(whole, stop=SPLIT), fr.stretch(whole, start=SPLIT)
    controller = fr.PDController(kp=KP, kd=KD)
    plain = fr.identify(robot, [fitted], valid=[held], controller=controller, recursion="none")
    first = fr.diagnose(plain.model, [fitted]).findings[0]
    step = fr.add(plain.model, first.members, [fitted], valid=[held], finding=first)
    models = {
        "authors": (plain.model, authors_parameters(plain.model)),
        "commands": (plain.model, None),
        "found": (step.model, None),
    }
    errors = {
        name: {part: position_error(model, log, theta).tolist() for part, log in (("fitted", fitted), ("held", held))}
        for name, (model, theta) in models.items()
    }
    return {
        "joints": list(robot.joints),
        "errors": errors,
        "cross_validated": {"commands": step.error_before, "found": step.error_after},
        "first": {"effect": first.effect, "joints": list(first.joints), "probability": first.probability},
        "drives": [x.to_dict() for x in fr.drive_parameters(step.model)],
    }


def main() -> None:
    """Print the tables."""
    options = parser(__doc__).parse_args()
    folder = data_folder()
    path = None if folder is None else folder / "go2_command" / "logs" / "chirp.parquet"
    if path is None or not path.exists():
        sys.exit("FRISCHID_DATA must name a folder with go2_command/logs/chirp.parquet")
    figures = run(path)
    rows = []
    for name, parts in figures["errors"].items():
        row: dict[str, Any] = {"model": name}
        for part, values in parts.items():
            row[f"{part} rad"] = float(np.sqrt(np.mean(np.square(values))))
        for part, values in parts.items():
            row |= {f"{part} {joint} rad": x for joint, x in zip(figures["joints"], values, strict=True)}
        row["cross-validated"] = figures["cross_validated"].get(name)
        rows.append(row)
    first, *others = rows
    ratios = ", ".join(f"{row['model']} {first['held rad'] / row['held rad']:.2f}" for row in others)
    before, after = figures["cross_validated"]["commands"], figures["cross_validated"]["found"]
    notes = [
        f"held-out error of the authors' model over that of: {ratios}",
        f"cross-validated NRMSE of the torque on the fitted part: commands {before:.4f}, found {after:.4f}",
        "diagnose names first: {effect} of {joints}, probability {probability:.2f}".format(
            **figures["first"] | {"joints": ", ".join(figures["first"]["joints"])}
        ),
    ]
    publish("Closed-loop simulated positions, rms", rows, options.json, notes)
    keys = ("joint", "quantity", "value", "lower", "upper", "known")
    drives = [{key: x[key] for key in keys} for x in figures["drives"] if x["known"] != "given"]
    path_of_drives = options.json and options.json.with_stem(options.json.stem + "_drives")
    publish("Drives, with 95 % ranges", drives, path_of_drives, notes[1:])


if __name__ == "__main__":
    main()
