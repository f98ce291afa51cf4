"""The mujoco.sysid process of other scripts; it runs in an interpreter that has mujoco.sysid, without frischid.

The folder that its argument names holds the model, `arm.xml`, and `inputs.npz`: times, controls and sensors, the first
state, the optimiser's name, and for armature, damping and, as a third row, friction loss of each joint the start and
the bounds. For every line on its input, this script fits these values by `sysid.optimize` and answers with them, the
half widths of their 95 % intervals, and the processor seconds. The line ``links`` also fits each link's mass and centre
of mass, within the bounds that the package itself proposes. It is no benchmark by itself.
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
LENGTH = 0.01
"""m. Scale of a centre of mass for the optimiser."""
LINK_ITERATIONS = 50
"""Most evaluations of a fit that has the links too; the package's own limit is 200."""


def job(spec, start, series, values, links):
    """Fit once: series are the controls and sensors, values the optimiser, starts and bounds.

    Returns values, half widths of the 95 % intervals, and the fitted model as MJCF.
    """
    model = spec.compile()
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
    scale = [guess.ravel()]
    if links:
        for body in spec.bodies[1:]:
            parameters.add(sysid.body_inertia_param(spec, model, body.name, inertia_type=sysid.InertiaType.MassIpos))
            scale.append(np.array([body.mass, *3 * [LENGTH]]))
    sequences = sysid.ModelSequences("arm", spec, "measured", start, *series)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    scaled = {"x_scale": np.concatenate(scale)} if optimizer == "scipy" else {}
    if links:  # the masses and drives hardly differ in the motion: the fit creeps on for hundreds of evaluations
        scaled["max_iters"] = LINK_ITERATIONS
    found, result = sysid.optimize(
        initial_params=parameters, residual_fn=residual, optimizer=optimizer, verbose=False, **scaled
    )
    _, half = sysid.calculate_intervals(residual(result.x, found)[0], result.jac)
    fitted = sysid.apply_param_modifiers_spec(found, spec.copy()).to_xml()
    count = len(names[0])
    values = [[float(found[name].value[0]) for name in of_kind] for of_kind in names]
    return values, half[: guess.size].reshape(-1, count).tolist(), fitted


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
    for number, body in enumerate(spec.bodies[1:], start=1):
        body.name = body.name or f"link{number}"
    model = spec.compile()
    for line in sys.stdin:
        with contextlib.redirect_stdout(sys.stderr):
            series = sysid.TimeSeries(t[:-1], control), sysid.TimeSeries.from_names(t[1:], sensor, model)
            begin = time.process_time()
            found, half, fitted = job(spec, start, series, values, line.strip() == "links")
            seconds = time.process_time() - begin
        answer = {"seconds": seconds, "values": found, "half": half, "mjcf": fitted}
        print(json.dumps(answer | {"version": metadata.version("mujoco")}), flush=True)


main()
