"""The mujoco.sysid process of `against_mujoco.py`; it runs in an interpreter that has mujoco.sysid, without frischid.

For every line on its input, this script fits armature and damping of every joint by `sysid.optimize` and answers with
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


def job(spec, model, state, control, sensors, guess):
    """Fit once; every parameter starts at `guess`."""
    parameters = sysid.ParameterDict()
    for i in range(model.nv):
        name = model.joint(i).name
        for kind in ("armature", "damping"):
            parameters.add(
                sysid.Parameter(
                    f"{name}_{kind}",
                    nominal=guess,
                    min_value=1e-3,
                    max_value=5.0,
                    modifier=lambda s, p, n=name, k=kind: _set(s.joint(n), k, p.value[0]),
                )
            )
    sequences = sysid.ModelSequences("arm", spec, "measured", state, control, sensors)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    found, _ = sysid.optimize(initial_params=parameters, residual_fn=residual, optimizer="mujoco", verbose=False)
    return {name: float(found[name].value[0]) for name in found.keys()}  # noqa: SIM118 (not a dict)


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
    spec = mujoco.MjSpec.from_string((folder / "arm.xml").read_text(encoding="utf-8"))
    model = spec.compile()
    for _ in sys.stdin:
        with contextlib.redirect_stdout(sys.stderr):
            controls = sysid.TimeSeries(t[:-1], control)
            sensors = sysid.TimeSeries.from_names(t[1:], sensor, model)
            begin = time.process_time()
            values = job(spec, model, start, controls, sensors, 0.5)
            seconds = time.process_time() - begin
        print(json.dumps({"seconds": seconds, "values": values, "version": metadata.version("mujoco")}), flush=True)


main()
