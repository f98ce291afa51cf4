"""The figaroh process of `against_figaroh.py`; it runs in an interpreter that has figaroh and does not use frischid.

For every line on its input, this script does the job once with figaroh's own functions, in the order of figaroh's
`BaseIdentification.solve` without decimation. It answers with the processor seconds. It is no benchmark by itself.
"""

import contextlib
import json
import sys
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import pinocchio as pin
from figaroh.identification.identification_tools import relative_stdev
from figaroh.identification.parameter import get_standard_parameters
from figaroh.tools.qrdecomposition import QRDecomposer
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced, get_index_eliminate

CONFIG = {
    "has_friction": True,
    "has_actuator_inertia": True,
    "has_joint_offset": True,
    "is_joint_torques": True,
    "is_external_wrench": False,
    "force_torque": None,
    "act_idxv": list(range(6)),
}


class Robot:
    """The attributes of a robot that figaroh's regressor reads."""

    def __init__(self, urdf):
        self.model = pin.buildModelFromXML(urdf)
        self.data = self.model.createData()


def job(robot, q, v, a, tau):
    """Regressor, elimination of zero columns, double QR, base parameters, relative standard deviations."""
    W = build_regressor_basic(robot, q, v, a, CONFIG)
    parameters = dict.fromkeys(map(str, range(W.shape[1])), 0.0)
    eliminated, names = get_index_eliminate(W, parameters, 1e-6)
    reduced = build_regressor_reduced(W, eliminated)
    stacked = tau.T.ravel()
    W_b, _, _, phi = QRDecomposer(tolerance=1e-6).double_decomposition(stacked, reduced, names)
    return W_b, phi, relative_stdev(W_b, phi, stacked)


def main():
    """Answer every line."""
    folder = Path(sys.argv[1])
    with np.load(folder / "inputs.npz") as file:
        inputs = {name: file[name] for name in ("q", "v", "a", "tau")}
    robot = Robot((folder / "robot.urdf").read_text(encoding="utf-8"))
    get_standard_parameters(robot.model, CONFIG)
    for _ in sys.stdin:
        with contextlib.redirect_stdout(sys.stderr):
            start = time.process_time()
            W_b, phi, stdev = job(robot, **inputs)
            seconds = time.process_time() - start
        predicted = (W_b @ phi).reshape(inputs["tau"].shape[::-1]).T
        np.savez(folder / "answer.npz", predicted=predicted, stdev=stdev)
        print(json.dumps({"seconds": seconds, "version": metadata.version("figaroh")}), flush=True)


main()
