"""A mapping file that undoes the faults of a log: the given mapping, and the entries that a check found.

Entries are (joint, key, value). A sign multiplies the sign that the mapping has already, an offset is added to it. A
unit of angle and the column of another joint replace the joint's own. An entry without a joint belongs to ``[file]``.
Where the torque is a current times a gain, the unit and the column are those of the current.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from frischid.core.text import quoted
from frischid.errors import InputError
from frischid.logs.log import CHANNELS, Log
from frischid.logs.mapping import JointMap, LogMap

FILE_KEYS = (
    "time", "time_unit", "zero_time", "header", "delimiter", "columns", "joints", "topic", "rate", "logs", "angle_unit"
)  # fmt: skip


def corrected(form: LogMap, fixes: Sequence[tuple[str, str, Any]], log: Log) -> LogMap:
    """The mapping with some entries changed.

    Parameters
    ----------
    form : LogMap
        Of one layout.
    fixes : sequence of (str, str, object)
        Joint, key and value.
    log : Log
        As this mapping reads it, or its first samples.
    """
    joint, currents = dict(form.joint), _of_currents(log, form)
    channels = [c for c in CHANNELS if log.has(c).any()]
    for name, key, value in fixes:
        if not name:
            form = replace(form, **{key: value})
        elif key in channels:
            source = "current" if key == "tau" and name in currents else key
            column = getattr(form.joint.get(value, JointMap()), source)
            named: Any = form.default[source].replace("{joint}", value) if column is None else column
            joint[name] = replace(joint.get(name, JointMap()), **{source: named})
        elif key not in CHANNELS:
            key = "current_factor" if key == "torque_factor" and name in currents else key
            joint[name] = _changed(joint.get(name, JointMap()), key, value)
    return replace(form, joint=joint, file=None)


def _changed(entry: JointMap, key: str, value: Any) -> JointMap:
    """The entry of a joint with an offset, a unit of angle, a sign or a factor changed."""
    if key == "offset":
        return replace(entry, offset=entry.offset + value)
    if key == "angle_unit":
        # "m" says that another unit of the file is not this joint's: what the joint has of its own, it keeps
        return replace(entry, angle_unit=value if value != "m" else entry.angle_unit or value)
    entry = replace(entry, **{key: getattr(entry, key) * value})
    return replace(entry, offset=-entry.offset) if key == "sign" else entry


def _of_currents(log: Log, form: LogMap) -> set[str]:
    """Joints whose torque is their current times a gain; beside a torque column, a gain may be there and not used."""
    found = set()
    for name, entry in form.joint.items():
        if entry.current_gain is None or name not in log.joints or log.tau is None or log.current is None:
            continue
        j = log.joints.index(name)
        if np.array_equal(log.tau[:, j], entry.current_gain * log.current[:, j]):
            found.add(name)
    return found


def toml_of(forms: Mapping[str, LogMap]) -> str:
    """Text of a mapping file; several mappings become layouts of these names."""
    if len(forms) == 1:
        return "\n".join(_lines(next(iter(forms.values())), "")).strip() + "\n"
    parts = ["\n".join(_lines(form, f"layout.{quoted(name)}.")) for name, form in forms.items()]
    return "\n".join(parts).strip() + "\n"


def _lines(form: LogMap, prefix: str) -> list[str]:
    usual, own = LogMap(), JointMap()
    file = {k: getattr(form, k) for k in FILE_KEYS if getattr(form, k) != getattr(usual, k)}
    default: dict[str, Any] = {k: x for k, x in form.default.items() if x != usual.default[k]}
    if form.tau_from is not None:
        default["tau_from"] = form.tau_from
    lines = _table(f"[{prefix}file]", file) + _table(f"[{prefix}default]", default)
    for name, entry in form.joint.items():
        keys = {f.name: getattr(entry, f.name) for f in fields(entry)}
        changed = {k: x for k, x in keys.items() if x != getattr(own, k)}
        lines += _table(f"[{prefix}joint.{quoted(name)}]", changed)
    return lines


def _table(title: str, entries: Mapping[str, Any]) -> list[str]:
    if not entries:
        return []
    return ["", title, *(f"{key} = {quoted(x)}" for key, x in entries.items())]


def together(parts: Sequence[tuple[str, LogMap, Sequence[tuple[str, str, Any]], Log]]) -> str:
    """Mapping file for several logs: name, mapping, fixes and first samples of each.

    Raises
    ------
    InputError
        Two logs share a mapping and need different fixes.
    """
    found: dict[str, LogMap] = {}
    by_form: dict[str, tuple[str, LogMap]] = {}
    for name, form, fixes, log in parts:
        fixed = corrected(form, fixes, log)
        key = repr(replace(form, file=None))
        if key in by_form and by_form[key][1] != fixed:
            raise InputError(
                f"{by_form[key][0]} and {name} have the same columns and need different corrections; check them one by "
                "one, with an output file for each"
            )
        if key not in by_form:
            by_form[key] = (name, fixed)
            others = sum(name == taken for taken, _ in by_form.values()) - 1  # files of one name in several folders
            found[f"{name} ({others + 1})" if others else name] = fixed
    return toml_of(found)
