"""Layouts of data sets whose checksum nobody published: their contents are checked instead.

A file that was put into place by hand may be another one. So each layout checks what is known of its file: the names of
the variables, the number of columns and samples, the sampling rate, and ranges of values.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.mapping import LogMap
from frischid.logs.tables import read_table

EMPS_SAMPLES = 24841
"""Samples of each of the two recordings, at 1 kHz."""
EMPS_REACH = 0.3
"""m. The slide's positions stay within this."""
TX40_RATE = 5000.0
"""Hz."""
TX40_GEARS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)
"""Motor turns per joint turn; motor 6 also turns with joint 5, by the gear of joint 6."""
TX40_ZEROS = (0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0)
"""rad, added to the joints' angles: the zeros of the URDF."""
KR300_SHAPE = (6, 90_881)
"""Axes and samples of each recording, at 250 Hz."""
KR300_STEP = 0.004
"""s."""
KR300_REACH = 360.0
"""deg. No axis turns further."""
KR300_SEEN_BEHIND = 3
"""First axes whose position the owners take from the second encoder, behind the gear."""


def emps(path: Path) -> dict[str, Any]:
    """The slide's log from a MATLAB file with t, qm, qg, vir and gtau: the drive's force is gtau times the voltage.

    Raises
    ------
    InputError
        The file is not this recording.
    """
    wanted = ("t", "qm", "qg", "vir", "gtau")
    content = _matlab(path, wanted, ("pulses_N",), "EMPS")
    t, q, reference, voltage = (np.asarray(content[name], dtype=float).ravel() for name in wanted[:4])
    _check(path, "samples", len(t), len(t) == EMPS_SAMPLES, f"{EMPS_SAMPLES}")
    _check(
        path, "qm, qg and vir", "of different lengths", len({len(x) for x in (t, q, reference, voltage)}) == 1, "one"
    )
    _check(path, "rate", 1 / float(np.median(np.diff(t))), abs(np.median(np.diff(t)) - 1e-3) < 1e-6, "1000 Hz")
    _check(
        path, "largest position", float(np.abs(q).max()), bool(np.abs(q).max() < EMPS_REACH), f"below {EMPS_REACH} m"
    )
    gain = float(np.asarray(content["gtau"], dtype=float).ravel()[0])
    table: dict[str, Any] = {"t": t, "q_slide": q, "tau_slide": gain * voltage, "qref_slide": reference}
    if "pulses_N" in content:
        table["pulses"] = np.asarray(content["pulses_N"], dtype=float).ravel()
    return table


def kr300(path: Path) -> dict[str, Any]:
    """A log of the arm from a MATLAB file: degrees and N·m at 250 Hz.

    Position and velocity are those that the owners use: of the second encoder behind the gear on axes 1 to 3, of the
    motor on axes 4 to 6. The channel ``qm`` has the motors' positions of all axes, ``qref`` the positions of the path.

    Raises
    ------
    InputError
        The file is not such a recording.
    """
    channels = ("q_se_meas", "qd_se_meas", "q_mot_meas", "qd_mot_meas", "tau_meas", "q_ref")
    content = _matlab(path, ("time", "recording_ok", *channels), (), "KR300")
    shapes = {content[name].shape for name in channels}
    _check(path, "axes and samples", sorted(shapes), shapes == {KR300_SHAPE}, str(KR300_SHAPE))
    rows = {name: np.asarray(content[name], dtype=float).T for name in channels}
    t = np.asarray(content["time"], dtype=float).ravel()
    _check(path, "time stamps", len(t), len(t) == KR300_SHAPE[1], str(KR300_SHAPE[1]))
    steady = bool(np.allclose(np.diff(t), KR300_STEP, rtol=0, atol=1e-9))
    _check(path, "time steps", f"{np.diff(t).min():.6g} to {np.diff(t).max():.6g} s", steady, f"{KR300_STEP} s")
    finite = all(np.isfinite(x).all() for x in rows.values())
    _check(path, "values", "NaN or infinity", finite, "finite numbers")
    far = max(float(np.abs(rows[name]).max()) for name in ("q_se_meas", "q_mot_meas"))
    _check(path, "largest angle", f"{far:.6g} deg", far <= KR300_REACH, f"at most {KR300_REACH:g} deg")
    _check(path, "recording_ok", "false", bool(np.all(content["recording_ok"])), "true")
    behind = np.arange(KR300_SHAPE[0]) < KR300_SEEN_BEHIND
    found = {
        "q": np.deg2rad(np.where(behind, rows["q_se_meas"], rows["q_mot_meas"])),
        "v": np.deg2rad(np.where(behind, rows["qd_se_meas"], rows["qd_mot_meas"])),
        "tau": rows["tau_meas"],
        "qm": np.deg2rad(rows["q_mot_meas"]),
        "qref": np.deg2rad(rows["q_ref"]),
    }
    columns = {f"{c}_joint_a{k + 1}": column for c, values in found.items() for k, column in enumerate(values.T)}
    return {"t": t, **columns}


def _matlab(path: Path, wanted: Sequence[str], optional: Sequence[str], owner: str) -> dict[str, Any]:
    """Some variables of a MATLAB file; others are not read."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content: dict[str, Any] = loadmat(path, variable_names=[*wanted, *optional])
    except (MatReadError, ValueError, OSError, NotImplementedError) as error:
        raise InputError(f"{path}: cannot be read as a MATLAB file ({error})") from error
    if missing := [name for name in wanted if name not in content]:
        raise InputError(f"{path}: holds no {', '.join(missing)}; {owner} files hold {', '.join(wanted)}")
    return content


def staubli_tx40(folder: Path) -> dict[str, Any]:
    """The arm's log from its motors' positions (rad) and torques (N·m): q = R⁻¹ q_m + zeros, τ = Rᵀ τ_m.

    Raises
    ------
    InputError
        The files are not these recordings.
    """
    motor, torque = (_rows(folder / name) for name in ("pos_read_data.csv", "curr_data.csv"))
    _check(folder, "rows of the two files", f"{len(motor)} and {len(torque)}", len(motor) == len(torque), "equal")
    R = np.diag(TX40_GEARS)
    R[5, 4] = TX40_GEARS[5]
    q = np.linalg.solve(R, motor.T).T + TX40_ZEROS
    _check(folder, "largest angle", float(np.abs(q).max()), bool(np.abs(q).max() < 2 * np.pi), "below a turn")
    tau = torque @ R
    names = [f"joint_{k}" for k in range(1, 7)]
    table: dict[str, Any] = {"t": np.arange(len(q)) / TX40_RATE}
    for channel, values in {"q": q, "tau": tau, "qm": motor, "taum": torque}.items():
        table |= {f"{channel}_{name}": column for name, column in zip(names, values.T, strict=True)}
    return table


def _rows(path: Path) -> Array:
    """Six columns of numbers, with or without a header."""
    first = path.read_text(encoding="utf-8", errors="replace").split("\n", 1)[0]
    header = not all(_is_number(cell) for cell in first.split(","))
    table = read_table(path, LogMap(header=header))
    columns = [np.asarray(x, dtype=float) for x in table.numeric.values()]
    _check(path, "columns of numbers", len(columns), len(columns) == len(TX40_GEARS), f"{len(TX40_GEARS)}")
    return np.column_stack(columns)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check(path: Path, what: str, value: object, good: bool, wanted: str) -> None:
    if not good:
        raise InputError(f"{path}: {what}: {value}, expected {wanted}; it is not the data set's file")
