"""Columns of candidate effects that diagnoses of the same motions have in common.

    C_j = S_j F c_j(q, q̇, q̈, ...)

depends on the motion, the filter and the reference parameters, and not on the effects or the parameters of the model
that is diagnosed. After an effect was added, the next diagnosis of the same logs needs the same columns again. So they
are shared by their content, as long as any diagnosis of these motions lives.
"""

from __future__ import annotations

import hashlib
import weakref
from collections.abc import Hashable, Iterable

import numpy as np

from frischid.core.array_store import Store
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.effects import Effect, State


class KnownColumns:
    """Candidates by the class and the text of their effect, and the store of their columns."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.candidates: dict[tuple[type[Effect], str], Candidate] = {}


_LIVING: weakref.WeakValueDictionary[str, KnownColumns] = weakref.WeakValueDictionary()


def known_columns(key: str, store: Store) -> KnownColumns:
    """Columns of candidates of motions with the same fingerprint; new ones are put into `store`."""
    return _LIVING.setdefault(key, KnownColumns(store))


def fingerprint(parts: Iterable[Hashable | Array | State]) -> str:
    """Hash of numbers, names, arrays, and all that an effect reads of a state."""
    digest = hashlib.blake2b()
    for part in parts:
        if isinstance(part, State):
            arrays = (part.t, part.q, part.v, part.a, part.load, part.torque, part.reference, part.dry)
            inner = fingerprint([*arrays, part.start, *(x for pair in part.extra.items() for x in pair)])
            digest.update(inner.encode())
        elif isinstance(part, np.ndarray):
            digest.update(repr((part.shape, part.dtype.str)).encode())
            digest.update(np.ascontiguousarray(part).view(np.uint8).data if part.size else b"")
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()
