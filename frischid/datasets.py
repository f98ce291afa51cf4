"""Public logs of real robots: fetched by permanent address, believed by checksum.

Nothing is bundled. A data set's files are addressed by a commit, which cannot change, and each must have the SHA-256
that its owner published. A data set whose owner published none is described, not fetched: see `Dataset.files`. The
download is done by ``pooch`` (the extra ``frischid[fetch]``); a folder that holds the files already does as well.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from frischid.errors import InputError, UnknownNameError
from frischid.mapping import LogMap
from frischid.model import write_text
from frischid.tables import read_table, write_table

CHANNELS = {"position": "q", "velocity": "v", "effort": "current"}


@dataclass(frozen=True)
class Dataset:
    """One public data set.

    Attributes
    ----------
    title : str
    page : str
        Where a person reads about it.
    licence, citation : str
        Printed with every fetch.
    address : str
        Prefix of the files' addresses, with a commit in it.
    files : mapping of str to str
        Path after `address` -> SHA-256; empty where none was published.
    logs : mapping of str to str
        Name of a log to make -> folder of its ``tiago_<channel>.csv`` files.
    remarks : str
        What a user must know of the data.
    """

    title: str
    page: str
    licence: str
    citation: str
    address: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    logs: Mapping[str, str] = field(default_factory=dict)
    remarks: str = ""


_FIGAROH = "https://github.com/thanhndv212/figaroh-examples"
_COMMIT = "2c905a08b71f2a59452ac26ff9754135d8b5b1c2"
_TIAGO = "examples/tiago/data/identification"

DATASETS = {
    "tiago": Dataset(
        "TIAGo, torso and arm: an exciting motion, the same at half speed, and with a payload (2021)",
        f"{_FIGAROH}/tree/{_COMMIT}/{_TIAGO}",
        "Apache-2.0",
        "Thanh D. V. Nguyen and others (CNRS, Toward), figaroh-examples, TIAGo identification data, 2021",
        f"https://raw.githubusercontent.com/thanhndv212/figaroh-examples/{_COMMIT}/{_TIAGO}/",
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
        "Efforts are raw controller values; as torque = gain x effort the owners take 13.6 for arm_1 and arm_2, "
        "-8.7 for arm_3 "
        "and arm_4, -20.6 for arm_5 to arm_7. The torso's has no usable unit. `frischid check` finds the rest.",
    ),
    "ur10e": Dataset(
        "UR10e, six motions from motor currents, one with a payload of 2.805 kg",
        "https://github.com/shamilmamedov/dynamic_calibration",
        "none stated (its URDF package: BSD)",
        "S. Mamedov, dynamic_calibration (commit 11af40e)",
    ),
    "panda": Dataset(
        "Franka Emika Panda, one exciting motion, link-side torque sensors",
        "https://github.com/marcocognetti/FrankaEmikaPandaDynModel",
        "GPL-3.0",
        "C. Gaz, M. Cognetti and others, Dynamic Identification of the Franka Emika Panda Robot With Retrieval "
        "of Feasible "
        "Parameters Using Penalty-Based Optimization, IEEE RA-L 4(4), 2019 (commit 24d85ce)",
    ),
}


def fetch(
    name: str, output: str | Path, source: str | Path | None = None, progress: Callable[[str], None] = lambda _: None
) -> tuple[Dataset, list[Path]]:
    """Put a data set's files, checked, and logs made of them into a folder.

    Parameters
    ----------
    name : str
        One of `DATASETS`.
    output : str or Path
        Folder; made if need be.
    source : str or Path, optional
        Folder that holds the files already, under their paths or just their names; nothing is then downloaded.
    progress : callable
        Told what is being done.

    Returns
    -------
    dataset : Dataset
    paths : list of Path
        The logs that were written.

    Raises
    ------
    InputError
        A file is missing, or its checksum is not the published one; nothing of it is kept then.
    """
    if name not in DATASETS:
        raise UnknownNameError("data set", name, DATASETS)
    dataset, folder = DATASETS[name], Path(output)
    if not dataset.files:
        raise InputError(
            f"{name}: its owners published no checksums, so nothing is fetched on trust; take it from {dataset.page} "
            f"({dataset.licence}) and describe its columns in a mapping file (frischid map)"
        )
    get = _downloader(dataset, folder) if source is None else _copier(Path(source), folder)
    for path, digest in dataset.files.items():
        progress(path)
        get(path, digest)
    paths = []
    for log, part in dataset.logs.items():
        paths.append(folder / f"{log}.parquet")
        write_table(_joined(folder / part), paths[-1])
    write_text(folder / "SOURCE.txt", about(dataset))
    return dataset, paths


def about(dataset: Dataset) -> str:
    """Title, address, licence and citation, in lines."""
    lines = [dataset.title, f"from: {dataset.page}", f"licence: {dataset.licence}", f"cite: {dataset.citation}"]
    return "\n".join([*lines, *([dataset.remarks] if dataset.remarks else [])]) + "\n"


def _downloader(dataset: Dataset, folder: Path) -> Callable[[str, str], None]:
    try:
        import pooch
    except ImportError as error:
        raise InputError('fetching needs more: pip install "frischid[fetch]"; or give a folder with --from') from error

    def get(path: str, digest: str) -> None:
        place = folder / path
        try:
            pooch.retrieve(dataset.address + path, f"sha256:{digest}", fname=place.name, path=place.parent)
        except ValueError as error:  # the hash
            raise InputError(f"{dataset.address}{path}: {error}; nothing was kept") from error
        except Exception as error:  # requests raises dozens of types
            raise InputError(
                f"{dataset.address}{path}: cannot be downloaded ({type(error).__name__}); without a network, give "
                "a folder that "
                "holds the files with --from"
            ) from error

    return get


def _copier(source: Path, folder: Path) -> Callable[[str, str], None]:
    def get(path: str, digest: str) -> None:
        found = next((p for p in (source / path, source / Path(path).name) if p.is_file()), None)
        if found is None:
            raise InputError(f"{source}: holds no {path}; the data set's files belong there under their own paths")
        content = found.read_bytes()
        if (own := hashlib.sha256(content).hexdigest()) != digest:
            raise InputError(
                f"{found}: its SHA-256 is {own}, published is {digest}; it is another file, fetch it again"
            )
        place = folder / path
        place.parent.mkdir(parents=True, exist_ok=True)
        scratch = place.with_name(f".{place.name}.tmp")
        scratch.write_bytes(content)
        scratch.replace(place)

    return get


def _joined(folder: Path) -> dict[str, Any]:
    """Columns of one log, from the files of its channels on one clock."""
    table: dict[str, Any] = {}
    for kind, channel in CHANNELS.items():
        path = folder / f"tiago_{kind}.csv"
        part = read_table(path, LogMap())
        t = np.asarray(part.values("t"), dtype=float)
        if not np.array_equal(table.setdefault("t", t), t):
            raise InputError(f"{path}: its stamps are not those of the other channels")
        for name in part.names:
            joint = name.removeprefix("- ").removesuffix(f"_{kind}")
            if name != "t" and name not in part.unusable:
                table[f"{channel}_{joint}"] = np.asarray(part.values(name), dtype=float)
    return table
