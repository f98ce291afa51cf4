"""Identification from measured logs of real robots; the error is measured on logs that were not fitted.

Needs FRISCHID_DATA. NRMSE is the rms error of a joint's torque over its standard deviation, both through the same
filter, averaged over the joints. Samples of a joint at standstill are left out, because dry friction is undetermined
there; the table gives their share.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from common import data_folder, parser, publish

import frischid as fr

UR10E_GAIN = {
    "shoulder_pan_joint": 11.97,
    "shoulder_lift_joint": 11.98,
    "elbow_joint": 9.84,
    "wrist_1_joint": 10.75,
    "wrist_2_joint": 10.69,
    "wrist_3_joint": 10.68,
}
TIAGO_ROWS = [f"arm_{i}_joint" for i in range(1, 5)]


@dataclass(frozen=True)
class Case:
    """A robot, its logs, the target error, and the joints that are left out."""

    name: str
    urdf: str
    fit: Sequence[str]
    valid: Sequence[str]
    target: float
    card_cutoff: float
    mapping: dict[str, Any] | None = None
    torque_joints: Sequence[str] | None = None


UR10E_FIT = ["20s_5harm", "20s_10harm", "30s_12harm", "40s_12harm", "50s_12harm"]
CASES = [
    Case(
        "ur10e",
        "ur10e/ur10e.urdf",
        [f"ur10e/logs/ident_{n}.parquet" for n in UR10E_FIT],
        ["ur10e/logs/unloaded_50s_14harm.parquet"],
        0.090,
        8.0,
        {"current_gain": UR10E_GAIN},
    ),
    Case(
        "panda", "panda/panda.urdf", ["panda/logs/ident_0_14s.parquet"], ["panda/logs/valid_14_21s.parquet"], 0.055, 5.0
    ),
    Case(
        "tiago arm_1 to arm_4",
        "tiago/tiago_48_schunk.urdf",
        ["tiago/logs/ident_0_48s.parquet"],
        ["tiago/logs/valid_48_80s.parquet"],
        0.14,
        2.0,
        torque_joints=TIAGO_ROWS,
    ),
]


def identified(case: Case, folder: Path, cutoff: float | Literal["auto"] = "auto") -> tuple[fr.Identification, float]:
    """Identify one case; the seconds include reading."""
    start = time.perf_counter()
    robot = fr.Robot.load(folder / case.urdf)
    fit, valid = (
        [fr.read_log(folder / path, robot.joints, case.mapping) for path in paths] for paths in (case.fit, case.valid)
    )
    found = fr.identify(robot, fit, valid=valid, torque_joints=case.torque_joints, cutoff=cutoff, recursion="none")
    return found, time.perf_counter() - start


def cross_validated(found: fr.Identification) -> float:
    """Mean cross-validated NRMSE on the identification logs."""
    return float(np.mean(list(found.cross_validation.values())))


def main() -> None:
    """Print the table."""
    options = parser(__doc__).parse_args()
    folder = data_folder()
    if folder is None:
        sys.exit("set FRISCHID_DATA to the folder of measured logs")
    rows, notes = [], []
    for case in CASES:
        found, seconds = identified(case, folder)
        fixed, _ = identified(case, folder, case.card_cutoff)
        result, at_card = found.comparison, fixed.comparison
        assert result is not None
        assert at_card is not None
        rows.append(
            {
                "robot": case.name,
                "NRMSE": result.nrmse,
                "target": case.target,
                "reached": result.nrmse <= case.target,
                "cut-off Hz": found.model.lowpass.cutoff,
                "with standstill": result.nrmse_with_standstill,
                "standstill %": 100 * result.standstill,
                "NRMSE at card's cut-off": at_card.nrmse,
                "card's cut-off Hz": case.card_cutoff,
                "cross-validated": cross_validated(found),
                "nominal": result.nominal,
                "constant": result.constant,
                "rank": found.reduction.rank,
                "rank gap": found.reduction.gap,
                "seconds": seconds,
            }
        )
        joints = ", ".join(f"{n} {j.rmse:.3g} N·m ({j.nrmse:.3f})" for n, j in result.joints.items())
        notes.append(f"{case.name}: RMSE (NRMSE) {joints}")
    publish("real robots: held-out error of the main job", rows, options.json, notes)


if __name__ == "__main__":
    main()
