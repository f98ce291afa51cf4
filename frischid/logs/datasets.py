"""Public logs of real robots: fetched by permanent address, verified by checksum.

frischid ships none of the data. The address of a file contains a commit, which cannot change. The file must have the
SHA-256 written in `frischid.logs.dataset_list`: the one that its owner published, or else that of the commit's file
when that module was written. ``pooch`` (the extra ``frischid[fetch]``) downloads the files; a folder that already holds
the files can be given instead. Where nobody published a checksum of the files, or an archive holds them, the user puts
them into a folder by hand, and the contents are checked (`frischid.logs.dataset_checks`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from frischid.core.extras import install_command
from frischid.core.files import write_text, written
from frischid.errors import InputError, UnknownNameError
from frischid.logs.dataset_list import DATASETS, Archive, Dataset
from frischid.logs.table_writing import write_table


def _by_hand(dataset: Dataset) -> bool:
    return not all(dataset.files.values())


def fetch(
    name: str, output: str | Path, source: str | Path | None = None, progress: Callable[[str], None] = lambda _: None
) -> tuple[Dataset, list[Path]]:
    """Fetch and verify a data set's files, and write the logs made from them into a folder.

    Parameters
    ----------
    name : str
        One of `DATASETS`.
    output : str or Path
        Folder; created if necessary.
    source : str or Path, optional
        Folder that already holds the files, under their paths or their names; then nothing is downloaded.
    progress : callable
        Called with the name of each file before it is fetched.

    Returns
    -------
    dataset : Dataset
    paths : list of Path
        The logs that were written.

    Raises
    ------
    InputError
        A file is missing, its checksum differs from the known one (then nothing of the file is kept), or its contents
        are not those of the data set.
    """
    if name not in DATASETS:
        raise UnknownNameError("data set", name, DATASETS)
    dataset, folder = DATASETS[name], Path(output)
    if source is None and _by_hand(dataset):
        raise InputError(_what_to_do(name, dataset))
    get = _downloader(dataset, folder) if source is None else _copier(Path(source), folder)
    if source is not None and dataset.archive is not None:
        _check_archive(Path(source) / dataset.archive.name, dataset.archive)
    for path, digest in dataset.files.items():
        progress(path)
        get(path, digest)
    paths = []
    for log, part in dataset.logs.items():
        paths.append(folder / f"{log}.parquet")
        write_table(dataset.layout(folder / part), paths[-1])
    write_text(folder / "SOURCE.txt", about(dataset))
    return dataset, paths


def _what_to_do(name: str, dataset: Dataset) -> str:
    """How the user gets files that are not downloaded."""
    then = f"then: frischid fetch {name} --from FOLDER"
    if dataset.archive is None:
        names = ", ".join(dataset.files)
        return (
            f"{name}: no checksum of these files is known, so they are not downloaded; put {names} from {dataset.page} "
            f"into a folder, {then}"
        )
    address, size, md5 = dataset.archive
    return (
        f"{name}: the files are in a RAR archive, which Python cannot unpack; download {address} ({size / 1e6:.0f} MB, "
        f"MD5 {md5}) into a folder and unpack it there, {then}. The archive's MD5 is checked if the archive stays there"
    )


def about(dataset: Dataset) -> str:
    """Title, address, licence and citation, in lines."""
    lines = [dataset.title, f"from: {dataset.page}", f"licence: {dataset.licence}", f"cite: {dataset.citation}"]
    return "\n".join([*lines, *([dataset.remarks] if dataset.remarks else [])]) + "\n"


def _check_archive(path: Path, archive: Archive) -> None:
    """Refuse another archive; one that is not there says nothing."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        own = hashlib.file_digest(file, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
    if own != archive.md5:
        raise InputError(f"{path}: its MD5 is {own}, that of the data set is {archive.md5}; download it again")


def _downloader(dataset: Dataset, folder: Path) -> Callable[[str, str], None]:
    try:
        import pooch
    except ImportError as error:
        raise InputError(f"fetching needs more: {install_command('fetch')}; or give a folder with --from") from error

    def get(path: str, digest: str) -> None:
        place = folder / path
        try:
            pooch.retrieve(dataset.address + path, f"sha256:{digest}", fname=place.name, path=place.parent)
        except ValueError as error:  # the hash
            raise InputError(f"{dataset.address}{path}: {error}; nothing was kept") from error
        except OSError as error:  # every error of requests is one
            raise InputError(
                f"{dataset.address}{path}: cannot be downloaded ({type(error).__name__}); without a network, give a "
                "folder that holds the files with --from"
            ) from error

    return get


def _copier(source: Path, folder: Path) -> Callable[[str, str], None]:
    def get(path: str, digest: str) -> None:
        found = next((p for p in (source / path, source / Path(path).name) if p.is_file()), None)
        if found is None:
            raise InputError(f"{source}: holds no {path}; the data set's files belong there under their own paths")
        content = found.read_bytes()
        if digest and (own := hashlib.sha256(content).hexdigest()) != digest:
            raise InputError(
                f"{found}: its SHA-256 is {own}, that of the data set is {digest}; it is another file, fetch it again"
            )
        place = folder / path
        place.parent.mkdir(parents=True, exist_ok=True)
        with written(place) as scratch:
            scratch.write_bytes(content)

    return get
