"""What `check`, `map`, `payload`, `diagnose` and `gains` say about measured logs: the figures in the guides' sentences.

The commands run as a user types them, on logs of the UR10e, the Panda and TIAGo, and their JSON is read. Beside each
figure stands the true value where the data set states one. Needs FRISCHID_DATA.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import json
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from click.testing import CliRunner
from common import data_folder, parser, publish
from pyarrow import csv, parquet
from real_robots import UR10E_GAIN
from trust import FIVE

import frischid as fr
from frischid.cli import main as frischid

LOADED, UNLOADED, WEIGHED = "loaded_2805g_50s_14harm", "unloaded_50s_14harm", 2.805
HAND = 0.73
"""kg. The Panda's hand, by its data sheet."""


def said(*words: object) -> dict[str, Any]:
    """The JSON that a command prints."""
    result = CliRunner().invoke(frischid, [*map(str, words), "--json"])
    if result.exit_code not in (0, 1):
        sys.exit(result.output)
    return dict(json.loads(result.stdout))


def row(figure: str, value: float, error: float | None = None, truth: float | None = None) -> dict[str, Any]:
    """One figure: value, standard error (of masses: half of the 95 % range), and the true value."""
    return {"figure": figure, "value": value, "error": error, "truth": truth}


def kilograms(answer: dict[str, Any], kind: str) -> float:
    """The mass that an issue of `check` names."""
    (issue,) = (x for x in answer["logs"][0]["issues"] if x["kind"] == kind)
    found = re.search(r"about ([\d.]+) kg", issue["what"])
    assert found
    return float(found[1])


def checks(folder: Path, gains: Path) -> Iterator[dict[str, Any]]:
    """Clocks, late velocities, torques of zero, and masses that the URDF lacks."""
    ur10e, panda, tiago = (folder / name for name in ("ur10e", "panda", "tiago"))
    (plain,) = said("check", ur10e / "ur10e.urdf", ur10e / f"logs/{FIVE[0]}.parquet", "--map", gains)["logs"]
    yield row("clock of the UR10e", plain["stamps_follow"], plain["stamps_follow_error"])
    log = tiago / "logs/ident_0_48s.parquet"
    (late,) = said("check", tiago / "tiago_48_schunk.urdf", log)["logs"]
    yield row("clock of TIAGo", late["stamps_follow"], late["stamps_follow_error"])
    lags = [x["velocity_lag"] for x in late["joint_figures"].values() if x.get("velocity_lag") is not None]
    yield row("TIAGo's velocity, s late", float(np.median(lags)))
    columns = parquet.read_table(log)
    zeros = [float(np.mean(columns[f"tau_arm_{k}_joint"].to_numpy() == 0)) for k in (5, 6, 7)]
    yield row("TIAGo's zeros, least share", min(zeros))
    yield row("TIAGo's zeros, largest share", max(zeros))
    hand = said("check", panda / "panda_with_hand.urdf", panda / "logs/ident_0_14s.parquet")
    yield row("missing hand, kg", kilograms(hand, "missing hand"), None, HAND)
    loaded = said("check", ur10e / "ur10e.urdf", ur10e / f"logs/{LOADED}.parquet", "--map", gains)
    yield row("payload by check, kg", kilograms(loaded, "payload"), None, WEIGHED)


def masses(folder: Path, gains: Path, scratch: Path) -> Iterator[dict[str, Any]]:
    """The payload of the UR10e by two commands, and its drive gains from the payload."""
    urdf, logs = folder / "ur10e.urdf", folder / "logs"
    loaded, unloaded = (logs / f"{name}.parquet" for name in (LOADED, UNLOADED))
    model = scratch / "model.json"
    said("identify", urdf, *(logs / f"{name}.parquet" for name in FIVE), "--map", gains, "--bbrf", "none", "-o", model)
    body = said("payload", model, loaded, "--map", gains)
    yield row("payload, kg", body["mass"], body["bound_95"]["mass"], WEIGHED)
    names = ("--situation", "changed", "--try", "payload")
    found = said("diagnose", model, loaded, "--map", gains, *names)["findings"][0]
    assert found["effect"] == "payload"
    (mass,) = (x for name, x in found["parameters"].items() if re.fullmatch(r"dm\d+", name))
    yield row("payload by diagnose, kg", mass, None, WEIGHED)
    weighed = ("--unloaded", unloaded, "--loaded", loaded, "--payload", WEIGHED)
    answer = said("gains", urdf, *weighed, "--map", gains)
    yield row(
        "payload by the data set's gains, kg", answer["payload"]["mass"], answer["payload"]["mass_stderr"], WEIGHED
    )
    for joint in answer["joints"]:
        yield row(
            f"gain of {joint['joint']}, ratio", joint["gain"] / joint["given"], joint["stderr"] / joint["given"], 1.0
        )


def set_points(folder: Path, scratch: Path) -> Iterator[dict[str, Any]]:
    """The gains that `map` takes from a controller's own torques and currents, over those of the data set."""
    robot = fr.Robot.load(folder / "ur10e.urdf")
    names = {
        "q": "actual_q", "v": "actual_qd", "current": "actual_current", "current_des": "target_current",
        "tau_des": "target_moment",
    }  # fmt: skip
    for log in FIVE:
        columns = parquet.read_table(folder / "logs" / f"{log}.parquet")
        rtde = {"timestamp": columns["t"]} | {
            f"{name}_{k}": columns[f"{channel}_{joint}"]
            for channel, name in names.items()
            for k, joint in enumerate(robot.joints)
        }
        csv.write_csv(pa.table(rtde), scratch / "rtde.csv")
        gains = said("map", scratch / "rtde.csv", folder / "ur10e.urdf")["mapping"]["current_gain"]
        for joint, known in UR10E_GAIN.items():
            yield row(f"gain of {joint} by map, ratio", gains[joint] / known, None, 1.0)


def main() -> None:
    """Print one row per figure."""
    options = parser(__doc__).parse_args()
    folder = data_folder()
    if folder is None:
        sys.exit("set FRISCHID_DATA to the folder of measured logs")
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        gains = scratch / "gains.toml"
        lines = "\n".join(f"{joint} = {gain}" for joint, gain in UR10E_GAIN.items())
        gains.write_text(f'[default]\ntau_from = "current"\n[current_gain]\n{lines}\n', encoding="utf-8")
        rows = [
            *checks(folder, gains),
            *masses(folder / "ur10e", gains, scratch),
            *set_points(folder / "ur10e", scratch),
        ]
    publish("Commands on measured logs", rows, options.json)


if __name__ == "__main__":
    main()
