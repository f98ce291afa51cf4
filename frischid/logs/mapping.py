"""The meaning of a foreign log's columns, read from a small TOML file.

    [file]                                      [joint.elbow]              [current_gain]
    time = "stamp"                              q = "pos_3"                elbow = 9.84
    time_unit = "ms"                            sign = -1
    angle_unit = "deg"                          gear_ratio = 101.0

A `LogMap` gives the joint and channel of each column, and the unit and direction in which it was recorded:

    q = sign · unit · raw / gear_ratio + offset        q̇ = sign · unit · velocity_factor · raw / gear_ratio
    q̈ = sign · unit · raw / gear_ratio
    i = sign · torque_sign · raw                       τ = sign · torque_sign · torque_factor · gear_ratio · raw
                                                       or τ = current_gain · i

Commanded positions ``qcmd`` and velocities ``vcmd`` are converted as q and q̇, feed-forward torques ``tauff`` as τ.

Logs of one robot may have different columns. Each layout is then a section ``[layout.<name>]`` with tables of its own,
and what stands outside holds for all; or there are several mapping files. `frischid.logs.layouts` finds the layout of a
log.

Every key is checked when the mapping is made (`frischid.logs.mapping_rules`), so that a mistyped key is an error and is
not silently ignored.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from frischid.core.files import read_toml
from frischid.core.text import shortened
from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import CHANNELS
from frischid.logs.log_file import StoredFile
from frischid.logs.mapping_rules import DEFAULT_RULES, FILE_RULES, JOINT_RULES, TABLES, checked


@dataclass(frozen=True)
class JointMap:
    """Recording of one joint. A key that is not given has the value of a log in frischid's own layout."""

    q: str | int | None = None
    v: str | int | None = None
    a: str | int | None = None
    tau: str | int | None = None
    current: str | int | None = None
    qcmd: str | int | None = None
    vcmd: str | int | None = None
    tauff: str | int | None = None
    """`q`, `v`, `a`, `tau`, `current`, `qcmd`, `vcmd`, `tauff`: Column name, or number from 0; otherwise the template
    under ``[default]``."""
    sign: int = 1
    """Direction of the recorded axis: factor of all channels."""
    offset: float = 0.0
    """Added to q and qcmd after sign, unit and gear [rad or m]."""
    gear_ratio: float = 1.0
    """Gear ratio if the columns are motor-side: q, v, a, qcmd, vcmd are divided by it, tau and tauff are multiplied."""
    velocity_factor: float = 1.0
    """Further factor of v and vcmd only, where their unit is not that of the positions per second: 0.10472 for rpm."""
    torque_sign: int = 1
    """Further factor of tau, tauff and current only."""
    torque_factor: float = 1.0
    """Further factor of tau and tauff only: their unit, N·m per unit of the column."""
    current_factor: float = 1.0
    """Further factor of current only: its unit, A per unit of the column."""
    current_gain: float | None = None
    """Joint-side torque per ampere [N·m/A]: ``tau = current_gain · current`` where there is no tau column."""
    tau_from: str | None = None
    """Channel that gives the torque, if both are recorded."""
    angle_unit: str | None = None
    """Unit of this joint, if it differs from the file's (a prismatic joint in a file of degrees: ``"m"``, ``"mm"``)."""


@dataclass(frozen=True)
class LogMap:
    """Meaning of the columns of a file; made by `load` or `from_dict`.

    Attributes
    ----------
    time, time_unit, zero_time
        Column of the stamps, its unit (s, ms, us, ns), and whether to subtract the first stamp.
    header, delimiter, columns
        Whether a CSV's first line names the columns, the separator, and the names if there is no such line.
    rate
        Samples per second of a file without a time column.
    logs
        Patterns of the names of the files that this mapping is for; all if empty.
    joints
        Joints of the columns of 2-D arrays in an NPZ file, in order.
    topic
        Topic to read from a bag with several topics of joint states.
    angle_unit : {"rad", "deg"}
        Unit of all positions, velocities and accelerations.
    default : mapping of str to str
        Template of each channel's column names; ``{joint}`` stands for the joint.
    tau_from : {"tau", "current"}, optional
        As in `JointMap`, for every joint.
    joint : mapping of str to JointMap
    source : str
        The mapping file, for messages.
    file : StoredFile, optional
        The mapping file as it was read; None where the mapping was written in Python.
    layouts : tuple of LogMap
        Mappings of several layouts; the one that fits a log is used instead of this one.

    Examples
    --------
    >>> import frischid as fr
    >>> mapping = fr.LogMap.from_dict({"file": {"time_unit": "ms"}, "joint": {"elbow": {"q": "pos_3", "sign": -1}}})
    >>> mapping.joint["elbow"].sign, mapping.default["tau"]
    (-1, 'tau_{joint}')
    >>> fr.LogMap.from_dict({"file": {"time_units": "ms"}})
    Traceback (most recent call last):
    ...
    frischid.errors.UnknownNameError: ...'time_units'... did you mean: time_unit...
    """

    time: str | int = "t"
    time_unit: str = "s"
    zero_time: bool = False
    header: bool = True
    delimiter: str | None = None
    columns: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    topic: str | None = None
    rate: float | None = None
    logs: tuple[str, ...] = ()
    angle_unit: str = "rad"
    default: Mapping[str, str] = field(default_factory=lambda: {c: f"{c}_{{joint}}" for c in CHANNELS})
    tau_from: str | None = None
    joint: Mapping[str, JointMap] = field(default_factory=dict)
    source: str = "mapping"
    file: StoredFile | None = None
    layouts: tuple[LogMap, ...] = ()

    @classmethod
    def of(cls, mapping: MappingLike) -> LogMap:
        """Mapping from a mapping, its tables as dictionaries, or the paths of TOML files; None: frischid's layout."""
        if mapping is None:
            return cls()
        if isinstance(mapping, str | Path):
            return cls.load(mapping)
        if isinstance(mapping, Sequence):
            several = [cls.load(path) for path in mapping]
            single = [form for one in several for form in (one.layouts or (one,))]
            return single[0] if len(single) == 1 else cls(layouts=tuple(single))
        return mapping if isinstance(mapping, LogMap) else cls.from_dict(mapping)

    @classmethod
    def load(cls, path: str | Path) -> LogMap:
        """Read a mapping from a TOML file."""
        tables, content = read_toml(path, "mapping")
        found = cls.from_dict(tables, str(path))
        stored = StoredFile(str(Path(path).absolute()), hashlib.sha256(content).hexdigest(), len(content))
        return replace(found, file=stored, layouts=tuple(replace(x, file=stored) for x in found.layouts))

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], source: str = "mapping") -> LogMap:
        """Check the tables [file], [default], [joint.<name>], [current_gain] and [layout.<name>], and join them."""
        for key, table in content.items():
            if key not in TABLES:
                raise UnknownNameError("table", key, TABLES, source)
            if not isinstance(table, Mapping):
                raise InputError(f"{source}: {key} must be a table, found {shortened(table)}")
        file = checked(content.get("file", {}), FILE_RULES, f"[file] of {source}")
        if "rate" in file and "time" in file:
            raise InputError(f"{source}: rate is for files without a time column; leave out time or rate")
        if file.get("header", True) and "columns" in file:
            raise InputError(f"{source}: columns = [...] names those of a file with header = false")
        default = checked(content.get("default", {}), DEFAULT_RULES, f"[default] of {source}")
        tau_from = default.pop("tau_from", None)
        joint = {
            name: checked(table, JOINT_RULES, f"[joint.{name}] of {source}")
            for name, table in content.get("joint", {}).items()
        }
        for name, gain in content.get("current_gain", {}).items():
            checked({"current_gain": gain}, JOINT_RULES, f"[current_gain] {name} of {source}")
            if joint.setdefault(name, {}).setdefault("current_gain", gain) != gain:
                raise InputError(
                    f"{source}: joint {name} has two different current gains, under [current_gain] and under "
                    f"[joint.{name}]; delete one"
                )
        return cls(
            **file | {key: tuple(file.get(key, ())) for key in ("columns", "joints", "logs")},
            default={**cls().default, **default},
            tau_from=tau_from,
            joint={name: JointMap(**table) for name, table in joint.items()},
            source=source,
            layouts=tuple(
                cls.from_dict(_with_shared(content, part), f"{source}, [layout.{name}]")
                for name, part in content.get("layout", {}).items()
            ),
        )


MappingLike = LogMap | Mapping[str, Any] | str | Path | Sequence[str | Path] | None
"""An argument of `LogMap.of`."""


def _with_shared(content: Mapping[str, Any], part: Any) -> dict[str, Any]:
    """Tables of one layout, with those outside of the layouts as defaults."""
    if not isinstance(part, Mapping) or "layout" in part:
        raise InputError(
            f"a [layout.NAME] must hold the tables of a mapping, and no further layout; found {shortened(part)}"
        )
    joined: dict[str, Any] = {**part}
    for key in TABLES[:-1]:
        shared, own = content.get(key, {}), part.get(key, {})
        if isinstance(own, Mapping):
            joined[key] = {**shared, **own}
        if key == "joint" and isinstance(own, Mapping):
            both = [n for n in own if isinstance(own[n], Mapping) and isinstance(shared.get(n), Mapping)]
            joined[key] |= {n: {**shared[n], **own[n]} for n in both}
    return joined
