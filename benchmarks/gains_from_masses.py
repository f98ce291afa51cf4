"""Motor currents without gains: the gains that follow from the masses of the URDF, and the error of the model.

The logs of the UR10e hold motor currents. The gains of the data set come from the controller's own torques. Here the
model is fitted twice to the same logs: with these gains, and without any gains, so that frischid finds the gains from
the URDF's masses. The table gives each joint's ratio of the two gains with its standard error, and the error of both
models on a log that was not fitted. Needs FRISCHID_DATA.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
from pathlib import Path
from typing import Any

from common import data_folder, parser, publish
from real_robots import UR10E_GAIN
from trust import FIVE

import frischid as fr

TEST = "unloaded_50s_14harm"


def fitted(folder: Path, mapping: dict[str, Any] | None, fit: list[str]) -> fr.Identification:
    """The model of the UR10e's logs with a mapping."""
    robot = fr.Robot.load(folder / "ur10e" / "ur10e.urdf")
    logs, test = (
        [fr.read_log(folder / "ur10e" / "logs" / f"{name}.parquet", robot.joints, mapping) for name in names]
        for names in (fit, [TEST])
    )
    return fr.identify(robot, logs, valid=test, recursion="none")


def main() -> None:
    """Print one row per joint."""
    options = parser(__doc__)
    options.add_argument("--logs", type=int, default=len(FIVE), help="logs to fit, from the first")
    chosen = options.parse_args()
    folder = data_folder()
    if folder is None:
        sys.exit("set FRISCHID_DATA to the folder of measured logs")
    fit = FIVE[: chosen.logs]
    known = fitted(folder, {"current_gain": UR10E_GAIN}, fit)
    unknown = fitted(folder, None, fit)
    currents = unknown.model.currents
    assert currents is not None
    assert known.comparison is not None
    assert unknown.comparison is not None
    rows = [
        {
            "joint": joint,
            "gain of the data set, N·m/A": gain,
            "gain from the masses, N·m/A": currents.gain[joint],
            "ratio": currents.gain[joint] / gain,
            "relative standard error": currents.doubt[joint],
            "NRMSE with gains": known.comparison.joints[joint].nrmse,
            "NRMSE without gains": unknown.comparison.joints[joint].nrmse,
        }
        for joint, gain in UR10E_GAIN.items()
    ]
    notes = [
        f"mean NRMSE on {TEST}: {known.comparison.nrmse:.4f} with gains, {unknown.comparison.nrmse:.4f} without",
        f"fitted: {', '.join(fit)}",
    ]
    publish("gains from the URDF's masses (UR10e)", rows, chosen.json, notes)


if __name__ == "__main__":
    main()
