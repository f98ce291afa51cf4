"""The catalogue of all effects: those of frischid and those of installed packages.

A class joins the catalogue when it is defined. A package announces its effects by entry points of the group
``frischid.effects``, in its pyproject.toml:

    [project.entry-points."frischid.effects"]
    magnetic_detent = "my_effect:MagneticDetent"

The value names a class, or a module all of whose effects join. Packages are imported late: when a name is asked for
that no class has so far, or the whole catalogue. A package that cannot be imported is left out, with one warning.

Source: "Entry points specification", https://packaging.python.org/en/latest/specifications/entry-points/.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Any, Generic, NamedTuple, TypeVar

from frischid.effects.definition import check_decorated
from frischid.errors import InputError

GROUP = "frischid.effects"
"""Name of the entry points that announce effects."""

Kind = TypeVar("Kind")


class Package(NamedTuple):
    """Origin of an effect that is not of frischid: an installed package, or a module that no package announces.

    Attributes
    ----------
    name, version : str
        Name and version of the installed package; empty where there is none.
    module : str
        Module that defines the effect.
    """

    name: str
    version: str
    module: str

    def __str__(self) -> str:
        return f"package {self.name} {self.version}" if self.name else f"module {self.module}"

    def to_dict(self) -> dict[str, str]:
        """Plain JSON values for a model file."""
        return {"name": self.name, "version": self.version} if self.name else {"module": self.module}


class Catalogue(Mapping[str, type[Kind]], Generic[Kind]):
    """Identifier -> effect class, in order of definition.

    Examples
    --------
    >>> from frischid.effects import EFFECTS
    >>> EFFECTS["viscous"].title
    'viscous friction'
    """

    def __init__(self) -> None:
        self._known: dict[str, type[Kind]] = {}
        self._packages: dict[str, Package] = {}
        self._broken: dict[str, str] = {}
        self._searched = False
        self._lock = threading.RLock()

    def __getitem__(self, name: str) -> type[Kind]:
        if name not in self._known:
            self._search()
        return self._sound(name)

    def __iter__(self) -> Iterator[str]:
        self._search()
        for name in list(self._known):
            self._sound(name)
        return iter(self._known)

    def __len__(self) -> int:
        self._search()
        return len(self._known)

    def register(self, kind: type[Any]) -> None:
        """Add a class under its `id`. A class that is defined again, as in a notebook, replaces the earlier one.

        Raises
        ------
        InputError
            Another class has this `id`.
        """
        other: type[Any] | None = self._known.get(kind.id)
        if other is not None and _full_name(other) != _full_name(kind):
            raise InputError(
                f"class {_full_name(kind)}: the id '{kind.id}' is taken by {_full_name(other)}; choose another id"
            )
        self._known[kind.id] = kind

    def remove(self, name: str) -> None:
        """Remove an effect, for example one of a notebook that `diagnose` should no longer try."""
        self._known.pop(name, None)

    def package(self, kind: type[Any]) -> Package | None:
        """Package or module that an effect comes from; None for an effect of frischid."""
        if kind.__module__.partition(".")[0] == "frischid":
            return None
        self._search()
        return self._packages.get(kind.id) or Package("", "", kind.__module__)

    def of_package(self, name: str, origin: Mapping[str, str]) -> type[Kind]:
        """The class of an effect of another package that a saved model uses; `origin` is a `Package.to_dict`.

        Raises
        ------
        InputError
            The effect is not available, or the effect of this name is another package's.
        """
        wanted = Package(origin.get("name", ""), origin.get("version", ""), origin.get("module", ""))
        kind = self.get(name)
        if kind is None:
            raise InputError(f"effect '{name}' comes from the {wanted}, {self._remedy(wanted)}")
        found = self.package(kind)
        if wanted.name and (found is None or found.name not in ("", wanted.name)):
            raise InputError(
                f"effect '{name}' comes from the {wanted}, but here an effect of this name comes from "
                f"{found or 'frischid'}; uninstall one of the two packages"
            )
        return kind

    def _remedy(self, wanted: Package) -> str:
        if not wanted.name:
            return "which is not imported; import it first, or make it a package (CONTRIBUTING.md, 'Add an effect')"
        if wanted.name in self._broken:
            return f"which is installed but cannot be used ({self._broken[wanted.name]}); repair or update the package"
        return f"which is not installed; install it (pip install {wanted.name}) and try again"

    def _sound(self, name: str) -> type[Kind]:
        """The class of a name; a class that is not a dataclass is removed from the catalogue, with one warning."""
        kind = self._known[name]
        try:
            check_decorated(kind)
        except InputError:
            del self._known[name]
            raise
        return kind

    def _search(self) -> None:
        """Import the packages that announce effects, once."""
        with self._lock:
            if self._searched:
                return
            self._searched = True
            for entry in sorted(metadata.entry_points(group=GROUP), key=lambda e: e.name):
                package = Package(*((entry.dist.name, entry.dist.version) if entry.dist else ("", "")), entry.module)
                try:
                    self._load(entry, package)
                except Exception as error:  # other people's code may raise any error; frischid works without that code
                    self._reject(package, f"{type(error).__name__}: {error}")

    def _load(self, entry: metadata.EntryPoint, package: Package) -> None:
        before = set(self._known)
        found = entry.load()
        own = [
            kind
            for name, kind in self._known.items()
            if name not in before or kind is found or f"{kind.__module__}.".startswith(f"{entry.module}.")
        ]
        if not own:
            raise InputError(f"the entry point {entry.name} = {entry.value} names no effect")
        for kind in own:
            self._packages[self._name_of(kind)] = package
            check_decorated(kind)

    def _name_of(self, kind: type[Kind]) -> str:
        return next(name for name, known in self._known.items() if known is kind)

    def _reject(self, package: Package, reason: str) -> None:
        """Leave a package's effects out, with one warning per package."""
        for name in [n for n, origin in self._packages.items() if origin.name == package.name]:
            self.remove(name)
        if package.name not in self._broken:
            self._broken[package.name] = reason
            warnings.warn(f"the effects of the {package} are left out: {reason}", stacklevel=2)


def _full_name(kind: type[Any]) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
