"""The mujoco.sysid process of other scripts; it runs in an interpreter that has mujoco.sysid, without frischid.

The folder that its argument names holds the model, `arm.xml`, and `inputs.npz`: times, controls and sensors, the first
state, the optimiser's name, and for armature, damping and, as a third row, friction loss of each joint the start and
the bounds. For every line on its input, this script fits these values by `sysid.optimize` and answers with them and
the processor seconds. It is no benchmark by itself.
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


def job(spec, model, start, series, values):
    """Fit once: series are the controls and sensors, values the optimiser, starts and bounds."""
    optimizer, guess, low, high = values
    parameters = sysid.ParameterDict()
    names = [[f"{model.joint(i).name}_{kind}" for i in range(model.nv)] for kind in KINDS[: len(guess)]]
    for row, kind in enumerate(KINDS[: len(guess)]):
        for i in range(model.nv):
            joint = model.joint(i).name
            parameters.add(
                sysid.Parameter(
                    names[row][i],
                    nominal=float(guess[row, i]),
                    min_value=float(low[row, i]),
                    max_value=float(high[row, i]),
                    modifier=lambda s, p, n=joint, k=kind: _set(s.joint(n), k, p.value[0]),
                )
            )
    sequences = sysid.ModelSequences("arm", spec, "measured", start, *series)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    scaled = {"x_scale": guess.ravel()} if optimizer == "scipy" else {}
    found, _ = sysid.optimize(
        initial_params=parameters, residual_fn=residual, optimizer=optimizer, verbose=False, **scaled
    )
    return [[float(found[name].value[0]) for name in of_kind] for of_kind in names]


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
        t, control, sensor, start = (file[name] for name in ("t", "control", "sensor", "start"))
        values = (str(file["optimizer"]), *(file[name] for name in ("guess", "low", "high")))
    spec = mujoco.MjSpec.from_string((folder / "arm.xml").read_text(encoding="utf-8"))
    model = spec.compile()
    for _ in sys.stdin:
        with contextlib.redirect_stdout(sys.stderr):
            series = sysid.TimeSeries(t[:-1], control), sysid.TimeSeries.from_names(t[1:], sensor, model)
            begin = time.process_time()
            found = job(spec, model, start, series, values)
            seconds = time.process_time() - begin
        print(json.dumps({"seconds": seconds, "values": found, "version": metadata.version("mujoco")}), flush=True)


main()
