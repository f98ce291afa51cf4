"""The public data sets that frischid knows: their files, licences and citations, and how a log is made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from frischid.errors import InputError
from frischid.logs.dataset_checks import emps, kr300, staubli_tx40
from frischid.logs.mapping import LogMap
from frischid.logs.tables import read_table

Table = dict[str, Any]


class Archive(NamedTuple):
    """A file that holds the data set's files, and that the user unpacks: Python reads no RAR."""

    address: str
    size: int
    """Bytes."""
    md5: str
    """Checksum that another user of the data published."""

    @property
    def name(self) -> str:
        """File name."""
        return self.address.rpartition("/")[2]


@dataclass(frozen=True)
class Dataset:
    """One public data set."""

    title: str
    page: str
    """Web page about the data set."""
    licence: str
    citation: str
    """`licence`, `citation`: Printed with every fetch."""
    address: str
    """Prefix of the files' addresses."""
    files: Mapping[str, str]
    """Path after `address` -> SHA-256. The commit is in one of the two. An empty checksum: none is known, the file is
    put into a folder by hand, and `layout` checks its contents."""
    logs: Mapping[str, str]
    """Name of a log to make -> its file, or its folder of files."""
    layout: Callable[[Path], Table]
    """Makes a log's columns from such a file or folder."""
    remarks: str = ""
    """A warning about the data."""
    archive: Archive | None = None
    """The file that holds the others."""


def _by_channel(folder: Path) -> Table:
    """Layout of TIAGo's files: one file per channel, on one clock."""
    table: Table = {}
    for kind, channel in {"position": "q", "velocity": "v", "effort": "current"}.items():
        path = folder / f"tiago_{kind}.csv"
        part = read_table(path, LogMap())
        t = np.asarray(part.values("t"), dtype=float)
        if not np.array_equal(table.setdefault("t", t), t):
            raise InputError(f"{path}: the time stamps differ from those of the other channels; fetch the files again")
        for name in part.names:
            joint = name.removeprefix("- ").removesuffix(f"_{kind}")
            if name != "t" and name not in part.unusable:
                table[f"{channel}_{joint}"] = np.asarray(part.values(name), dtype=float)
    return table


def _without_header(path: Path) -> Table:
    """Layout of the UR10e's files: t, then six columns of each channel, no header; time counts from the first row."""
    rows = np.loadtxt(path, delimiter=",", ndmin=2)
    joints = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
    columns = [f"{c}_{joint}" for c in ("q", "v", "current", "current_des", "tau_des") for joint in joints]
    return {"t": rows[:, 0] - rows[0, 0], **dict(zip(columns, rows[:, 1:].T, strict=True))}


def _by_number(folder: Path) -> Table:
    """Layout of the Panda's files: one file per channel, one number per line, the seven joints in turn."""
    prefix = "exciting_traj"
    table: Table = {"t": np.loadtxt(folder / f"{prefix}_time.txt")}
    for channel, kind in {"q": "positions", "v": "velocity", "tau": "torques"}.items():
        rows = np.loadtxt(folder / f"{prefix}_{kind}.txt").reshape(len(table["t"]), 7)
        table |= {f"{channel}_panda_joint{k + 1}": column for k, column in enumerate(rows.T)}
    return table


_RAW = "https://raw.githubusercontent.com"
_FIGAROH = "thanhndv212/figaroh-examples"
_COMMIT = "2c905a08b71f2a59452ac26ff9754135d8b5b1c2"
_TIAGO = "examples/tiago/data/identification"
_UR10E = {
    "ident_20s_5harm": "40df589ea75e128ad2396ea4a78103a84efd2d6a/data_ur10/ur-20_02_06-20sec_5harm.csv",
    "ident_20s_10harm": "40df589ea75e128ad2396ea4a78103a84efd2d6a/data_ur10/ur-20_02_06-20sec_10harm.csv",
    "ident_30s_12harm": "ded626374e0aafe008758e8f5d1b4570c196c759/data_ur10/identification_data/"
    "ur-20_02_10-30sec_12harm.csv",
    "ident_40s_12harm": "3afa267a6dca8a91a6938e878a32ca086c5cc606/data_ur10/ur-20_02_12-40sec_12harm.csv",
    "ident_50s_12harm": "3afa267a6dca8a91a6938e878a32ca086c5cc606/data_ur10/ur-20_02_12-50sec_12harm.csv",
    "valid_ptp_10_points": "75b04d420373b7ae5ff27b0179e8a009665ec2af/dataset_ur10e/validation_data/"
    "ur-20_01_17-ptp_10_points.csv",
    "unloaded_50s_14harm": "ded626374e0aafe008758e8f5d1b4570c196c759/data_ur10/identification_data/"
    "ur-20_02_19_14harm50sec.csv",
    "loaded_2805g_50s_14harm": "3afa267a6dca8a91a6938e878a32ca086c5cc606/data_ur10/ur-20_02_19_14harm50secLoad.csv",
}

_KR300 = ("20H_29M", "20H_38M", "20H_45M", "21H_11M", "21H_32M", "21H_3M",
          "21H_41M", "21H_54M", "22H_10M", "22H_41M", "22H_50M", "22H_58M")  # fmt: skip

DATASETS = {
    "tiago": Dataset(
        "TIAGo, torso and arm: an exciting motion, the same at half speed, and with a payload (2021)",
        f"https://github.com/{_FIGAROH}/tree/{_COMMIT}/{_TIAGO}",
        "Apache-2.0",
        "Thanh D. V. Nguyen and others (CNRS, Toward), figaroh-examples, TIAGo identification data, 2021",
        f"{_RAW}/{_FIGAROH}/{_COMMIT}/{_TIAGO}/",
        {
            "dynamic/tiago_position.csv": "4297a60d434ee89f1f424ad0da8ec65bc00072ac57eb06b94966c0819fc2786d",
            "dynamic/tiago_velocity.csv": "269f681ca7a9511ac1698bf027ddf601e3fdb49d7d397af4810ec839f136cd69",
            "dynamic/tiago_effort.csv": "12c635987705efade603426a600f5b315add7f580c720a4b84609dadb9d0a2e9",
            "calibration_slow/tiago_position.csv": "6da32810214297de2cf4c7c348bede8c1b276f84043aef47540fb65ad801b1cc",
            "calibration_slow/tiago_velocity.csv": "1397f84447c2c5bc3cfed53ca7caa0f858729e420c53128a486cf0cb3afc7f25",
            "calibration_slow/tiago_effort.csv": "01edf8f95f69a7c8a19c4451a5091c246587861535898dcfd4314c85f582bbd4",
            "calibration_weight/tiago_position.csv": "f77da4167d0afe2c0a5b8a90bcd65ddcbdffc1bc1a7af60c6a7403877186b69b",
            "calibration_weight/tiago_velocity.csv": "db09e0be426499ba486659255a9238d19858dabc915a0f34e5712d3782244213",
            "calibration_weight/tiago_effort.csv": "5aeec78983071784306ccb5e23915719df75fb5db63f3d42483121ffb0d13241",
        },
        {"dynamic": "dynamic", "slow": "calibration_slow", "payload": "calibration_weight"},
        _by_channel,
        "Efforts are raw controller values; as torque = gain x effort the owners take 13.6 for arm_1 and arm_2, -8.7 "
        "for arm_3 and arm_4, -20.6 for arm_5 to arm_7. The torso's has no usable unit. `frischid check` finds the "
        "rest.",
    ),
    "ur10e": Dataset(
        "UR10e, eight motions with motor currents, one of them with a payload of 2.805 kg (2020)",
        "https://github.com/shamilmamedov/dynamic_calibration",
        "none stated (its URDF package: BSD); ask the owners before you pass the data on",
        "S. Mamedov and S. Mikhel, Practical Aspects of Model-Based Collision Detection, Frontiers in Robotics and AI "
        "7, 2020, doi 10.3389/frobt.2020.571574",
        f"{_RAW}/shamilmamedov/dynamic_calibration/",
        {
            _UR10E["ident_20s_5harm"]: "fd4d10b39211a5ad1d2f67b62bd3e66b01a0275d518fd2fd2f0876ea520903a4",
            _UR10E["ident_20s_10harm"]: "8959c47c991221e88a467a584c756a2f0f17c8268a291437709513cc112739c8",
            _UR10E["ident_30s_12harm"]: "341fff80f177be564c8720ea898165addfd46d7cbe6f3ffd8923eeaae0eef000",
            _UR10E["ident_40s_12harm"]: "1355f739afecc5a9330f906e0c403be0080407f5ce2c26652556fac5748c6236",
            _UR10E["ident_50s_12harm"]: "bb48cca42716a88f8b255d2d1b3eb3fa4a6eac4a9a52b694d4c1066ce8b4ca51",
            _UR10E["valid_ptp_10_points"]: "d97a4ac0c8b892b565d12f33af2bf0ef18183f7742e49d847d8ba92a041b56d8",
            _UR10E["unloaded_50s_14harm"]: "cd503afc985c41a6ad8fbe47d443c961eadbde4822a87ff3e17adcb2a24fa103",
            _UR10E["loaded_2805g_50s_14harm"]: "e689a99e5ff00ac38d03a2b9302e77688de0db8388b1d9c0e6aad3f77962758c",
        },
        _UR10E,
        _without_header,
        "Currents in A; as torque per ampere, joint by joint, 11.97, 11.98, 9.84, 10.75, 10.69, 10.68 N·m/A fit the "
        "controller's own model. The five ident logs are for identification.",
    ),
    "panda": Dataset(
        "Franka Emika Panda without hand, one exciting motion, link-side torque sensors, 1 kHz (2019)",
        "https://github.com/marcocognetti/FrankaEmikaPandaDynModel",
        "GPL-3.0",
        "C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano and A. De Luca, Dynamic Identification of the Franka Emika "
        "Panda Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization, IEEE RA-L 4(4), 2019",
        f"{_RAW}/marcocognetti/FrankaEmikaPandaDynModel/44f1ec8a615555eb3469ca9b0abd31ef863872b5/"
        "matlab/data/Exciting_Traj/Trajectory_1/rbt_log/",
        {
            "exciting_traj_time.txt": "031063612f297011dc005ab29830903e36f4bfeba77bce59c0fbde13620fb20d",
            "exciting_traj_positions.txt": "50bf82a082c439aff8220e8142985c8dd783f7ddc1415987cd75c9efb88bcf69",
            "exciting_traj_velocity.txt": "3340f299e926c501b66d540fa461ea0a7184b8dda32e505ebed062db57860d49",
            "exciting_traj_torques.txt": "11fda32785bb29ce444e14e0f45f4893aab7142dc6ee29576d828ab154852f9c",
        },
        {"trajectory_1": ""},
        _by_number,
        "The stamps are the computer's, not the robot's: `frischid check` shows the repeated rows and missing cycles.",
    ),
    "emps": Dataset(
        "EMPS, one prismatic axis with friction, position and drive voltage, 1 kHz (2019)",
        "https://github.com/wmkouw/NSI-EMPS/tree/d1137b8cc8a5ec3d75fe69c5d531075f7f6f616a/data",
        "MIT (that repository); the data set is that of nonlinearbenchmark.org",
        "A. Janot, M. Gautier and M. Brunot, Data Set and Reference Models of EMPS, Workshop on Nonlinear System "
        "Identification Benchmarks, 2019",
        "",
        {"DATA_EMPS.mat": "", "DATA_EMPS_PULSES.mat": ""},
        {"train": "DATA_EMPS.mat", "test_pulses": "DATA_EMPS_PULSES.mat"},
        emps,
        "Checked by its contents, not by a checksum. tau_slide is gtau times the voltage, N.",
    ),
    "staubli_tx40": Dataset(
        "Staubli TX40, one exciting motion, motor positions and motor torques, 5 kHz",
        f"https://github.com/{_FIGAROH}/tree/main/examples/staubli_tx40/data",
        "Apache-2.0 (headers)",
        "Thanh D. V. Nguyen and others (CNRS, Toward), figaroh-examples, Staubli TX40",
        "",
        {"pos_read_data.csv": "", "curr_data.csv": ""},
        {"exciting": ""},
        staubli_tx40,
        "Checked by its contents, not by a checksum. Motor 6 turns with joints 5 and 6: its friction acts on both.",
    ),
    "kr300": Dataset(
        "KUKA KR300 R2500 ultra SE, twelve recordings of six minutes, second encoders on three axes, 250 Hz (2021)",
        "https://doi.org/10.26204/DATA/5",
        "MIT and CC BY-SA 4.0 (the page)",
        "J. Weigand, J. Götz, J. Ulmen and M. Ruskowski, Dataset and Baseline for an Industrial Robot Identification "
        "Benchmark, TU Kaiserslautern, 2022",
        "",
        {f"raw_data/recording_2021_12_15_{time}.mat": "" for time in _KR300},
        {f"{'test' if time == _KR300[-1] else 'train'}_{time}": f"raw_data/recording_2021_12_15_{time}.mat"
         for time in _KR300},
        kr300,
        "Checked by its contents. The last recording is the owners' test. The owners call the torques those of the "
        "motors; frischid check tells whether they are on the axes' side. A hydraulic cylinder helps to carry the arm, "
        "and the gears have play. No URDF belongs to the data; github.com/rccn-dev/kuka_experimental has the geometry "
        "(kuka_kr300_support), with inertias that mean nothing.",
        Archive(
            "https://fdm-fallback.uni-kl.de/TUK/FB/MV/WSKL/0001/Robot_Identification_Benchmark_With_Raw_Data.rar",
            227_384_738,
            "4a9d3adbbca1c9b68577d6db63d58c58",
        ),
    ),
}  # fmt: skip
