"""NPZ archives as tables: 1-D arrays are columns, 2-D arrays are blocks with one column per joint.

MuJoCo's names of arrays (qpos, qvel, qacc, qfrc_actuator, time) are read as frischid's.
"""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frischid.errors import InputError
from frischid.logs.log import CHANNELS
from frischid.logs.mapping import LogMap
from frischid.logs.table import Table, check_width, place_after

MUJOCO = {"qpos": "q", "qvel": "v", "qacc": "a", "qfrc_actuator": "tau", "time": "t"}


def read_npz(path: Path, form: LogMap, order: Sequence[str] = ()) -> Table:
    """Columns by name, or 2-D blocks (N, J) called q, v, a, tau, current beside the names `joints`.

    Blocks as wide as `order` take its names, if neither the file nor the mapping names the joints.
    """
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: is not an NPZ archive; write it with numpy.savez or frischid.write_log")
    with np.load(path, allow_pickle=False) as file:
        check_width(path, len(file.files))
        arrays = dict(file.items())
    if wrong := [name for name, x in arrays.items() if not isinstance(x, np.ndarray)]:
        raise InputError(f"{path}: {wrong[0]} in the archive is no array; write it with numpy.savez")
    notes = _mujoco_names(arrays)
    joints = arrays.pop("joints").tolist() if arrays.get("joints", np.empty(0)).dtype.kind == "U" else list(form.joints)
    if not joints and arrays.get("q", np.empty(0)).shape[1:] == (len(order),):
        joints = list(order)
        notes += (f"the file names no joints: its columns are taken in the robot's order, {', '.join(joints)}",)
    for name in [name for name, x in arrays.items() if x.ndim == 2]:
        if arrays[name].shape[1] == len(joints):
            block = arrays.pop(name)
            arrays |= {f"{name}_{joint}": block[:, j] for j, joint in enumerate(joints)}
        elif name in CHANNELS:
            raise InputError(
                f"{path}: {name} has {arrays[name].shape[1]} columns, but the string array 'joints' names "
                f"{len(joints)}: {', '.join(joints) or '(none)'}; store such an array, or list the columns' joints in "
                "order as joints = [...] under [file] in a mapping file"
            )
    # The log's length is that of most columns.
    shape = Counter(x.shape for x in arrays.values() if x.ndim == 1).most_common(1)
    if not shape:
        raise InputError(f"{path}: holds no columns (1-D arrays), only {', '.join(arrays) or 'nothing'}")
    numeric, unusable = {}, {}
    for name, values in arrays.items():
        if values.dtype.kind not in "iufb" or values.shape != shape[0][0]:
            unusable[name] = f"it has type {values.dtype} and shape {values.shape}"
        else:
            numeric[name] = values
    return Table(str(path), tuple(arrays), numeric, unusable, notes=notes)


def npz_chunks(path: Path, form: LogMap, rows: int, order: Sequence[str] = ()) -> Iterator[Table]:
    """Tables of consecutive rows; the file is in memory as a whole."""
    whole = read_npz(path, form, order)
    for start in range(0, whole.rows, rows):
        part = {name: x[start : start + rows] for name, x in whole.numeric.items()}
        yield replace(whole, numeric=part, place=place_after(start, whole.place), first=start)


def npz_names(path: Path, form: LogMap) -> Sequence[str]:
    """Names of a file's columns, which only its arrays tell."""
    return read_npz(path, form).names


def npz_bytes(path: Path) -> int:
    """Bytes of the numbers of a file."""
    with zipfile.ZipFile(path) as archive:
        return sum(part.file_size for part in archive.infolist())


def _mujoco_names(arrays: dict[str, NDArray[Any]]) -> tuple[str, ...]:
    """Rename arrays with MuJoCo's names (qpos, qvel, qacc, qfrc_actuator, time); return a note on them."""
    renamed = (
        {old: new for old, new in MUJOCO.items() if old in arrays and new not in arrays} if "qpos" in arrays else {}
    )
    for old, new in renamed.items():
        arrays[new] = np.squeeze(arrays.pop(old)) if new == "t" else arrays.pop(old)
    return (f"MuJoCo's {', '.join(renamed)} taken as {', '.join(renamed.values())}",) if renamed else ()
