"""Ordered results with names: access by position to iterate over them, by name to get one."""

from __future__ import annotations

from collections.abc import ItemsView, Iterator, KeysView, Mapping, ValuesView
from typing import Generic, TypeVar, overload

from frischid.errors import UnknownNameError

T = TypeVar("T")


class NamedSequence(Generic[T]):
    """Values with access by position, slice or name; iteration gives the values.

    Parameters
    ----------
    kind : str
        Kind of one value, for the message on an unknown name.
    values : mapping of str to T
        In order.

    Examples
    --------
    >>> from frischid.core.named_sequence import NamedSequence
    >>> joints = NamedSequence("joint", {"shoulder": 0.1, "elbow": 0.2})
    >>> joints[0], joints["elbow"], joints[-1:], len(joints), "wrist" in joints
    (0.1, 0.2, (0.2,), 2, False)
    """

    def __init__(self, kind: str, values: Mapping[str, T]) -> None:
        self._kind, self._values = kind, dict(values)

    @overload
    def __getitem__(self, key: int | str) -> T: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[T, ...]: ...
    def __getitem__(self, key: int | str | slice) -> T | tuple[T, ...]:
        if isinstance(key, str):
            if key not in self._values:
                raise UnknownNameError(self._kind, key, self._values)
            return self._values[key]
        return tuple(self._values.values())[key]

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[T]:
        return iter(self._values.values())

    def __contains__(self, name: object) -> bool:
        """Whether there is a value of this name."""
        return name in self._values

    @property
    def names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(self._values)

    def keys(self) -> KeysView[str]:
        """Names in order."""
        return self._values.keys()

    def values(self) -> ValuesView[T]:
        """Values in order."""
        return self._values.values()

    def items(self) -> ItemsView[str, T]:
        """Names with their values, in order."""
        return self._values.items()

    def __repr__(self) -> str:
        return f"{len(self)} values by {self._kind}: {', '.join(self._values)}"
