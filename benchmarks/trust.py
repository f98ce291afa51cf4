"""Can a model be trusted on logs it was not fitted to? Pairs of measured logs: fitted on one, compared with another.

For every pair and method, the table gives the NRMSE on the other log. For the default method it also gives the alarms
of `identify`, which has not seen the other log, the alarms of the comparison, the expected error, and the share of the
other log's samples inside the 90 % interval.

Methods: least squares; the URDF's links with fitted friction; the default, least squares with the URDF as a prior.
Needs FRISCHID_DATA.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, parser, publish
from real_robots import TIAGO_ROWS, UR10E_FIT, UR10E_GAIN

import frischid as fr
from frischid.errors import IdentifiabilityError
from frischid.model.prediction import predict

FIVE = [f"ident_{name}" for name in UR10E_FIT]


@dataclass(frozen=True)
class Part:
    """A log, or some seconds of it."""

    name: str
    start: float = 0.0
    stop: float = float("inf")

    def __str__(self) -> str:
        return self.name if np.isinf(self.stop) else f"{self.name}[{self.start:g}:{self.stop:g} s]"


@dataclass(frozen=True)
class Pair:
    """The logs that are fitted, and the log that the model is compared with."""

    robot: str
    fit: tuple[Part, ...]
    valid: Part
    cutoff: float | None = None
    effects: str = ""

    @property
    def fitted(self) -> str:
        """The fitted logs in words."""
        return " + ".join(map(str, self.fit)) if len(self.fit) < 3 else f"{len(self.fit)} logs"


def pairs() -> list[Pair]:
    """Every pair, in the order of the table."""
    lbr = {"W": "with_ext_tau", "S": "joint_states", "M": "measurements"}
    found = [Pair("lbr_med7", (Part(lbr[a]),), Part(lbr[b])) for a in lbr for b in lbr if a != b]
    unloaded, points = Part("unloaded_50s_14harm"), Part("valid_ptp_10_points")
    whole = tuple(Part(name) for name in FIVE)
    found += [
        Pair("ur10e", whole, unloaded),
        Pair("ur10e", whole, unloaded, 8.0),
        Pair("ur10e", whole, points),
        Pair("ur10e", whole[:1], unloaded),
        Pair("ur10e", (Part(FIVE[4], 10, 20),), unloaded),
        Pair("ur10e", (Part(FIVE[2], 10, 20),), points),
        Pair("ur10e", (Part(FIVE[4], 10, 15),), unloaded),
        Pair("ur10e", (Part(FIVE[1], 8, 13),), unloaded),
        Pair("ur10e", (points,), unloaded),
    ]
    ident, valid = Part("ident_0_14s"), Part("valid_14_21s")
    found += [
        Pair("panda", (ident,), valid),
        Pair("panda", (valid,), ident),
        Pair("panda", (replace(ident, stop=3.0),), valid),
        Pair("panda", (Part("ident_0_14s", 5, 10),), valid),
    ]
    tiago = Part("ident_0_48s"), Part("valid_48_80s")
    staubli = Part("ident_0_5s"), Part("valid_5_9s")
    coupling = "joint_coupling@joint_5+joint_6"
    found += [Pair("tiago", (tiago[0],), tiago[1]), Pair("tiago", (tiago[1],), tiago[0])]
    found += [Pair("staubli_tx40", (staubli[0],), staubli[1])]
    found += [Pair("staubli_tx40", (a,), b, effects=coupling) for a, b in (staubli, staubli[::-1])]
    slide = Part("train"), Part("test_pulses")
    return [*found, Pair("emps", (slide[0],), slide[1]), Pair("emps", (slide[1],), slide[0])]


def mapping_of(robot: str, name: str) -> dict[str, Any] | None:
    """The mapping of a log's columns."""
    if robot == "ur10e":
        return {"current_gain": UR10E_GAIN}
    if robot != "lbr_med7":
        return None
    states = name == "joint_states"
    columns = ("position_lbr_joint_{}", "effort_lbr_joint_{}") if states else ("q_{}", "tau_{}")
    joints = {
        f"A{k + 1}": {"q": columns[0].format(k), "tau": columns[1].format(k), "torque_sign": -1}
        | ({"v": f"velocity_lbr_joint_{k}"} if states else {})
        for k in range(7)
    }
    return {"file": {"time": "time" if states else "t"}, "joint": joints}


def read(folder: Path, robot: fr.Robot, name: str, part: Part) -> fr.Log:
    """Read a log, or some seconds of it."""
    path = next(folder.joinpath(name, "logs").glob(f"{part.name}.parquet"), None) or folder.joinpath(
        name, "logs", f"{part.name}.csv"
    )
    log = fr.read_log(path, robot.joints, mapping_of(name, part.name))
    if np.isinf(part.stop):
        return log
    inside = (log.t - log.t[0] >= part.start) & (log.t - log.t[0] < part.stop)
    channels = {
        key: None if value is None else value[inside]
        for key, value in (
            ("t", log.t),
            ("q", log.q),
            ("v", log.v),
            ("a", log.a),
            ("tau", log.tau),
            ("current", log.current),
        )
    }
    return replace(log, **channels, extra={key: value[inside] for key, value in log.extra.items()})


def loaded(pair: Pair, folder: Path) -> tuple[fr.Robot, list[fr.Log], fr.Log, dict[str, Any]]:
    """The robot, the logs to fit, the other log, and options of `identify`."""
    urdf = next(p for p in sorted(folder.joinpath(pair.robot).glob("*.urdf")) if "with_hand" not in p.name)
    robot = fr.Robot.load(urdf)
    fit, valid = (
        [read(folder, robot, pair.robot, part) for part in pair.fit],
        read(folder, robot, pair.robot, pair.valid),
    )
    options: dict[str, Any] = {"recursion": "none", "cutoff": pair.cutoff or "auto", "force": True}
    if pair.robot == "tiago":
        options["torque_joints"] = TIAGO_ROWS
    if pair.effects:
        baseline = fr.identify(robot, fit, **options).model.effects
        options["effects"] = (*baseline, *fr.parse_effects(pair.effects))
    return robot, fit, valid, options


def held_against(pair: Pair, folder: Path) -> dict[str, Any]:
    """One row of the table."""
    robot, fit, valid, options = loaded(pair, folder)
    try:
        alone = fr.identify(robot, fit, valid=[valid], prior="none", **options).comparison.nrmse
    except IdentifiabilityError:
        alone = float("inf")
    before = fr.identify(robot, fit, **options)
    found = fr.compare(before.model, [valid])
    inside, width = coverage(before.model, valid)
    best = min(alone, found.nominal)
    return {
        "robot": pair.robot,
        "fitted": pair.fitted,
        "held against": str(pair.valid),
        "cut-off Hz": before.model.lowpass.cutoff,
        "least squares": alone,
        "URDF + friction": found.nominal,
        "prior": found.nrmse,
        "prior / best": found.nrmse / best,
        "expected": float(np.mean([j.expected for j in found.joints])),
        "cross-validated": float(np.mean(list(before.cross_validation.values()))),
        "90 % holds": float(np.mean(inside)),
        "worst joint": float(np.min(inside)),
        "width / constant's": width,
        "alarms before": ", ".join(a.id for a in before.alarms) or "–",
        "alarms there": ", ".join(a.id for a in found.alarms) or "–",
    }


def coverage(model: fr.Model, log: fr.Log) -> tuple[list[float], float]:
    """Share of each joint's samples inside the 90 % interval, and its median width over a constant torque's."""
    band = predict(model, [log])
    inside, widths = [], []
    for j in range(len(band.joints)):
        used = band.used[:, j]
        x = band.measured[used, j]
        inside.append(float(np.mean((x >= band.lower[used, j]) & (x <= band.upper[used, j]))))
        widths.append(float(np.mean(band.upper[used, j] - band.lower[used, j]) / (2 * 1.645 * x.std())))
    return inside, float(np.median(widths))


def summary(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The figures of the whole table."""
    ratios = np.array([row["prior / best"] for row in rows])
    return [
        f"prior over the best of least squares and URDF + friction: geometric mean "
        f"{np.exp(np.log(ratios).mean()):.3f}, "
        f"worst {ratios.max():.2f}, over {len(rows)} pairs",
    ]


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--only", metavar="ROBOT", help="pairs of one robot")
    chosen = options.parse_args()
    folder = data_folder()
    if folder is None:
        sys.exit("set FRISCHID_DATA to the folder of measured logs")
    rows = [held_against(pair, folder) for pair in pairs() if chosen.only in (None, pair.robot)]
    publish("trust: fitted on one log, held against another", rows, chosen.json, summary(rows))


if __name__ == "__main__":
    main()
