"""The hash of a model file, by which an edit of any value is noticed.

A model file is plain JSON, and a number that was edited by hand still is one: no rule can tell it from an estimate. So
the file holds the SHA-256 of its content, whatever the order of its fields, its spaces and its way of writing numbers.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from frischid.model.model_file import damaged
from frischid.model.stored_paths import portable


def digest(data: Mapping[str, Any]) -> str:
    """SHA-256 of everything that a model file says, however the file is laid out; the hash itself is left out."""
    content = _canonical(without_hash(data))
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def check_digest(data: Mapping[str, Any], source: str) -> None:
    """Refuse a model that was edited after frischid wrote the file; without a hash, nobody can tell.

    Raises
    ------
    InputError
        The content is not the one that the hash was made of.
    """
    if data.get("sha256") is not None and data["sha256"] != digest(data):
        raise damaged(
            source,
            "a value was changed after frischid wrote the file; take a copy of the file, or delete its field `sha256` "
            "to use the changed values on your own responsibility",
        )


def check_stored(written: Mapping[str, Any], source: str) -> None:
    """The same of a file's content; a file whose hash was taken out is read with a warning."""
    check_digest(written, source)
    if written.get("sha256") is None:
        warnings.warn(
            f"{source} holds no hash of its content (`sha256`): frischid cannot notice a changed number", stacklevel=3
        )


def _canonical(value: Any) -> Any:
    """Numbers as floats: 1 and 1.0 are the same number, and other programs write one for the other."""
    if isinstance(value, Mapping):
        return {str(k): _canonical(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(v) for v in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53 else value


def text_of(data: Mapping[str, Any], folder: Path) -> str:
    """Content of a model file in a folder, with its hash.

    Parameters
    ----------
    data : mapping
        `Model.to_dict`.
    folder : Path
        Paths of logs are relative to it.
    """
    found = portable(data, folder)
    found["sha256"] = digest(found)
    return json.dumps(found, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def without_hash(found: Any) -> Any:
    """The content of a model file without its hash; anything but a JSON object as it is."""
    return {k: v for k, v in found.items() if k != "sha256"} if isinstance(found, Mapping) else found
