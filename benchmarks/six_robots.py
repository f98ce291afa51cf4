"""Six measured robots: identified on one log, tested on another, and what `improve` finds missing.

Needs FRISCHID_DATA. For each robot: the held-out error of the URDF's links with fitted friction, of the identified
model, and of the model with the effects that `improve` adds. The test log decides nothing. The README, the site and
`docs/data/six_robots.json` (the result of `--json`) show the same figures; `docs/tables.py` writes them, and a test
compares all three.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common import data_folder, parser, publish, record
from real_robots import TIAGO_ROWS
from trust import FIVE, Part, read

import frischid as fr
from frischid.diagnosis.step import Step

EXAMPLES = "github.com/thanhndv212/figaroh-examples"


@dataclass(frozen=True)
class Measured:
    """A robot, its logs, and where they come from.

    Attributes
    ----------
    key : str
        Folder below FRISCHID_DATA.
    name, sensor : str
        As printed: the robot, and how its torque was measured.
    source, licence : str
    urdf : str
        File in the folder.
    fit, test : tuple of str
        Names of logs, without their endings.
    torque_joints : tuple of str or None
        Joints whose torque is used; None for all.
    """

    key: str
    name: str
    sensor: str
    source: str
    licence: str
    urdf: str
    fit: tuple[str, ...]
    test: tuple[str, ...]
    torque_joints: tuple[str, ...] | None = None


ROBOTS = (
    Measured(
        "ur10e", "UR10e", "motor currents", "github.com/shamilmamedov/dynamic_calibration", "none stated", "ur10e.urdf",
        tuple(FIVE), ("unloaded_50s_14harm",),
    ),
    Measured(
        "panda", "Franka Panda", "joint torque sensors", "github.com/marcocognetti/FrankaEmikaPandaDynModel", "GPL-3.0",
        "panda.urdf", ("ident_0_14s",), ("valid_14_21s",),
    ),
    Measured(
        "tiago", "TIAGo, arm_1 to arm_4", "motor currents", EXAMPLES, "Apache-2.0", "tiago_48_schunk.urdf",
        ("ident_0_48s",), ("valid_48_80s",), tuple(TIAGO_ROWS),
    ),
    Measured(
        "staubli_tx40", "Stäubli TX40", "motor torques", EXAMPLES, "Apache-2.0", "staubli_tx40.urdf", ("ident_0_5s",),
        ("valid_5_9s",),
    ),
    Measured(
        "emps", "EMPS, one linear axis", "drive voltage", "nonlinearbenchmark.org; github.com/wmkouw/NSI-EMPS", "MIT",
        "emps.urdf", ("train",), ("test_pulses",),
    ),
    Measured(
        "lbr_med7", "KUKA LBR Med 7", "joint torque sensors", "github.com/lbr-stack/dynamic_parameter_identification",
        "MIT", "lbr_med7.urdf", ("with_ext_tau",), ("measurements",),
    ),
)  # fmt: skip


def measured(case: Measured, folder: Path) -> dict[str, Any]:
    """Everything that the pages show of one robot."""
    start = time.process_time()
    robot = fr.Robot.load(folder / case.key / case.urdf)
    fit, test = ([read(folder, robot, case.key, Part(name)) for name in names] for names in (case.fit, case.test))
    found = fr.identify(robot, fit, valid=test, torque_joints=case.torque_joints, recursion="none")
    steps, last = fr.improve(found.model, fit, valid=test)
    before = fr.compare(found.model, test)
    after = fr.compare(steps[-1].model, test) if steps else before
    first = fr.headline(found.model, test)
    return {
        "key": case.key,
        "robot": case.name,
        "sensor": case.sensor,
        "source": case.source,
        "licence": case.licence,
        "fitted_seconds": sum(float(log.t[-1] - log.t[0]) for log in fit),
        "test_seconds": sum(float(log.t[-1] - log.t[0]) for log in test),
        "logs": {"fitted": list(case.fit), "test": list(case.test)},
        "torque_joints": list(case.torque_joints or ()),
        "cutoff_hz": found.model.lowpass.cutoff,
        "base_parameters": found.reduction.rank,
        "constant": first.constant_nrmse,
        "urdf_with_friction": first.urdf_nrmse,
        "identified": first.nrmse,
        "identified_with_standstill": before.nrmse_with_standstill,
        "noise_floor": first.noise_floor,
        "improved": after.nrmse,
        "alarms": [alarm.id for alarm in first.alarms],
        "steps": [_step(step) for step in steps],
        "verdict_after": last.verdict,
        "joints": {
            name: {
                "rmse": j.rmse, "std": j.std, "identified": j.nrmse, "improved": after.joints[name].nrmse,
                "noise_floor": j.noise_floor,
            }
            for name, j in before.joints.items()
        },
        "processor_seconds": time.process_time() - start,
    }  # fmt: skip


def _step(step: Step) -> dict[str, Any]:
    finding = step.finding
    assert finding is not None
    return {
        "effect": finding.effect,
        "title": fr.EFFECTS[finding.effect].title if finding.effect in fr.EFFECTS else finding.effect,
        "joints": list(finding.joints),
        "sentence": finding.sentence,
        "test_before": step.test_before,
        "test_after": step.test_after,
    }


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--only", metavar="ROBOT", help="one robot, by its folder's name")
    chosen = options.parse_args()
    folder = data_folder()
    if folder is None:
        sys.exit("set FRISCHID_DATA to the folder of measured logs")
    rows = [measured(case, folder) for case in ROBOTS if chosen.only in (None, case.key)]
    title = "six measured robots: error on a log that was not fitted"
    printed = [
        {
            "robot": row["robot"],
            "URDF + friction": row["urdf_with_friction"],
            "identified": row["identified"],
            "improved": row["improved"],
            "added": ", ".join(f"{s['effect']} ({', '.join(s['joints'])})" for s in row["steps"]) or "–",
            "alarms": ", ".join(row["alarms"]) or "–",
            "seconds": row["processor_seconds"],
        }
        for row in rows
    ]
    publish(title, printed, None)
    if chosen.json is not None:
        record(title, rows, chosen.json)


if __name__ == "__main__":
    main()
