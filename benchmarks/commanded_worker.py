"""The mujoco.sysid process of `commanded_peers.py`; it runs in an interpreter that has mujoco.sysid, without frischid.

For every line on its input, this script fits armature, damping and friction loss of every joint to measured positions
by `sysid.optimize`, and answers with the processor seconds. It is no benchmark by itself.
"""

import contextlib
import json
import sys
import time
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid

KINDS = ("armature", "damping", "frictionloss")


def job(spec, model, start, controls, sensors, guess):
    """Fit once. `guess` has the start of each value, (3, J); each may be 30 times smaller or larger."""
    parameters = sysid.ParameterDict()
    for row, kind in enumerate(KINDS):
        for i in range(model.nv):
            joint = model.joint(i).name
            parameters.add(
                sysid.Parameter(
                    f"{i}_{kind}",
                    nominal=float(guess[row, i]),
                    min_value=float(guess[row, i]) / 30,
                    max_value=float(guess[row, i]) * 30,
                    modifier=lambda s, p, n=joint, k=kind: _set(s.joint(n), k, p.value[0]),
                )
            )
    sequences = sysid.ModelSequences("arm", spec, "measured", start, controls, sensors)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    scale = np.array([parameters[name].value[0] for name in parameters.keys()])  # noqa: SIM118 (not a dict)
    found, _ = sysid.optimize(
        initial_params=parameters, residual_fn=residual, optimizer="scipy", verbose=False, x_scale=scale
    )
    return [[float(found[f"{i}_{kind}"].value[0]) for i in range(model.nv)] for kind in KINDS]


def _set(joint, kind, value):
    current = np.asarray(getattr(joint, kind))
    if current.ndim:
        changed = np.zeros(current.shape)
        changed[0] = value
        setattr(joint, kind, changed)
    else:
        setattr(joint, kind, value)


def main():
    """Answer every line."""
    folder = Path(sys.argv[1])
    with np.load(folder / "inputs.npz") as file:
        t, control, measured, start, guess = (file[name] for name in ("t", "control", "measured", "start", "guess"))
    spec = mujoco.MjSpec.from_string((folder / "arm.xml").read_text(encoding="utf-8"))
    model = spec.compile()
    for _ in sys.stdin:
        with contextlib.redirect_stdout(sys.stderr):
            controls = sysid.TimeSeries(t[:-1], control)
            sensors = sysid.TimeSeries.from_names(t[1:], measured, model)
            begin = time.process_time()
            values = job(spec, model, start, controls, sensors, guess)
            seconds = time.process_time() - begin
        print(json.dumps({"seconds": seconds, "values": values, "version": metadata.version("mujoco")}), flush=True)


main()
